# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Section 5.2: the robotic leg, three observers, Table 2 (rows C).

Arrays have shape (COUNT, 3): positions [m, rad, rad], velocities [m/s, rad/s, rad/s].
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.runs import METRICS, leg, make, metrics, move, observe, quantise

Array = NDArray[np.float64]

DT, COUNT, DROPPED, SEEDS = 1e-3, 25000, 10000, range(20)
VARIANCE, QUANTA = 0.1, (1.0 / 500.0, 2.0 * math.pi / 256.0, 2.0 * math.pi / 256.0)
START, GUESS = (2.2, 1.8, 0.4), (0.1, 0.2, 0.4)

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    'HGO': ('hgo', {'L': [1.2, 2.0, 2.0], 'K': [3.9, 2.5, 1.3]}),
    'SMO': (
        'smo',
        {
            'variant': 'uniform',
            'k1': [1.0, 0.52, 0.71],
            'k2': [1.0, 1.2, 1.17],
            'mu1': 1.86,
            'mu2': 0.303,
        },
    ),
    'GESO': ('geso', {'L': [0.61, 0.9, 1.9], 'Gamma': [1.74, 4.9, 0.71]}),
}


@lru_cache
def run() -> tuple[Array, Array, Array]:
    """Return (positions, velocities, inputs); the inputs have shape (COUNT, 2) [N, N m]."""
    time = DT * np.arange(COUNT)
    inputs = np.column_stack([0.0535 * np.cos(10.0 * time), 0.067 * np.sin(10.0 * time)])
    return *move(leg(), START, (0.0,) * 3, inputs, DT, 1), inputs


def measured(seed: int) -> Array:
    """Return the positions of `run`, noisy, then quantised."""
    noise = np.random.default_rng(seed).standard_normal((COUNT, 3)) * math.sqrt(VARIANCE)
    return quantise(run()[0] + noise, QUANTA)


def estimate(name: str, readings: Array) -> Array:
    """Return velocities from readings; the estimate starts at GUESS, at rest."""
    observer, gains = CASES[name]
    functions = make(observer, 'robotic_leg', {'margin': 1e-9}, **gains)
    return observe(functions, readings, run()[2], DT, start=GUESS)


def values() -> Values:
    """Rows C."""
    v, readings = run()[1][:, None], np.stack([measured(seed) for seed in SEEDS], axis=1)
    for name in CASES:
        errors = (estimate(name, readings) - v)[DROPPED:]
        found = np.median(metrics(errors), axis=0)
        for metric, value in zip(METRICS, found):
            yield f'C3.{name}.{metric}', value
