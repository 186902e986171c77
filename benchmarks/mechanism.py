# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``bench speed --part mechanism``: one sample of GESO for two positions, in the exact form.

The motion is that of a cart-pendulum under a force, at 1 kHz with jitter, so the coefficients are
computed anew at every sample. In plain Python it runs with the built-in model and with a user's
numpy model of the same mechanism; compiled with the built-in one.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers
from estimator_pkg.driver.compiled import available, compiled
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.evaluation.compare.timing import best_and_median, interleave, not_run, row
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.mechanism.core import MechanicalFunctions
from estimator_pkg.observers.mechanism.motion import put_row
from estimator_pkg.optional import needs

Array = NDArray[np.float64]

STEPS = 2000  # per round, in plain Python
COMPILED_STEPS = 300_000
PLAIN_LIMIT = 15.0  # us
NUMPY_LIMIT = 200.0  # us
COMPILED_LIMIT = 3.0  # million steps/s
BUILT_IN = 'cart_pendulum'
NUMPY = f'{__name__}:NumpyCartPendulum'


class NumpyCartPendulum:
    """The cart-pendulum as a user's model of a mechanism (docs/own_model.md)."""

    joints = ('pendulum', 'cart')
    periods = (2.0 * np.pi, 0.0)
    reach = (np.pi, 1.0)
    actuated = (1,)

    def inertia(self, q: Array) -> Array:
        """Return M(q)."""
        coupling = 0.105 * np.cos(q[0])
        return np.array([[0.0484, coupling], [coupling, 1.15]])

    def gradient(self, q: Array) -> Array:
        """Return dV/dq."""
        return np.array([-1.03 * np.sin(q[0]), 0.0])

    def inputs(self, q: Array) -> Array:
        """Return G(q)."""
        return np.array([[0.0], [1.0]])


def _functions(model: str) -> MechanicalFunctions:
    record = observers.find('geso')
    functions = record.build(record.gains(model=model), Circle())
    assert isinstance(functions, MechanicalFunctions)
    return functions


def _samples(count: int) -> tuple[NDArray[np.int64], Array, Array]:
    """Return (stamps [ns], readings, shape (N, 2), force, shape (N, 1))."""
    random = np.random.default_rng(1)
    stamps = 10**12 + np.cumsum(np.round(1e6 * random.uniform(0.6, 1.4, count))).astype(np.int64)
    phase = (stamps - stamps[0]) * 1e-9
    readings = np.column_stack([0.4 * np.sin(6.0 * phase), 0.1 * np.sin(4.0 * phase)])
    return stamps, readings, np.sin(4.0 * phase)[:, None]


def mechanisms(rounds: int = 7) -> list[dict[str, Any]]:
    """Return rows: steps and updates [us], compiled steps [million/s]."""
    stamps, readings, force = _samples((rounds + 1) * STEPS)
    rows_of = [tuple(each) for each in readings.tolist()], [tuple(each) for each in force.tolist()]
    steps = np.diff(stamps, prepend=stamps[0] - 10**6) * 1e-9

    def step_side(model: str) -> Any:
        functions = _functions(model)
        design = functions.design()
        prepare, step, output = functions.prepare, functions.step, functions.output

        def side(number: int) -> float:
            part = range(number * STEPS, (number + 1) * STEPS)
            state = functions.init(rows_of[0][part[0]], design)
            begun = time.thread_time()
            for k in part:
                coefficients = prepare(design, float(steps[k]))
                state = step(state, coefficients, design, rows_of[0][k], rows_of[1][k])
                output(state, coefficients, design, rows_of[0][k], rows_of[1][k])
            return (time.thread_time() - begun) / STEPS

        return side

    def update_side(model: str) -> Any:
        record = observers.find('geso')
        joint = Joint(record, record.gains(model=model), JointSettings())
        whole = stamps.tolist()

        def side(number: int) -> float:
            begun = time.thread_time()
            for k in range(number * STEPS, (number + 1) * STEPS):
                joint.update(whole[k], rows_of[0][k], rows_of[1][k])
                joint.estimate()
            return (time.thread_time() - begun) / STEPS

        return side

    sides = {
        'step, built-in model': step_side(BUILT_IN),
        'update with guard, built-in model': update_side(BUILT_IN),
        "step, a user's numpy model": step_side(NUMPY),
    }
    limits = dict(zip(sides, (PLAIN_LIMIT, PLAIN_LIMIT, NUMPY_LIMIT)))
    times = interleave(sides, rounds)
    rows = []
    for name, limit in limits.items():
        least, median = best_and_median(times[name])
        rows.append(
            row(f'geso, 2 positions, {name}', least * 1e6, 'us', limit=limit, median=median * 1e6)
        )
    name = 'geso, 2 positions, compiled steps'
    if not available():
        return [*rows, not_run(name, needs('numba'))]
    least, median = best_and_median(_compiled_times(rounds))
    return [
        *rows,
        row(
            name,
            1e-6 / least,
            'million steps/s',
            limit=COMPILED_LIMIT,
            at_least=True,
            median=1e-6 / median,
        ),
    ]


def _compiled_times(rounds: int) -> list[float]:
    """Return the seconds per step of each round."""
    functions = _functions(BUILT_IN)
    prepare, step, output = functions.prepare, functions.step, functions.output
    put = put_row(2)

    def walk(state: tuple, design: tuple, steps: Any, readings: Any, force: Any, out: Any) -> tuple:
        for k in range(len(steps)):
            coefficients = prepare(design, steps[k])
            measurement = (readings[k, 0], readings[k, 1])
            u = (force[k, 0],)
            state = step(state, coefficients, design, measurement, u)
            velocity = output(state, coefficients, design, measurement, u)[1]
            put(out, k, velocity)
        return state

    stamps, readings, force = _samples(COMPILED_STEPS)
    steps = np.diff(stamps, prepend=stamps[0] - 10**6) * 1e-9
    design, out = functions.design(), np.zeros_like(readings)
    start = functions.init((float(readings[0, 0]), float(readings[0, 1])), design)
    twin = compiled(walk)
    twin(start, design, steps[:10], readings[:10], force[:10], out[:10])  # compiles
    found = []
    for _ in range(rounds + 1):
        begun = time.thread_time()
        twin(start, design, steps, readings, force, out)
        found.append((time.thread_time() - begun) / COMPILED_STEPS)
    return found[1:]
