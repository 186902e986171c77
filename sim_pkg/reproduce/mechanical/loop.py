# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Section 6.3: the pendulum balanced with each observer in the loop, Table 6 (rows E)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator_pkg.models.mechanics import Array
from estimator_pkg.models.motion import move
from sim_pkg.mechanisms.cart_pendulum import CONSTANT, LIMIT, balancing_force, triangle
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.lab import CASES, DT, HELD, KNOWN, QUANTA, plant
from sim_pkg.reproduce.mechanical.runs import Case, follow, in_single, make, quantise, rest

PARTS = 6  # of a sample: a loop that is closed forgets the error of a step, unlike `lab.truth`
COUNT, DROPPED = 8960, 2240  # 40 s, of which 10 s are dropped
FALLEN = 0.5 * math.pi
ALL_CASES: dict[str, Case] = {
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


def balance(runs: Sequence[tuple[str, str]]) -> list[Balanced]:
    """Return runs of plant, encoders, an observer of `ALL_CASES` and the controller together.

    Parameters
    ----------
    runs : (name of the observer, scenario) of each; their plants move side by side.
    """
    shape = len(runs), 2
    sharing = []  # (observer, the runs with it)
    for name in dict(runs):
        rows = [number for number, run in enumerate(runs) if run[0] == name]
        sharing.append((make(ALL_CASES[name], 'cart_pendulum', KNOWN), rows))
    quanta = np.array([QUANTA[scenario] for _, scenario in runs])
    held = np.array([[HELD[scenario]] for _, scenario in runs])
    offsets = np.random.default_rng(0).uniform(-0.5, 0.5, 2) * quanta
    pendulum, out = plant('nominal'), np.zeros((COUNT, *shape))
    q, v, u = np.full(shape, (0.05, 0.0)), np.zeros(shape), np.zeros((len(runs), 1))
    y, estimated = np.zeros(shape), np.zeros(shape)
    cores = [rest(y[rows]) for _, rows in sharing]
    for k in range(COUNT):
        before = y
        y = np.where(k % held == 0, quantise(q + offsets, quanta) - offsets, before)
        for place, (observer, rows) in enumerate(sharing if k > 0 else ()):
            core = follow(observer, cores[place], before[rows], y[rows], u[rows], DT)
            cores[place] = in_single(core)
            estimated[rows] = core.v
        r, rate = triangle(k * DT)
        forces = [
            balancing_force(positions, velocities, r, rate)
            for positions, velocities in zip(y.tolist(), estimated.tolist())
        ]
        u = np.clip(forces, -LIMIT, LIMIT)[:, None] / CONSTANT
        out[k] = q
        q, v = move(pendulum, q, v, u, DT, PARTS)
    reference = np.array([triangle(k * DT)[0] for k in range(COUNT)])
    return [Balanced(out[:, number], reference) for number in range(len(runs))]


def values() -> Values:
    """Rows E: whether the pendulum fell, and the means of its angle."""
    runs = [(name, scenario) for scenario, names in LOOPS.items() for name in names]
    for (name, scenario), found in zip(runs, balance(runs)):
        yield f'E1.{name}.{scenario}', float(found.fell)
        if name in PRINTED[scenario]:
            angle = found.positions[DROPPED:, 0]
            yield f'E2.{name}.{scenario}', 1e2 * float(np.mean(np.abs(angle)))
            yield f'E3.{name}.{scenario}', 1e4 * float(np.mean(angle**2))
