# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The covariance of angle, speed and acceleration: what time, a reading and each law do to it.

    a' = -a/fade + w,  v' = a,  x' = v,       w white jerk

A covariance is (P00, P01, P02, P11, P12, P22), the angle first.
"""

from __future__ import annotations

import math

Covariance = tuple[float, float, float, float, float, float]


def jerk_density(variance: float, within: float) -> float:
    """Return the density of white jerk [(rad/s^3)^2 s] that moves the angle by `variance` [rad^2].

    `within` that time [s] a density c makes c within^5/20. No power: compiled, it may differ.
    """
    square = within * within
    return 20.0 * variance / (square * square * within)


def predicted(p: Covariance, density: float, coefficients: tuple) -> Covariance:
    """Return the covariance one sample later.

    Parameters
    ----------
    density : of the jerk [(rad/s^3)^2 s].
    coefficients : (dt, dt^2/2, part of the acceleration kept, q11, q01, q00), q being what white
        jerk of density 1 adds within dt. q02 is half of q11, q12 is dt^2/2, q22 is dt.
    """
    p00, p01, p02, p11, p12, p22 = p
    dt, half, kept, q11, q01, q00 = coefficients
    r12 = p12 + dt * p22
    r02 = p02 + dt * p12 + half * p22
    r01 = p01 + dt * p11 + half * p12
    shaken = density * q11
    return (
        p00 + dt * (p01 + r01) + half * (p02 + r02) + density * q00,
        r01 + dt * r02 + density * q01,
        kept * r02 + 0.5 * shaken,
        p11 + dt * (p12 + r12) + shaken,
        kept * r12 + density * half,
        kept * kept * p22 + density * dt,
    )


def corrected(p: Covariance, r: float, left: float) -> Covariance:
    """Return the covariance after a measurement.

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
    p00, p01, p02, p11, p12, p22 = p  # P - f/S P_.0 P_0.
    s = p00 + r
    kept, part = (r + p00 * left) / s, (1.0 - left) / s
    k1, k2 = kept * p01 / p00, kept * p02 / p00
    p11 -= part * p01 * p01
    p12 -= part * p01 * p02
    p22 -= part * p02 * p02
    if p11 < k1 * p01:
        p11, p12 = k1 * p01, k1 * p02
    if p22 < k2 * p02:
        p22, p12 = k2 * p02, k1 * p02
    return (kept * p00, kept * p01, kept * p02, p11, p12, p22)


def widened(p: Covariance, growth: float) -> Covariance:
    """Return the covariance of the steady state at exp(growth) times the density."""
    w = math.exp(growth / 6.0)
    w2 = w * w
    w3 = w2 * w
    w4 = w2 * w2
    p00, p01, p02, p11, p12, p22 = p  # P_ij ~ density^((1 + i + j)/6)
    return (p00 * w, p01 * w2, p02 * w3, p11 * w3, p12 * w4, p22 * w4 * w)


def manoeuvred(p: Covariance, d: float, date: float) -> Covariance:
    """Return the covariance with a manoeuvre that began `date` [s] ago and explains `d` [rad].

    Half of it may be white acceleration (a blow), half white jerk (a motor): were it jerk alone, a
    blow would be overshot by 2.5 times.
    """
    square = d * d
    rate = 1.0 / date
    first = square * rate
    second = first * rate
    third = second * rate
    p00, p01, p02, p11, p12, p22 = p
    return (
        p00 + square,
        p01 + 2.0 * first,
        p02 + 5.0 / 3.0 * second,
        p11 + 29.0 / 6.0 * second,
        p12 + 5.0 * third,
        p22 + 10.0 * third * rate,
    )


def swayed(p: Covariance, sway: float, dt: float) -> Covariance:
    """Return the covariance with a speed that goes at random.

    It does so by 2 `sway` [rad^2] / dt^2 in a sample; not at all where that is not above 0.
    """
    if sway <= 0.0:
        return p
    p00, p01, p02, p11, p12, p22 = p
    speed = sway / dt
    return (p00 + sway / 1.5, p01 + speed, p02, p11 + 2.0 * speed / dt, p12, p22)
