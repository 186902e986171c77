# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The benefit of a known torque: one joint, observers with and without it, best tuning each (G).

The specification names the torque (several sines, 0.3 to 5 Hz), the encoders, 1 kHz and Coulomb
friction of 0.05 N m, "28 % of the rms torque"; it does not state inertia, damping, number and
phases of the sines, or length. They are inferred from the 36 printed numbers: an inertia of
0.02 kg m^2 follows from all of them, the printed bandwidths are 30 to 320 rad/s in 16 equal ratios,
and the smallest errors of "u exact" limit the damping. docs/papers/mechanical.md describes how the
rows depend on the draw of the phases.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.models import single_joint
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.runs import make, move, observe, quantise

Array = NDArray[np.float64]

DT, COUNT, PLANT_STEPS = 1e-3, 20000, 4
JOINT = {'inertia': 0.02, 'damping': 0.02}  # kg m^2, N m s/rad
SINES = np.linspace(0.3, 5.0, 16)  # Hz
TORQUE = 0.1765  # N m, rms
PHASES = 17  # seed of their draw
WIDTH = 2e-3  # rad/s, of the Coulomb friction's change of sign
FRICTIONS, COUNTS = (0.0, 0.05), (4096, 1024)
OMEGAS = (0.1, *np.geomspace(30.0, 320.0, 16).tolist())  # 0.1: next to no correction
LATE = 20  # samples


class Case(NamedTuple):
    """An observer: with or without a disturbance state; torque gain and delay [samples]."""

    extended: bool
    torque: float
    late: int = 0


CASES = {
    'no input, 2nd order': Case(False, 0.0),
    'no input, 3rd order': Case(True, 0.0),
    'u exact': Case(False, 1.0),
    'u +5%': Case(False, 1.05),
    'u +10%': Case(False, 1.1),
    'u +20%': Case(False, 1.2),
    'u +50%': Case(False, 1.5),
    'u 20 ms late': Case(False, 1.0, LATE),
    'u +20%, disturbance state': Case(True, 1.2),
}


@lru_cache
def torque() -> Array:
    """Return the torque at each sample [N m], shape (COUNT,)."""
    phases = np.random.default_rng(PHASES).uniform(0.0, 2.0 * math.pi, len(SINES))
    time = DT * np.arange(COUNT)
    sines = np.sin(2.0 * math.pi * SINES * time[:, None] + phases)
    return TORQUE * math.sqrt(2.0 / len(SINES)) * np.sum(sines, axis=1)


@lru_cache
def truth(friction: float) -> tuple[Array, Array]:
    """Return (positions [rad], velocities [rad/s]) of the joint, shape (COUNT, 1)."""
    joint = single_joint.build(
        single_joint.Parameters(coulomb=friction, coulomb_speed=WIDTH, **JOINT)
    )
    return move(joint, (0.0,), (0.0,), torque()[:, None], DT, PLANT_STEPS)


def best(case: Case, friction: float, counts: int, known_friction: float = 0.0) -> float:
    """Return the least rms velocity error over the bandwidths [rad/s].

    Parameters
    ----------
    known_friction : Coulomb friction in the observer's model [N m].
    """
    q, v = truth(friction)
    measured = quantise(q, 2.0 * math.pi / counts)
    inputs = np.zeros((COUNT, 1))
    inputs[case.late :, 0] = case.torque * torque()[: COUNT - case.late]
    model: dict[str, Any] = {
        'inertia': JOINT['inertia'],
        'coulomb': known_friction,
        'coulomb_speed': WIDTH,
    }
    if case.torque > 0.0:
        model['damping'] = JOINT['damping']  # without the torque the model is not used
    found = []
    for omega in OMEGAS:
        poles = [3.0, 3.0, 1.0] if case.extended else [2.0, 1.0]  # all at -omega
        functions = make(
            'ehgo' if case.extended else 'hgo', 'single_joint', model, h=poles, epsilon=1.0 / omega
        )
        error = observe(functions, measured, inputs, DT) - v
        found.append(math.sqrt(float(np.mean(error**2))))
    return float(np.nanmin(found))


def values() -> Values:
    """Rows G."""
    for friction in FRICTIONS:
        for counts in COUNTS:
            for name, case in CASES.items():
                yield (f'G.tc={friction} {counts} cpr.{name}', best(case, friction, counts))
