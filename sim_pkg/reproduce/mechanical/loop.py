# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Section 6.3: the pendulum balanced with each observer in the loop, Table 6 (rows E)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.observers.mechanism.motion import MechanismSimulation
from sim_pkg.mechanisms.balance import balancing_force, triangle
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.lab import (
    BACKWARD,
    CASES,
    CONSTANT,
    DT,
    FORWARD,
    FRICTION,
    HELD,
    PARTS_PLANT,
    QUANTA,
    plant,
)
from sim_pkg.reproduce.mechanical.runs import make, quantise, walk

Array = NDArray[np.float64]

COUNT, DROPPED = 8960, 2240  # 40 s, of which 10 s are dropped
FALLEN = 0.5 * math.pi
LIMIT = 60.0  # N
ALL_CASES: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: CASES[name] for name in ('GESO', 'SMO-BL', 'EHGO-BL')},
    'EHGO.025': ('ehgo', {'h': [5.0, 5.0, 4.0], 'epsilon': 0.025}),
}


LOOPS = {'HPM': tuple(ALL_CASES), 'LPM': ('GESO', 'SMO-BL')}
PRINTED = {'HPM': ('GESO', 'SMO-BL'), 'LPM': ('GESO',)}  # of these Table 6 has the means


class Balanced(NamedTuple):
    """A run: positions, shape (N, 2), and the cart's reference, shape (N,)."""

    positions: Array
    reference: Array

    @property
    def fell(self) -> bool:
        """True if the pendulum left the upper half."""
        return not float(np.max(np.abs(self.positions[:, 0]))) < FALLEN


def balance(name: str, scenario: str) -> Balanced:
    """One run of plant, encoders, an observer of `ALL_CASES` and the controller together."""
    observer, gains = ALL_CASES[name]
    plan = make(observer, 'cart_pendulum', {'force_constant': CONSTANT, **FRICTION}, **gains)
    quanta = np.array(QUANTA[scenario])
    offsets = np.random.default_rng(0).uniform(-0.5, 0.5, 2) * quanta
    out = np.full((COUNT, 2), np.nan)
    q = np.array([0.05, 0.0])
    moving, state = MechanismSimulation(plant('nominal'), q, (0.0, 0.0)), plan.state()
    before = y = np.zeros(2)
    force, velocity = 0.0, (0.0, 0.0)
    for k in range(COUNT):
        if k % HELD[scenario] == 0:
            y = quantise(q + offsets, quanta) - offsets
        if k > 0:
            rows, given = np.stack([before, y]), np.full((2, 1), force / CONSTANT)
            velocity = tuple(walk(plan, state, rows, given, DT, single=True)[1].tolist())
        before = y
        r, rate = triangle(k * DT)
        force = balancing_force((y[0], y[1]), velocity, r, rate, FORWARD, BACKWARD)
        force = min(max(force, -LIMIT), LIMIT)
        out[k] = q
        if not abs(q[0]) < 100.0:
            break
        q = np.array(moving.step([force / CONSTANT], DT, PARTS_PLANT)[0])
    return Balanced(out, np.array([triangle(k * DT)[0] for k in range(COUNT)]))


def values() -> Values:
    """Rows E: whether the pendulum fell, and the means of its angle."""
    for scenario, names in LOOPS.items():
        for name in names:
            found = balance(name, scenario)
            yield f'E1.{name}.{scenario}', float(found.fell)
            if name in PRINTED[scenario]:
                angle = found.positions[DROPPED:, 0]
                yield f'E2.{name}.{scenario}', 1e2 * float(np.mean(np.abs(angle)))
                yield f'E3.{name}.{scenario}', 1e4 * float(np.mean(angle**2))
