# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Algorithm 1 at 100 Hz: Figure 6 (rows F6), and Theorem 2.

Only the observer's core runs. The paper has no guard, no restart after a lost lock and no low-speed
bound, which the driver adds to every observer.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import Circle, wrap
from estimator_pkg.observers.angle.hybrid.design import Coefficients, Core
from estimator_pkg.observers.angle.hybrid.observer import Gains, HybridAngle
from estimator_pkg.parameters import build
from sim_pkg.joints import profiles
from sim_pkg.reproduce.contract import Values, rms
from sim_pkg.reproduce.hybrid_angle.continuous import FOUR, K1, K2, MARGIN

Array = NDArray[np.floating[Any]]

PERIOD = 0.01  # sample time of the paper's experiment [s]
TURN = 2.0 * math.pi
# The paper's parameters in its experiment: epsilon in s, M and delta_pi in rad.
FIGURE_6 = {'epsilon': 0.1, 'k1': K1, 'k2': K2, 'M': 1.0, 'delta_pi': MARGIN}


def algorithm_1(injection: str, angles: Array, **gains: float) -> Array:
    """Run Algorithm 1 (``form: paper``) from (0, 0); return its velocity [rad/s], shape (n,).

    Its first step predicts over one sample time.

    Parameters
    ----------
    injection : sin, tan, saw or sat.
    angles : measurements in [-pi, pi) [rad], shape (n,), every PERIOD.
    gains : those that differ from Figure 6: epsilon [s], M, delta_pi [rad].
    """
    values = {'form': 'paper', 'injection': injection, **FIGURE_6, **gains}
    design = HybridAngle.design(build(Gains, values), Circle())
    core, coefficients = Core(), Coefficients()
    HybridAngle.prepare(coefficients, design, PERIOD)
    HybridAngle.begin(core, design, 0.0)
    velocities = []
    for angle in angles.tolist():
        HybridAngle.correct(core, coefficients, design, angle)
        velocities.append(core.velocity)
    return np.array(velocities)


def wrapped(angles: Array) -> Array:
    """Return angles [rad], shape (n,), in [-pi, pi)."""
    return np.array([wrap(angle, TURN) for angle in angles.tolist()])


def samples(
    profile: profiles.Profile, duration: float, start: float = 0.0
) -> tuple[Array, Array, Array]:
    """Sample a motion every PERIOD.

    Returns
    -------
    times [s], true velocity [rad/s] and measured angle in [-pi, pi), each of shape (n,).
    """
    time = np.asarray(PERIOD * np.arange(round(duration / PERIOD) + 1), np.float64)
    position, velocity, _ = profile(time)
    return time, velocity, wrapped(position + start)


def rows(start: float, end: float) -> slice:
    """Return the samples with start <= time < end [s]."""
    return slice(round(start / PERIOD), round(end / PERIOD))


START = 0.3  # angle of the shaft before the run-up [rad]
DECAY = 0.05  # time constant of the run-down [s]: 3000 rad/s^2


def figure_6_values() -> Values:
    """Rows F6, of Figure 6."""
    _, velocity, angles = samples(profiles.figure_6(DECAY), 8.0, START)
    for name in FOUR:
        found = algorithm_1(name, angles)
        error = velocity - found
        yield f'F6 RMS e2 [0,2) {name}', rms(error[rows(0, 2)])
        yield f'F6 mean xh2 [4,5) {name}', found[rows(4, 5)].mean()
        yield f'F6 RMS e2 [5,6) td={DECAY:g} {name}', rms(error[rows(5, 6)])


def stability_values() -> Values:
    """The row on Theorem 2."""
    _, velocity, angles = samples(profiles.constant(10.0), 6.0)
    found = algorithm_1('saw', angles, epsilon=0.0340)
    yield 'stability saw eps=0.0340 |e2| at 6 s', abs(velocity[-1] - found[-1])
