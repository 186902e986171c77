# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Section 5.1: the normalised cart-pendulum, three observers, Table 1 (rows B); fast (rows H2).

Arrays have shape (COUNT, 2), pendulum and cart: positions [rad, m], velocities [rad/s, m/s].
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.runs import (
    OF_FIRST,
    cart_of,
    make,
    metrics,
    move,
    normalised,
    observe,
    quantise,
)

Array = NDArray[np.float64]

DT, COUNT, DROPPED, SEEDS = 1e-3, 15000, 1500, range(20)
NOISE, QUANTA = 0.01, (2.0 * math.pi / 256.0, 1.0 / 500.0)
START, SPEED = (0.5 * math.pi - 0.2, -0.1), (0.4, 0.35)


class Case(NamedTuple):
    """An observer of the table; Euler steps per sample."""

    observer: str
    gains: dict[str, Any]
    parts: int = 1


CASES = {
    'GESO': Case('geso', {'L': [10.0], 'Gamma': [70.0]}),
    'SMO': Case('smo', {'mu': [2.2, 4.0]}),
    'HGO': Case('hgo', {'L': [75.0], 'K': [1250.0]}),
    'HGOprinted': Case('hgo', {'h': [3e-2, 2e-4], 'epsilon': 0.01}),
    'HGO@10,70': Case('hgo', {'L': [10.0], 'K': [70.0]}),
    'HGOsub10': Case('hgo', {'L': [75.0], 'K': [1250.0]}, 10),
}


@lru_cache
def truth() -> tuple[Array, Array]:
    """Return (positions, velocities) of the free motion."""
    return move(normalised(), START, SPEED, np.zeros((COUNT, 1)), DT, 4)


def measured(seed: int) -> Array:
    """Return the positions of `truth`, noisy, then quantised."""
    noise = np.random.default_rng(seed).standard_normal((COUNT, 2)) * NOISE
    return quantise(truth()[0] + noise, QUANTA)


def estimate(name: str, readings: Array) -> Array:
    """Return velocities from readings; the estimate starts at the true position, at rest."""
    case = CASES[name]
    functions = make(case.observer, 'cart_pendulum', cart_of(), **case.gains)
    return observe(functions, readings, np.zeros((COUNT, 1)), DT, start=START, parts=case.parts)


def settling(error: Array) -> float:
    """Return the time after which |error|, shape (n,), stays below 5 % of its start [s]."""
    outside = np.flatnonzero(np.abs(error) > 0.05 * abs(error[0]))
    return DT * float(outside[-1] + 1)


def values() -> Values:
    """Rows B."""
    q, v = truth()
    for k in (1000, 14999):
        for joint in (0, 1):
            yield f'B1.{k}.q{joint + 1}', q[k, joint]
            yield f'B1.{k}.dq{joint + 1}', v[k, joint]
    for name, case in CASES.items():
        error = (estimate(name, q) - v)[:, 0]
        if case.observer != 'smo' and case.parts == 1:
            yield f'B2.{name}', error[200]
        yield f'B3.{name}', settling(error)
        found = np.mean(
            [metrics((estimate(name, measured(seed)) - v)[DROPPED:]) for seed in SEEDS], axis=0
        )
        for metric, value in zip(OF_FIRST, found):
            yield f'B4.{name}.{metric}', value


# Fast, strongly coupled motion: the error of GESO is linear at any speed; that of the others
# contains products of velocities.

COUPLING = 0.9
FAST_DT, FAST_COUNT = 1e-4, 60001
WINDOW = slice(40000, 60000)  # 4 to 6 s
SPEEDS = (10.0, 40.0)  # rad/s, of the pendulum at the start
FAST_CASES = {
    'GESO 10,70': CASES['GESO'],
    'HGO 10,70': CASES['HGO@10,70'],
    'HGO 75,1250': CASES['HGO'],
    'SMO 2.2,4': CASES['SMO'],
}


def fast_error(case: Case, speed: float) -> float:
    """Rms of |velocity error| over the window, without noise."""
    inputs = np.zeros((FAST_COUNT, 1))
    q, v = move(normalised(COUPLING), START, (speed, SPEED[1]), inputs, FAST_DT, 4)
    functions = make(case.observer, 'cart_pendulum', cart_of(COUPLING), **case.gains)
    velocities = observe(functions, q, inputs, FAST_DT, start=START)
    return math.sqrt(float(np.mean(np.sum((velocities - v)[WINDOW] ** 2, axis=1))))


def fast_values() -> Values:
    """Rows H2."""
    for speed in SPEEDS:
        for name, case in FAST_CASES.items():
            yield f'H2.{speed:g}.{name}', fast_error(case, speed)
