# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part speed``: one sample of GESO for two positions, in the exact form.

The motion is that of a cart-pendulum under a force, at 1 kHz with jitter, so the coefficients are
computed anew at every sample. In plain Python it runs with the built-in model and with a user's
numpy model of the same mechanism; by the engine with the built-in one.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Side, best_and_median, interleave, not_run, row
from estimator_pkg import observers
from estimator_pkg.driver.efforts import EFFORT_FIELD
from estimator_pkg.driver.mechanism import Mechanism, MechanismSettings

Array = NDArray[np.float64]

STEPS = 2000  # per round, in plain Python
ENGINE_STEPS = 300_000
PLAIN_LIMIT = 15.0  # us
NUMPY_LIMIT = 200.0  # us
ENGINE_LIMIT = 3.0  # million samples/s
BUILT_IN = 'cart_pendulum'
NUMPY = f'{__name__}:NumpyCartPendulum'


class NumpyCartPendulum:
    """The cart-pendulum as a user's model of a mechanism (docs/known_inputs.md)."""

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


def _samples(count: int) -> tuple[NDArray[np.int64], Array, Array]:
    """Return (stamps [ns], readings, shape (N, 2), force, shape (N, 1))."""
    random = np.random.default_rng(1)
    stamps = 10**12 + np.cumsum(np.round(1e6 * random.uniform(0.6, 1.4, count))).astype(np.int64)
    phase = (stamps - stamps[0]) * 1e-9
    readings = np.column_stack([0.4 * np.sin(6.0 * phase), 0.1 * np.sin(4.0 * phase)])
    return stamps, readings, np.sin(4.0 * phase)[:, None]


def mechanisms(rounds: int = 7) -> list[dict[str, Any]]:
    """Return rows: updates in plain Python [us], and the engine's samples [million/s]."""
    stamps, readings, force = _samples((rounds + 1) * STEPS)
    rows_of = list(zip(stamps.tolist(), readings.tolist(), force.tolist()))

    def side(model: str) -> Side:
        joint = mechanism(model)
        joint.compiled = joint.memory = None  # plain, from here on
        joint.set_gains(joint.gains)
        joint.reset()

        def timed(number: int) -> float:
            begun = time.thread_time()
            for sample in rows_of[number * STEPS : (number + 1) * STEPS]:
                joint.update(*sample)
                joint.estimate()
            return (time.thread_time() - begun) / STEPS

        return timed

    limits = {'built-in model': PLAIN_LIMIT, "a user's numpy model": NUMPY_LIMIT}
    times = interleave(dict(zip(limits, (side(BUILT_IN), side(NUMPY)))), rounds)
    rows = []
    for name, limit in limits.items():
        least, median = (1e6 * each for each in best_and_median(times[name]))
        title = f'geso, 2 positions, update, {name}'
        rows.append(row(title, least, 'us', limit=limit, median=median))
    title, joint = "geso, 2 positions, the engine's samples", mechanism(BUILT_IN)
    if joint.compiled is None:
        return [*rows, not_run(title, 'the engine was not built: install a C compiler')]
    least, median = (1e-6 / each for each in best_and_median(_engine_times(joint, rounds)))
    unit = 'million samples/s'
    return [*rows, row(title, least, unit, limit=ENGINE_LIMIT, at_least=True, median=median)]


def mechanism(model: str) -> Mechanism:
    """Return geso on this model."""
    record = observers.find('geso')
    return Mechanism(
        'mechanism', record, record.gains(model=model), MechanismSettings(), EFFORT_FIELD
    )


def _engine_times(joint: Mechanism, rounds: int) -> list[float]:
    """Return the seconds per sample of each round: guard, step and estimate."""
    stamps, readings, force = _samples(ENGINE_STEPS)
    found = []
    for _ in range(rounds + 1):
        joint.reset()
        begun = time.thread_time()
        joint.run(stamps, readings, force)
        found.append((time.thread_time() - begun) / ENGINE_STEPS)
    return found[1:]
