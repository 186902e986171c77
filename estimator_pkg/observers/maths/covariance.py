"""Covariances of position, velocity and acceleration, unrolled, in units of the noise variance.

The upper triangle of the symmetric P/R is kept, row by row: 3 numbers for (x, v), 6 for (x, v, a).
With R = 1 the first row of P after a measurement *is* the Kalman gain, and the update multiplies
that row by 1/(1 + p00) instead of subtracting from it: nothing cancels there, and the rest loses
digits only where a measurement takes nearly all of an uncertainty away, which is done in closed
form. White process noise keeps P regular, so the recursion runs for hours without a Joseph form.
"""

from __future__ import annotations

import math

# Variance of the unknown acceleration at a start, in noise variances / dt^4. Three samples know it
# to 6 of these, so that this prior is gone from the fourth sample on.
VAGUE = 1e4

# Where a measurement leaves less than this of the position's variance, the difference of the other
# variances would have few digits left: nothing was known, and the start's closed form takes over.
BLIND = 1e-9


def of_noise_2(density: float, dt: float) -> tuple[float, float, float]:
    """What white acceleration of this `density` (of the noise variance) adds within dt [s]."""
    return (density * dt * dt * dt / 3.0, density * dt * dt / 2.0, density * dt)


def of_noise_3(density: float, dt: float) -> tuple[float, float, float, float, float, float]:
    """What white jerk of this `density` (of the noise variance) adds within dt [s]."""
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
    """After two samples dt [s] apart and no other knowledge: a straight line through both."""
    return (1.0, 1.0 / dt, 2.0 / (dt * dt))


def start_3(dt: float) -> tuple[float, float, float, float, float, float]:
    """As `start_2`, with an acceleration of which next to nothing is known."""
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
) -> tuple[tuple[float, float, float], float]:
    """Prediction over dt [s] and update; (P, 1/(1 + p00 of the prediction)).

    Parameters
    ----------
    scale : factor of `added`.
    added : process noise over dt, from `of_noise_2`.
    """
    p00, p01, p11 = p
    q00, q01, q11 = added
    n01 = p01 + dt * p11
    n00 = p00 + dt * (p01 + n01) + scale * q00
    n01 += scale * q01
    left = 1.0 / (1.0 + n00)
    if left < BLIND:
        return start_2(dt), left
    p01 = n01 * left
    return (n00 * left, p01, p11 + scale * q11 - p01 * n01), left


def step_3(
    p: tuple[float, float, float, float, float, float],
    dt: float,
    scale: float,
    added: tuple[float, float, float, float, float, float],
) -> tuple[tuple[float, float, float, float, float, float], float]:
    """As `step_2`, with the acceleration."""
    p00, p01, p02, p11, p12, p22 = p
    q00, q01, q02, q11, q12, q22 = added
    half = 0.5 * dt * dt
    r12 = p12 + dt * p22
    r02 = p02 + dt * p12 + half * p22
    r01 = p01 + dt * p11 + half * p12
    n00 = p00 + dt * p01 + half * p02 + dt * r01 + half * r02 + scale * q00
    n01 = r01 + dt * r02 + scale * q01
    n02 = r02 + scale * q02
    left = 1.0 / (1.0 + n00)
    if left < BLIND:
        return start_3(dt), left
    p01 = n01 * left
    p02 = n02 * left
    return (
        n00 * left,
        p01,
        p02,
        p11 + dt * (p12 + r12) + scale * q11 - p01 * n01,
        r12 + scale * q12 - p01 * n02,
        p22 + scale * q22 - p02 * n02,
    ), left


def steady_gains_2(density: float, dt: float) -> tuple[float, float]:
    """(alpha, beta) to which `step_2` converges at a constant dt [s].

    From the spectral factors of the second difference of the measurement, an MA(2) process with
    autocovariances 6 + 2 tau/3, -4 + tau/6, 1 where tau = density dt^3.
    """
    tau = density * dt * dt * dt
    excess = tau / 3.0 + math.sqrt(4.0 * tau + tau * tau / 12.0)
    inverse = math.sqrt(1.0 / excess + 0.25) + 0.5  # 1/alpha, without a difference of large numbers
    return 1.0 / inverse, math.sqrt(tau / excess) / inverse
