# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Covariances of position, velocity and acceleration, unrolled, in units of the noise variance.

P/R is symmetric and stored as its upper triangle, row by row: 3 numbers for (x, v), 6 for
(x, v, a).

    P- = F P F' + Q,   S = H P- H' + 1,   K = P- H'/S,   P = P- - K H P-,   H = (1, 0[, 0])

With R = 1 the first row of P after a measurement *is* the Kalman gain K. The update multiplies that
row by 1/S instead of subtracting from it, so nothing cancels there. The other entries lose digits
only where a measurement removes nearly all of an uncertainty; a closed form replaces that case.
White process noise keeps P regular, so the recursion runs for hours without a Joseph form.
"""

from __future__ import annotations

import math

# Prior variance of the acceleration at a start, in noise variances / dt^4. Three samples determine
# it to 6 of these, so from the fourth sample on the prior has no influence.
VAGUE = 1e4

# If a measurement reduces the speed's variance below this part, the difference has few digits left.
# The state was unknown then: P is that of a start. A measurement without noise reduces the
# position's variance as far, but leaves a part of the speed's that the process noise has added.
BLIND = 1e-9


def of_noise_2(density: float, dt: float) -> tuple[float, float, float]:
    """Return Q of white acceleration of this `density` (per noise variance) over dt [s]."""
    return (density * dt * dt * dt / 3.0, density * dt * dt / 2.0, density * dt)


def of_noise_3(density: float, dt: float) -> tuple[float, float, float, float, float, float]:
    """Return Q of white jerk of this `density` (per noise variance) over dt [s]."""
    square = dt * dt
    return (
        density * square * square * dt / 20.0,
        density * square * square / 8.0,
        density * square * dt / 6.0,
        density * square * dt / 3.0,
        density * square / 2.0,
        density * dt,
    )


def start_2(dt: float) -> tuple[float, float, float]:
    """Return P after two samples that are dt [s] apart: a straight line through both."""
    return (1.0, 1.0 / dt, 2.0 / (dt * dt))


def start_3(dt: float) -> tuple[float, float, float, float, float, float]:
    """Return P for (x, v, a) after two samples, with the vague prior of the acceleration."""
    square = dt * dt
    return (
        1.0,
        1.0 / dt,
        0.0,
        (2.0 + 0.25 * VAGUE) / square,
        0.5 * VAGUE / (square * dt),
        VAGUE / (square * square),
    )


def step_2(
    p: tuple[float, float, float], dt: float, scale: float, added: tuple[float, float, float]
) -> tuple[tuple[float, float, float], float, float]:
    """Return (P, K1, 1/S) after a prediction over dt [s] and an update; K is the first row of P.

    Parameters
    ----------
    scale : factor of `added`.
    added : process noise over dt, from `of_noise_2`.
    """
    p00, p01, p11 = p
    q00, q01, q11 = added
    n01 = p01 + dt * p11  # n: P- = F P F' + Q
    n00 = p00 + dt * (p01 + n01) + scale * q00
    n01 += scale * q01
    n11 = p11 + scale * q11
    of_s = 1.0 / (1.0 + n00)  # 1/S = 1 - K0
    K1 = n01 * of_s
    left = n11 - K1 * n01
    if left < BLIND * n11:
        return start_2(dt), 1.0 / dt, of_s
    return (n00 * of_s, K1, left), K1, of_s


def step_3(
    p: tuple[float, float, float, float, float, float],
    dt: float,
    scale: float,
    added: tuple[float, float, float, float, float, float],
) -> tuple[tuple[float, float, float, float, float, float], float, float, float]:
    """Return (P, K1, K2, 1/S) as `step_2` does, for (x, v, a)."""
    p00, p01, p02, p11, p12, p22 = p
    q00, q01, q02, q11, q12, q22 = added
    half = 0.5 * dt * dt
    r12 = p12 + dt * p22
    r02 = p02 + dt * p12 + half * p22
    r01 = p01 + dt * p11 + half * p12
    n00 = p00 + dt * p01 + half * p02 + dt * r01 + half * r02 + scale * q00
    n01 = r01 + dt * r02 + scale * q01
    n02 = r02 + scale * q02
    n11 = p11 + dt * (p12 + r12) + scale * q11
    of_s = 1.0 / (1.0 + n00)  # 1/S = 1 - K0
    K1, K2 = n01 * of_s, n02 * of_s
    left = n11 - K1 * n01
    if left < BLIND * n11:
        return start_3(dt), 1.0 / dt, 0.0, of_s
    return (
        (n00 * of_s, K1, K2, left, r12 + scale * q12 - K1 * n02, p22 + scale * q22 - K2 * n02),
        K1,
        K2,
        of_s,
    )


def steady_gains_2(density: float, dt: float) -> tuple[float, float]:
    """Return (alpha, beta) to which `step_2` converges at a constant dt [s].

    From the spectral factors of the second difference of the measurement, an MA(2) process with
    autocovariances 6 + 2 tau/3, -4 + tau/6, 1 where tau = density dt^3.
    """
    tau = density * dt * dt * dt
    excess = tau / 3.0 + math.sqrt(4.0 * tau + tau * tau / 12.0)
    inverse = math.sqrt(1.0 / excess + 0.25) + 0.5  # 1/alpha, without a difference of large numbers
    return 1.0 / inverse, math.sqrt(tau / excess) / inverse
