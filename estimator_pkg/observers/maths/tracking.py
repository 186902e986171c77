# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Tracking loops with fixed gains: pole matching and noise variances.

One sample of these loops, with the prediction x + v dt (+ a dt^2/2) and the innovation e:

    x = prediction + alpha e,   v += beta/dt e,   a += gamma/dt^2 e
"""

from __future__ import annotations

import math


def bandwidth_ratio(damping: float) -> float:
    """Return the -3 dB frequency of w0^2/(s^2 + 2 damping w0 s + w0^2), over w0."""
    middle = 1.0 - 2.0 * damping * damping
    root = math.hypot(middle, 1.0)
    # the root of u^2 - 2 middle u - 1 that is positive, without a difference of large numbers
    return math.sqrt(middle + root if middle > 0.0 else 1.0 / (root - middle))


def natural_frequency(bandwidth_hz: float, damping: float) -> float:
    """Return w0 [rad/s] of the filter in `bandwidth_ratio` with -3 dB at `bandwidth_hz` [Hz]."""
    return 2.0 * math.pi * bandwidth_hz / bandwidth_ratio(damping)


def matched(decay: float, discriminant: float, dt: float) -> tuple[float, float]:
    """Return (alpha, beta) with poles exp(p dt), where p = -decay +- sqrt(discriminant).

    alpha = 1 - z1 z2 and beta = (1 - z1)(1 - z2), written so that a slow loop at a high rate loses
    no digits in differences of nearly equal numbers.

    Parameters
    ----------
    decay : [1/s], positive.
    discriminant : [1/s^2]; negative for a complex pair. Less than decay^2.
    dt : sample time [s].
    """
    alpha = -math.expm1(-2.0 * decay * dt)
    if discriminant < 0.0:
        size = math.exp(-decay * dt)
        half = math.sin(0.5 * math.sqrt(-discriminant) * dt)
        return alpha, (1.0 - size) * (1.0 - size) + 4.0 * size * half * half
    root = math.sqrt(discriminant)
    return alpha, math.expm1((root - decay) * dt) * math.expm1(-(root + decay) * dt)


def noise_of_two(alpha: float, beta: float, dt: float) -> tuple[float, float, float]:
    """Return variances of position, velocity [1/s^2] and innovation per unit variance of noise.

    The noise is white. They solve P = A P A' + K K' with A = (1 - K C) F, for x and v.
    """
    scale = 1.0 / (alpha * (4.0 - 2.0 * alpha - beta))
    return (
        (2.0 * alpha * alpha + 2.0 * beta - 3.0 * alpha * beta) * scale,
        2.0 * beta * beta * scale / (dt * dt),
        (4.0 * alpha + 2.0 * beta) * scale,
    )


def noise_of_three(
    alpha: float, beta: float, gamma: float, dt: float
) -> tuple[float, float, float]:
    """Return the variances as `noise_of_two` does, for x, v and a."""
    scale = 1.0 / ((4.0 - 2.0 * alpha - beta) * (2.0 * alpha * beta + alpha * gamma - 2.0 * gamma))
    position = (
        4.0 * alpha * alpha * beta
        + 2.0 * alpha * alpha * gamma
        - 6.0 * alpha * beta * beta
        + alpha * beta * gamma
        - 4.0 * alpha * gamma
        + 4.0 * beta * beta
    )
    velocity = 2.0 * (2.0 * beta * beta * (beta - gamma) + (2.0 - alpha) * gamma * gamma)
    innovation = 2.0 * (
        4.0 * alpha * beta + 2.0 * alpha * gamma + 2.0 * beta * beta + beta * gamma - 4.0 * gamma
    )
    return position * scale, velocity * scale / (dt * dt), innovation * scale
