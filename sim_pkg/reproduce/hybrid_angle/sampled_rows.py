# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of Algorithm 1 at 100 Hz: Figure 6, and what Theorem 2 and line 3 need."""

from __future__ import annotations

from sim_pkg.joints import profiles
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.hybrid_angle.continuous import FOUR, rms
from sim_pkg.reproduce.hybrid_angle.sampled import (
    FIGURE_6,
    PERIOD,
    Alone,
    algorithm_1,
    error_of,
    rows,
    samples,
    wrapped,
)

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
