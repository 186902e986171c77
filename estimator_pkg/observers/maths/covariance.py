# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Covariances of position, velocity and acceleration, unrolled, in units of the noise variance.

P/R is symmetric. For (x, v) the entries of the acceleration are 0.

    P- = F P F' + Q,   S = H P- H' + 1,   K = P- H'/S,   P = P- - K H P-,   H = (1, 0[, 0])

With R = 1 the first row of P after a measurement *is* the Kalman gain K. The update multiplies that
row by 1/S instead of subtracting from it, so nothing cancels there. The other entries lose digits
only where a measurement removes nearly all of an uncertainty; a closed form replaces that case.
White process noise keeps P regular, so the recursion runs for hours without a Joseph form.
"""

from __future__ import annotations

import math

from estimator_pkg.record import record

# Prior variance of the acceleration at a start, in noise variances / dt^4. Three samples determine
# it to 6 of these, so from the fourth sample on the prior has no influence.
PRIOR_ACCELERATION = 1e4

# If a measurement reduces the speed's variance below this part, the difference has few digits left.
# The state was unknown then: P is that of a start. A measurement without noise reduces the
# position's variance as far, but leaves a part of the speed's that the process noise has added.
CANCELLATION = 1e-9


@record
class Covariance:
    """The upper triangle of a symmetric matrix, of (x, v, a)."""

    p00: float
    p01: float
    p02: float
    p11: float
    p12: float
    p22: float


def set_first(p: Covariance) -> None:
    """Set P after one sample: the rest is set by the second."""
    p.p00 = 1.0
    p.p01 = p.p02 = p.p11 = p.p12 = p.p22 = 0.0


def set_noise(q: Covariance, order: int, density: float, dt: float) -> None:
    """Set Q over dt [s], per noise variance: of white acceleration (order 2) or jerk (order 3)."""
    square = dt * dt
    if order == 2:
        q.p00, q.p01, q.p11 = density * square * dt / 3.0, density * square / 2.0, density * dt
        q.p02 = q.p12 = q.p22 = 0.0
    else:
        q.p00, q.p01 = density * square * square * dt / 20.0, density * square * square / 8.0
        q.p02 = density * square * dt / 6.0
        q.p11, q.p12 = density * square * dt / 3.0, density * square / 2.0
        q.p22 = density * dt


def set_line(p: Covariance, dt: float, prior: float) -> None:
    """Set P after two samples that are dt [s] apart: a straight line through both.

    Parameters
    ----------
    prior : PRIOR_ACCELERATION; 0: there is no acceleration.
    """
    square = dt * dt
    p.p00 = 1.0
    p.p01 = 1.0 / dt
    p.p02 = 0.0
    p.p11 = (2.0 + 0.25 * prior) / square
    p.p12 = 0.5 * prior / (square * dt)
    p.p22 = prior / (square * square)


def update(
    p: Covariance, q: Covariance, dt: float, scale: float, prior: float
) -> tuple[float, float, float]:
    """Predict P over dt [s] and update it; return (K1, K2, 1/S).

    Parameters
    ----------
    q : process noise over dt, from `set_noise`. scale : factor of it. prior : as in `set_line`.
    """
    half = 0.5 * dt * dt  # n: P- = F P F' + Q
    r12 = p.p12 + dt * p.p22
    r02 = p.p02 + dt * p.p12 + half * p.p22
    r01 = p.p01 + dt * p.p11 + half * p.p12
    n00 = p.p00 + dt * p.p01 + half * p.p02 + dt * r01 + half * r02 + scale * q.p00
    n01 = r01 + dt * r02 + scale * q.p01
    n02 = r02 + scale * q.p02
    n11 = p.p11 + dt * (p.p12 + r12) + scale * q.p11
    of_s = 1.0 / (1.0 + n00)  # 1/S = 1 - K0
    K1, K2 = n01 * of_s, n02 * of_s
    left = n11 - K1 * n01
    if left < CANCELLATION * n11:
        set_line(p, dt, prior)
        return 1.0 / dt, 0.0, of_s
    p.p00, p.p01, p.p02, p.p11 = n00 * of_s, K1, K2, left
    p.p12 = r12 + scale * q.p12 - K1 * n02
    p.p22 = p.p22 + scale * q.p22 - K2 * n02
    return K1, K2, of_s


def steady_gains(density: float, dt: float) -> tuple[float, float]:
    """Return (alpha, beta) to which `update` converges for (x, v) at a constant dt [s].

    From the spectral factors of the second difference of the measurement, an MA(2) process with
    autocovariances 6 + 2 tau/3, -4 + tau/6, 1 where tau = density dt^3.
    """
    tau = density * dt * dt * dt
    excess = tau / 3.0 + math.sqrt(4.0 * tau + tau * tau / 12.0)
    inverse = math.sqrt(1.0 / excess + 0.25) + 0.5  # 1/alpha, without a difference of large numbers
    return 1.0 / inverse, math.sqrt(tau / excess) / inverse
