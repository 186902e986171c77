# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Section 5.1: the normalised cart-pendulum, three observers, Table 1 (rows B).

Arrays have shape (COUNT, 2), pendulum and cart: positions [rad, m], velocities [rad/s, m/s].
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

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


CASES: dict[str, tuple[str, dict[str, Any]]] = {
    'GESO': ('geso', {'L': [10.0], 'Gamma': [70.0]}),
    'SMO': ('smo', {'mu': [2.2, 4.0]}),
    'HGO': ('hgo', {'L': [75.0], 'K': [1250.0]}),
    'HGOprinted': ('hgo', {'h': [3e-2, 2e-4], 'epsilon': 0.01}),
}


@lru_cache
def truth() -> tuple[Array, Array]:
    """Return (positions, velocities) of the free motion."""
    return move(normalised(), START, SPEED, np.zeros((COUNT, 1)), DT, 1)


def measured(seed: int) -> Array:
    """Return the positions of `truth`, noisy, then quantised."""
    noise = np.random.default_rng(seed).standard_normal((COUNT, 2)) * NOISE
    return quantise(truth()[0] + noise, QUANTA)


def estimate(name: str, readings: Array) -> Array:
    """Return velocities from readings; the estimate starts at the true position, at rest."""
    observer, gains = CASES[name]
    functions = make(observer, 'cart_pendulum', cart_of(), **gains)
    return observe(functions, readings, np.zeros((COUNT, 1)), DT, start=START)


def values() -> Values:
    """Rows B."""
    v, readings = truth()[1][:, None], np.stack([measured(seed) for seed in SEEDS], axis=1)
    for name in CASES:
        errors = (estimate(name, readings) - v)[DROPPED:]
        found = np.mean(metrics(errors), axis=0)
        for metric, value in zip(OF_FIRST, found):
            yield f'B4.{name}.{metric}', value
