# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Algorithm 1 at 100 Hz: Figure 6 (rows F6), and what Theorem 2 and line 3 need.

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
from sim_pkg.joints import profiles
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.hybrid_angle.continuous import FOUR, K1, K2, MARGIN, rms

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
    profile: profiles.Profile, duration: float, *, start: float = 0.0, quantum: float = 0.0
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


START = 0.3  # angle of the shaft before the run-up [rad]
DECAYS = (0.15, 0.05)  # time constants of the run-down [s]: 1000 and 3000 rad/s^2


def figure_6_values() -> Values:
    """Rows F6, of Figure 6."""
    for name in FOUR:
        resets = 0
        for decay in DECAYS:
            motion = profiles.figure_6(decay)
            _, velocity, angles = samples(motion, 8.0, start=START)
            run = algorithm_1(name, angles)
            error = error_of(run, velocity)
            resets += int(run.resets.sum())
            yield f'F6 RMS e2 [5,6) td={decay:g} {name}', rms(error[rows(5, 6)])
            if decay == DECAYS[0]:
                yield f'F6 RMS e2 [0,2) {name}', rms(error[rows(0, 2)])
                yield f'F6 mean xh2 [4,5) {name}', run.velocity[rows(4, 5)].mean()
        yield f'F6 J2 resets {name}', resets


def stability_values() -> Values:
    """Rows on Theorem 2 and on line 3 of Algorithm 1."""
    _, velocity, angles = samples(profiles.constant(10.0), 6.0)
    converged = error_of(algorithm_1('saw', angles, epsilon=0.0340), velocity)
    yield 'stability saw eps=0.0340 |e2| at 6 s', abs(converged[-1])
    yield 'stability order of line 3: position bias', unpredicted_bias(150.0)


def unpredicted_bias(speed: float) -> float:
    """Return the position error [rad] at `speed` [rad/s] if line 3 compares before predicting.

    Adding T times the observer's own speed to the measurement has the same effect as that line; the
    estimate is then compared with the true angle.
    """
    alone = Alone(form='paper', **FIGURE_6)
    for place in range(600):
        angle = speed * place * PERIOD
        alone.correct(angle + PERIOD * alone.core.velocity)
    return float(wrapped([angle - alone.core.position])[0])
