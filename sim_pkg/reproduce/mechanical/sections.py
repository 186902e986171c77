# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sections 5.1 and 5.2: observers on simulated mechanisms, Tables 1 and 2 (rows B and C).

Arrays have shape (count, n): positions and velocities [rad and rad/s, or m and m/s].
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from estimator_pkg.models.load import load
from estimator_pkg.models.mechanics import Array
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.runs import (
    METRICS,
    Case,
    assigned,
    make,
    metrics,
    move,
    observe,
    quantise,
)

DT = 1e-3  # [s]
SEEDS = range(20)
COUNTS = 2.0 * math.pi / 256.0  # quanta of the angles [rad] ...
LINES = 1.0 / 500.0  # ... and of the positions [m]


@dataclass(frozen=True, eq=False)
class Section:
    """A simulated motion, measured with noise and quanta, and the observers of it.

    Attributes
    ----------
    rows : what the ids of the rows begin with.
    model, numbers : the mechanism. start, speed : of its motion. known : positions that the
        estimates start at.
    count, dropped : samples, and those at the start that are not evaluated.
    inputs : times [s], shape (count,) -> inputs, shape (count, m).
    mean : how the errors of all random seeds are summarised.
    """

    rows: str
    model: str
    numbers: dict[str, float]
    count: int
    dropped: int
    noise: float
    quanta: tuple[float, ...]
    start: tuple[float, ...]
    speed: tuple[float, ...]
    known: tuple[float, ...]
    inputs: Callable[[Array], Array]
    cases: dict[str, Case]
    mean: Callable[..., Any]

    @property
    def time(self) -> Array:
        """Times of the samples [s], shape (count,)."""
        return np.asarray(DT * np.arange(self.count), np.float64)

    def truth(self) -> tuple[Array, Array]:
        """Return (positions, velocities)."""
        return _truth(self)

    def measured(self, seed: int) -> Array:
        """Return the positions, noisy, then quantised."""
        noise = np.random.default_rng(seed).standard_normal((self.count, len(self.start)))
        return quantise(self.truth()[0] + self.noise * noise, self.quanta)

    def estimate(self, name: str, readings: Array) -> Array:
        """Return velocities from readings; the estimate starts at `known`, at rest."""
        observer = make(self.cases[name], self.model, self.numbers)
        return observe(observer, readings, self.inputs(self.time), DT, start=self.known)

    def values(self) -> Values:
        """Return the rows: errors of each observer over the random seeds."""
        velocities = self.truth()[1][:, None]
        readings = np.stack([self.measured(seed) for seed in SEEDS], axis=1)
        for name in self.cases:
            errors = (self.estimate(name, readings) - velocities)[self.dropped :]
            for metric, value in zip(METRICS, self.mean(metrics(errors), axis=0)):
                yield f'{self.rows}.{name}.{metric}', value


@lru_cache
def _truth(section: Section) -> tuple[Array, Array]:
    mechanics = load(section.model, assigned(section.numbers))
    inputs = section.inputs(section.time)
    return move(mechanics, section.start, section.speed, inputs, DT, 1)


CART = Section(
    rows='B4',
    model='cart_pendulum',  # normalised: a = m = 1
    numbers={'pendulum_inertia': 1.0, 'pendulum_moment': 0.1, 'moving_mass': 1.0, 'gravity': 1.0},
    count=15_000,
    dropped=1500,
    noise=0.01,
    quanta=(COUNTS, LINES),
    start=(0.5 * math.pi - 0.2, -0.1),
    speed=(0.4, 0.35),
    known=(0.5 * math.pi - 0.2, -0.1),
    inputs=lambda time: np.zeros((len(time), 1)),
    cases={
        'GESO': ('geso', {'L': [10.0], 'Gamma': [70.0]}),
        'SMO': ('smo', {'mu': [2.2, 4.0]}),
        'HGO': ('hgo', {'L': [75.0], 'K': [1250.0]}),
        'HGOprinted': ('hgo', {'h': [3e-2, 2e-4], 'epsilon': 0.01}),
    },
    mean=np.mean,
)
UNIFORM = {'k1': [1.0, 0.52, 0.71], 'k2': [1.0, 1.2, 1.17], 'mu1': 1.86, 'mu2': 0.303}
LEG = Section(
    rows='C3',
    model='robotic_leg',
    numbers={'margin': 1e-9},  # without the guard of its domain
    count=25_000,
    dropped=10_000,
    noise=math.sqrt(0.1),
    quanta=(LINES, COUNTS, COUNTS),
    start=(2.2, 1.8, 0.4),
    speed=(0.0,) * 3,
    known=(0.1, 0.2, 0.4),
    inputs=lambda time: np.column_stack(
        [0.0535 * np.cos(10.0 * time), 0.067 * np.sin(10.0 * time)]
    ),
    cases={
        'HGO': ('hgo', {'L': [1.2, 2.0, 2.0], 'K': [3.9, 2.5, 1.3]}),
        'SMO': ('smo', {'variant': 'uniform', **UNIFORM}),
        'GESO': ('geso', {'L': [0.61, 0.9, 1.9], 'Gamma': [1.74, 4.9, 0.71]}),
    },
    mean=np.median,
)
