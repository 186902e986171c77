# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Section 6.3: the pendulum balanced with each observer in the loop, Table 6 (rows E)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import compiled
from estimator_pkg.observers.mechanism.core import MechanicalFunctions
from estimator_pkg.observers.mechanism.motion import make_plant
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
from sim_pkg.reproduce.mechanical.runs import make, make_in_single

Array = NDArray[np.float64]

COUNT, DROPPED, RUNS = 8960, 2240, 4  # 40 s, of which 10 s are dropped
FALLEN = 0.5 * math.pi
LIMIT = 60.0  # N
ALL_CASES: dict[str, tuple[str, dict[str, Any]]] = {
    **CASES,
    'EHGO.025': ('ehgo', {'h': [5.0, 5.0, 4.0], 'epsilon': 0.025}),
}


class Balanced(NamedTuple):
    """A run: positions, shape (N, 2), and the cart's reference, shape (N,)."""

    positions: Array
    reference: Array

    @property
    def fell(self) -> bool:
        """True if the pendulum left the upper half."""
        return not float(np.max(np.abs(self.positions[:, 0]))) < FALLEN


def make_loop(functions: MechanicalFunctions) -> Any:
    """loop(core, coefficients, design, numbers, q, dt, parts, held, quanta, offsets, single, out):
    plant, encoders, observer and controller together.
    """
    advance = functions.core.advance
    mechanics = plant('nominal')
    move = make_plant(mechanics)
    in_single = make_in_single(functions)
    forward, backward, constant, limit = FORWARD, BACKWARD, CONSTANT, LIMIT

    def loop(
        core: tuple,
        coefficients: tuple,
        design: tuple,
        numbers: tuple,
        q: tuple,
        dt: float,
        parts: int,
        held: int,
        quanta: tuple,
        offsets: tuple,
        out: Any,
    ) -> None:
        v = (0.0, 0.0)
        before, force = (0.0, 0.0), 0.0
        y = before
        for k in range(len(out)):
            if k % held == 0:
                y = (
                    quanta[0] * math.floor((q[0] + offsets[0]) / quanta[0] + 0.5) - offsets[0],
                    quanta[1] * math.floor((q[1] + offsets[1]) / quanta[1] + 0.5) - offsets[1],
                )
            if k > 0:
                moved = (y[0] - before[0], y[1] - before[1])
                core, good = advance(
                    core, coefficients, design, before, moved, y, (force / constant,)
                )
                core = in_single(core)
            before = y
            r, rate = triangle(k * dt)
            _, _, _, velocity = core
            force = balancing_force(y, velocity, r, rate, forward, backward)
            force = min(max(force, -limit), limit)
            out[k, 0] = q[0]
            out[k, 1] = q[1]
            if not abs(q[0]) < 100.0:
                break
            q, v = move(numbers, q, v, (force / constant,), dt, parts)

    return loop


def balance(name: str, scenario: str, run: int) -> Balanced:
    """One run with an observer of `ALL_CASES` in the loop."""
    observer, gains = ALL_CASES[name]
    functions = make(observer, 'cart_pendulum', {'force_constant': CONSTANT, **FRICTION}, **gains)
    quanta = QUANTA[scenario]
    offsets = np.random.default_rng(run).uniform(-0.5, 0.5, 2) * quanta
    out = np.full((COUNT, 2), np.nan)
    design = functions.core.design()
    compiled(make_loop(functions))(
        functions.core.begin(),
        functions.core.prepare(design, DT),
        design,
        plant('nominal').values,
        (0.05 + 0.001 * run, 0.0),
        DT,
        PARTS_PLANT,
        HELD[scenario],
        quanta,
        tuple(offsets.tolist()),
        out,
    )
    return Balanced(out, np.array([triangle(k * DT)[0] for k in range(COUNT)]))


def values() -> Values:
    """Rows E."""
    for name in ALL_CASES:
        for scenario in ('HPM', 'LPM'):
            runs = [balance(name, scenario, run) for run in range(RUNS)]
            yield f'E1.{name}.{scenario}', float(sum(run.fell for run in runs))
            if not all(run.fell for run in runs):
                angles = [run.positions[DROPPED:, 0] for run in runs]
                yield (
                    f'E2.{name}.{scenario}',
                    1e2 * float(np.mean([np.mean(np.abs(angle)) for angle in angles])),
                )
                yield (
                    f'E3.{name}.{scenario}',
                    1e4 * float(np.mean([np.mean(angle**2) for angle in angles])),
                )
