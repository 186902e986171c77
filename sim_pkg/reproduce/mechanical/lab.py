# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Section 6.2: the laboratory cart-pendulum in open loop, Table 5 (rows D).

Arrays of n samples have shape (n, 2), pendulum and cart: positions and readings [rad, m],
velocities [rad/s, m/s]; inputs are currents, shape (n, 1) [A].
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.models import cart_pendulum
from estimator_pkg.models.mechanics import Mechanics
from sim_pkg.mechanisms.cart_pendulum import BACKWARD, CONSTANT, FORWARD, PLANT, current
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.runs import Case, make, metrics, move, observe, quantise

Array = NDArray[np.float64]

RATE, COUNT, PARTS_PLANT = 224.0, 2464, 24
DT = 1.0 / RATE
QUANTA = {'HPM': (7.85e-4, 1.8e-5), 'LPM': (1.23e-2, 1e-3)}
HELD = {'HPM': 1, 'LPM': 2}  # samples for which a reading is held
AMPLITUDE = 2.5  # A
OFFSETS = range(12)
THREE = ('ME1e2', 'MSE1e4', 'ME2e2')

# of the observers: a hard sign
KNOWN = {'force_constant': CONSTANT, 'friction_forward': FORWARD, 'friction_backward': BACKWARD}

CASES: dict[str, Case] = {
    'GESO': ('geso', {'L': [50.0, 80.0], 'Gamma': [400.0, 150.0]}),
    'SMO-BL': ('smo', {'mu': [29.0, 10.0]}),
    'EHGO-BL': ('ehgo', {'h': [5.0, 5.0, 4.0], 'epsilon': 0.0126}),
    'SMO-CV': ('smo', {'mu': [78.0, 28.0]}),
    'EHGO-CV': ('ehgo', {'h': [5.0, 5.0, 4.0], 'epsilon': 0.009}),
    'GESO80': ('geso', {'L': [50.0, 80.0], 'Gamma': [80.0, 150.0]}),
}


def plant(kind: str) -> Mechanics:
    """The plant, 'nominal' or with the 'mismatch' of the specification."""
    numbers = dict(PLANT)
    if kind == 'mismatch':
        # l_m m_p = 0.105 with m_p 3 % heavier; M_c + m_p = 1.15, split by MASS
        numbers.update(
            pendulum_inertia=0.0484 * 0.97,
            pendulum_moment=0.105 * 1.03,
            moving_mass=1.02 * (1.15 - MASS) + 1.03 * MASS,
            force_constant=CONSTANT * 0.97,
            friction_forward=FORWARD * 1.1,
            friction_backward=BACKWARD * 0.9,
            pendulum_damping=0.002,
            cart_damping=0.3,
        )
    return cart_pendulum.MODEL.build(cart_pendulum.Parameters(**numbers))


MASS = 0.30  # m_p [kg], Table 3


@lru_cache
def truth(kind: str, amplitude: float = AMPLITUDE) -> tuple[Array, Array, Array]:
    """Return (positions, velocities, inputs), n = COUNT."""
    inputs = np.array([[current(DT * k, amplitude)] for k in range(COUNT)])
    return *move(plant(kind), (math.pi, 0.0), (0.0, 0.0), inputs, DT, PARTS_PLANT), inputs


def measured(positions: Array, scenario: str, seed: int) -> Array:
    """Return readings, quantised with an encoder offset; in LPM each is held for two samples."""
    quanta = np.array(QUANTA[scenario])
    offset = np.random.default_rng(seed).uniform(-0.5, 0.5, 2) * quanta
    readings = quantise(positions + offset, quanta) - offset
    held = HELD[scenario]
    return readings[(np.arange(len(readings)) // held) * held]


def estimate(case: Case, readings: Array, inputs: Array) -> Array:
    """Return velocities from readings; the observers keep their state in single precision."""
    return observe(make(case, 'cart_pendulum', KNOWN), readings, inputs, DT, single=True)


def three(case: Case, scenario: str) -> Array:
    """Return THREE, the first of `metrics`, shape (3,): their mean over encoder offsets."""
    q, v, inputs = truth('mismatch')
    readings = np.stack([measured(q, scenario, offset) for offset in OFFSETS], axis=1)
    found: Array = np.mean(metrics(estimate(case, readings, inputs) - v[:, None]), axis=0)
    return found[:3]


def largest_accelerations(amplitude: float) -> Array:
    """Return the largest |q''|, shape (2,) [rad/s^2, m/s^2].

    They are central differences of the true velocities at the samples.
    """
    return np.max(np.abs(np.gradient(truth('nominal', amplitude)[1], DT, axis=0)), axis=0)


def values() -> Values:
    """Rows D."""
    for index, amplitude in enumerate((AMPLITUDE, 1.25)):
        for joint, value in enumerate(largest_accelerations(amplitude)):
            yield f'D2.{2 * index + joint + 1}', value
    for scenario in ('HPM', 'LPM'):
        for name, case in CASES.items():
            if (scenario, name) != ('HPM', 'GESO80'):
                for metric, value in zip(THREE, three(case, scenario)):
                    yield f'D3.{scenario}.{name}.{metric}', value
