# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Angle, speed and acceleration and their covariance: what time, a reading and each law do to it.

a' = -a/T + w,  v' = a,  x' = v,       w white jerk
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.constants import ACCELERATION_TIME_CONSTANT
from estimator_pkg.observers.maths.covariance import Covariance
from estimator_pkg.record import record
from estimator_pkg.sensor.noise import OUTLIER_RATIO


@record
class Motion:
    """The motion as the first filter estimates it."""

    angle: float  # x [rad], on the turn of the newest reading
    velocity: float  # v [rad/s]
    acceleration: float  # a [rad/s^2]
    idle: float  # time since the last informative reading [s]


@record
class Coefficients:
    """What follows from the sample time alone."""

    dt: float  # [s]
    half: float  # dt^2/2
    kept: float  # part of the acceleration that is kept
    q11: float  # what white jerk of density 1 adds to P11 within dt: dt^3/3
    q01: float  # to P01: dt^4/8
    q00: float  # to P00: dt^5/20


def set_covariance(
    p: Covariance, p00: float, p01: float, p02: float, p11: float, p12: float, p22: float
) -> None:
    """Set all entries."""
    p.p00, p.p01, p.p02, p.p11, p.p12, p.p22 = p00, p01, p02, p11, p12, p22


def predict(motion: Motion, p: Covariance, density: float, coefficients: Coefficients) -> None:
    """Predict speed, acceleration and covariance one sample on; the angle is left to the caller.

    An acceleration of five standard deviations is kept: a ramp lasts, and fading would be a lag.
    Elsewhere it decays with `ACCELERATION_TIME_CONSTANT`, which makes constant speeds exact.
    """
    a, dt, constant = motion.acceleration, coefficients.dt, ACCELERATION_TIME_CONSTANT
    coefficients.kept = 1.0 if a * a > OUTLIER_RATIO * p.p22 else constant / (constant + dt)
    motion.velocity += a * dt
    motion.acceleration = coefficients.kept * a
    motion.idle += dt
    predict_covariance(p, density, coefficients)


def predict_covariance(p: Covariance, density: float, coefficients: Coefficients) -> None:
    """Predict one sample on; `density` of the jerk [(rad/s^3)^2 s]."""
    dt, half, kept = coefficients.dt, coefficients.half, coefficients.kept
    p01, p02, p12 = p.p01, p.p02, p.p12
    r12 = p12 + dt * p.p22
    r02 = p02 + dt * p12 + half * p.p22
    r01 = p01 + dt * p.p11 + half * p12
    shaken = density * coefficients.q11
    p.p00 = p.p00 + dt * (p01 + r01) + half * (p02 + r02) + density * coefficients.q00
    p.p01 = r01 + dt * r02 + density * coefficients.q01
    p.p02 = kept * r02 + 0.5 * shaken
    p.p11 = p.p11 + dt * (p12 + r12) + shaken
    p.p12 = kept * r12 + density * half
    p.p22 = kept * kept * p.p22 + density * dt


def correct_covariance(p: Covariance, r: float, left: float) -> None:
    """Correct by a measurement: P - f/S P_.0 P_0.

    Parameters
    ----------
    r : variance R of the measurement [rad^2].
    left : part of S = P_00 + R that the measurement leaves open: 1 - f.

    Notes
    -----
    Written so that nothing cancels in the row of the angle, and a variance that rounding would
    make smaller than the angle explains is what the angle explains: after a start it may be 10^20
    times the counts.
    """
    p00, p01, p02 = p.p00, p.p01, p.p02
    s = p00 + r
    kept, part = (r + p00 * left) / s, (1.0 - left) / s
    k1, k2 = kept * p01 / p00, kept * p02 / p00
    p.p11 -= part * p01 * p01
    p.p12 -= part * p01 * p02
    p.p22 -= part * p02 * p02
    if p.p11 < k1 * p01:
        p.p11, p.p12 = k1 * p01, k1 * p02
    if p.p22 < k2 * p02:
        p.p22, p.p12 = k2 * p02, k1 * p02
    p.p00, p.p01, p.p02 = kept * p00, kept * p01, kept * p02


def widen(p: Covariance, growth: float) -> None:
    """Widen to the steady state at exp(growth) times the density, P_ij ~ density^((1+i+j)/6)."""
    w = math.exp(growth / 6.0)
    w2 = w * w
    w3 = w2 * w
    w4 = w2 * w2
    p.p00 *= w
    p.p01 *= w2
    p.p02 *= w3
    p.p11 *= w3
    p.p12 *= w4
    p.p22 = p.p22 * w4 * w


def add_manoeuvre(p: Covariance, d: float, date: float) -> None:
    """Add a manoeuvre that began `date` [s] ago and explains `d` [rad].

    Half of it may be white acceleration (a blow), half white jerk (a motor): were it jerk alone, a
    blow would be overshot by 2.5 times.
    """
    square = d * d
    rate = 1.0 / date
    first = square * rate
    second = first * rate
    third = second * rate
    p.p00 += square
    p.p01 += 2.0 * first
    p.p02 += 5.0 / 3.0 * second
    p.p11 += 29.0 / 6.0 * second
    p.p12 += 5.0 * third
    p.p22 += 10.0 * third * rate


def add_velocity_noise(p: Covariance, half_variance: float, dt: float) -> None:
    """Add a random walk of the speed: 2 `half_variance` [rad^2] / dt^2 a sample, none below 0."""
    if half_variance <= 0.0:
        return
    speed = half_variance / dt
    p.p00 += half_variance / 1.5
    p.p01 += speed
    p.p11 += 2.0 * speed / dt
