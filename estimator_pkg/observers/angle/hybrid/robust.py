"""The robust sampled form of the hybrid observer: state, pole-matched gains, noise.

The poles are those of the continuous design at any sample time (pole matching), so no sample time
is unstable and each sample may have its own. The corrections are in `correction`.

State (order 2 without the acceleration): (last measurement [rad], error that the last correction
left [rad], velocity [rad/s], acceleration [rad/s^2], phase). The position is the last measurement
less the error. The phase is 0 in steady state, the number of samples so far in a start, and less
the number of samples held while astray.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.hybrid.design import Design
from estimator_pkg.observers.maths.tracking import matched, noise_of_three, noise_of_two


def init_2(measurement: float, design: tuple) -> tuple:
    """The state after the first sample [rad], second order."""
    return (measurement, 0.0, 0.0, 1.0)


def init_3(measurement: float, design: tuple) -> tuple:
    """The state after the first sample [rad], third order."""
    return (measurement, 0.0, 0.0, 0.0, 1.0)


def estimate_2(state: tuple) -> tuple[float, float, float]:
    """Position [rad], velocity [rad/s], no acceleration."""
    return state[0] - state[1], state[2], math.nan


def estimate_3(state: tuple) -> tuple[float, float, float]:
    """Position [rad], velocity [rad/s], acceleration [rad/s^2]."""
    return state[0] - state[1], state[2], state[3]


def resume_2(state: tuple, measurement: float) -> tuple:
    """After a gap: at the measurement, with the speed as it was."""
    return (measurement, 0.0, state[2], state[3])


def resume_3(state: tuple, measurement: float) -> tuple:
    """After a gap: at the measurement, with the speed as it was; the acceleration is forgotten."""
    return (measurement, 0.0, state[2], 0.0, state[4])


def design_values(design: Design, reach: float, saturation: float, fastest: float) -> tuple:
    """What `prepare` needs, as a flat tuple of six floats.

    The first three describe the poles: that beside the pair [1/s] (order 2: 0), and of the pair
    what `tracking.matched` calls decay and spread.

    Parameters
    ----------
    reach : errors from here on are reset instead of injected [rad].
    saturation : M [rad].
    fastest : speed limit [rad/s].
    """
    # real ones first, so that a complex pair comes last; of three real ones any two are a pair
    *others, one, other = sorted(design.poles, key=lambda pole: (abs(pole.imag), pole.real))
    single = others[0].real if others else 0.0
    apart = 0.5 * (one - other)
    return (single, 0.5 * (one + other).real, (apart * apart).real, reach, saturation, fastest)


def prepare_2(design: tuple, dt: float) -> tuple:
    """The coefficients of the second order: (alpha, beta/dt, dt, reach, saturation, fastest)."""
    alpha, beta = matched(design[1], design[2], dt)
    return (alpha, beta / dt, dt, design[3], design[4], design[5])


def prepare_3(design: tuple, dt: float) -> tuple:
    """The coefficients of the third order.

    Gives (alpha, beta/dt, gamma/dt^2, dt, reach, saturation, fastest, z of the single pole).

    With p, v, a the prediction and e the innovation, x = p + alpha e, v += beta/dt e,
    a += gamma/dt^2 e have the z-polynomial
    z^3 + (alpha + beta + gamma/2 - 3) z^2 + (3 - 2 alpha - beta + gamma/2) z + alpha - 1.
    With the elementary symmetric sums E1, E2, E3 of 1 - z_i, so that nothing cancels in a slow
    loop: alpha = E1 - E2 + E3, beta = E2 - 3/2 E3, gamma = E3.
    """
    of_pair, product = matched(design[1], design[2], dt)  # sum less product of the pair's, product
    apart = -math.expm1(-design[0] * dt)
    gamma = apart * product
    return (
        apart + of_pair - apart * of_pair,
        (product + apart * of_pair - 0.5 * gamma) / dt,
        gamma / (dt * dt),
        dt,
        design[3],
        design[4],
        design[5],
        1.0 - apart,
    )


def prepare_triple(design: tuple, dt: float) -> tuple:
    """As `prepare_3` for a triple real pole, whose z is one exponential."""
    z = math.exp(-design[0] * dt)
    rate = (1.0 - z) / dt
    slope = (1.0 - z) * rate
    return (
        1.0 - z * z * z,
        1.5 * slope * (1.0 + z),
        slope * rate,
        dt,
        design[3],
        design[4],
        design[5],
        z,
    )


def noise_gains_2(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Variances of position, velocity [1/s^2] and innovation per unit variance of white noise."""
    return noise_of_two(coefficients[0], coefficients[1] * coefficients[2], coefficients[2])


def noise_gains_3(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """As `noise_gains_2`, third order, any poles."""
    alpha, beta_rate, gamma_rate, dt = (
        coefficients[0],
        coefficients[1],
        coefficients[2],
        coefficients[3],
    )
    return noise_of_three(alpha, beta_rate * dt, gamma_rate * dt * dt, dt)


def noise_gains_triple(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """As `noise_gains_3` for a triple real pole z, where the equation factors.

    With d = 1 - z: d (1 + 6 z + 16 z^2 + 24 z^3 + 19 z^4), d^3 (13 + 50 z + 49 z^2)/(2 dt^2) and
    20 + 10 z + 2 z^2, all over (1 + z)^5.
    """
    z = coefficients[7]
    d = 1.0 - z
    rate = d / coefficients[3]
    one = 1.0 + z
    two = one * one
    scale = 1.0 / (two * two * one)
    return (
        d * (1.0 + z * (6.0 + z * (16.0 + z * (24.0 + z * 19.0)))) * scale,
        d * rate * rate * (6.5 + z * (25.0 + 24.5 * z)) * scale,
        (20.0 + z * (10.0 + 2.0 * z)) * scale,
    )
