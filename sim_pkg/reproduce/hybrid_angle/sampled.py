# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs the sampled forms of the project's own `hybrid_angle` over measured angles.

Only the observer's core runs. The paper has no guard, no restart after a lost lock and no low-speed
bound, which the driver adds to every observer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import Circle, wrap
from estimator_pkg.observers.angle.hybrid import observer as hybrid_angle
from estimator_pkg.observers.angle.hybrid.state import Coefficients, Core
from estimator_pkg.parameters import build
from sim_pkg.joints.profiles import Profile
from sim_pkg.reproduce.hybrid_angle.continuous import K1, K2, MARGIN

Array = NDArray[np.floating[Any]]
Numbers = Sequence[float] | Array

PERIOD = 0.01  # sample time of the paper's experiment [s]
TURN = 2.0 * math.pi
QUANTUM = TURN / 2**14  # of the 14-bit encoder [rad]


# The paper's parameters in its experiment: epsilon in s, M and delta_pi in rad.
FIGURE_6 = {'epsilon': 0.1, 'k1': K1, 'k2': K2, 'M': 1.0, 'delta_pi': MARGIN}


class Run(NamedTuple):
    """Arrays of shape (n,), one row per sample.

    position : rad. velocity : rad/s. resets : True where the observer jumped to the measurement.
    """

    position: Array
    velocity: Array
    resets: NDArray[np.bool_]


class Alone:
    """The core of `hybrid_angle`, begun at a measurement [rad]; what the gains imply.

    Attributes
    ----------
    design, core : records of `hybrid_angle`.
    """

    def __init__(self, measurement: float = 0.0, **gains: Any) -> None:
        self.design = hybrid_angle.design(build(hybrid_angle.Gains, gains), Circle())
        self._coefficients, self.core = Coefficients(), Core()
        self.prepare(PERIOD)
        hybrid_angle.begin(self.core, self.design, measurement)

    def prepare(self, period: float) -> None:
        """Take the next sample after this time [s]."""
        hybrid_angle.prepare(self._coefficients, self.design, period)

    def correct(self, angle: float) -> float:
        """Take a measurement [rad]; return the innovation [rad]."""
        return hybrid_angle.correct(self.core, self._coefficients, self.design, angle)


def algorithm_1(
    injection: str, angles: Numbers, periods: float | Numbers = PERIOD, **gains: float
) -> Run:
    """Run Algorithm 1 (``form: paper``) from (0, 0); its first step predicts over one sample time.

    Parameters
    ----------
    injection : sin, tan, saw or sat.
    angles : measurements in [-pi, pi) [rad], shape (n,).
    periods : T [s], or the time before each sample, shape (n,).
    gains : those that differ from Figure 6: epsilon [s], M, delta_pi [rad].
    """
    return _run(
        angles, periods, start=0.0, form='paper', injection=injection, **{**FIGURE_6, **gains}
    )


def _run(angles: Numbers, periods: float | Numbers, *, start: float | None, **gains: Any) -> Run:
    times = np.broadcast_to(np.asarray(periods, float), (len(angles),)).tolist()
    measured = np.asarray(angles, float).tolist()
    alone = Alone(measured[0] if start is None else start, **gains)
    last, core = PERIOD, alone.core
    positions, velocities, resets = [], [], []
    for place, (angle, period) in enumerate(zip(measured, times)):
        if period != last:
            last = period
            alone.prepare(period)
        innovation = alone.correct(angle) if place or start is not None else 0.0
        positions.append(core.position)
        velocities.append(core.velocity)
        # a reset puts the position exactly at the measurement, in spite of a large innovation
        resets.append(core.position == angle and abs(innovation) > 1e-3)
    return Run(np.array(positions), np.array(velocities), np.array(resets))


def wrapped(angles: Numbers, quantum: float = 0.0) -> Array:
    """Return angles [rad], shape (n,), in [-pi, pi), rounded to multiples of `quantum` if not 0."""
    exact = np.asarray(angles, float)
    if quantum > 0.0:
        exact = quantum * np.round(exact / quantum)
    return np.array([wrap(angle, TURN) for angle in exact.tolist()])


def samples(
    profile: Profile, duration: float, *, start: float = 0.0, quantum: float = 0.0
) -> tuple[Array, Array, Array]:
    """Sample a motion every PERIOD.

    Returns
    -------
    times [s], true velocity [rad/s] and measured angle in [-pi, pi), each of shape (n,).
    """
    time = np.asarray(PERIOD * np.arange(round(duration / PERIOD) + 1), np.float64)
    position, velocity, _ = profile(time)
    return time, velocity, wrapped(position + start, quantum)


def rows(start: float, end: float) -> slice:
    """Return the samples with start <= time < end [s]."""
    return slice(round(start / PERIOD), round(end / PERIOD))


def error_of(run: Run, velocity: Array) -> Array:
    """Return true minus estimated velocity [rad/s], shape (n,)."""
    return velocity - run.velocity
