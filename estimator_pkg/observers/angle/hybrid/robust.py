# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

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
from typing import NamedTuple

from estimator_pkg.observers.angle.hybrid.design import Design
from estimator_pkg.observers.maths.tracking import matched, noise_of_three, noise_of_two


class SampledDesign(NamedTuple):
    """The poles of the continuous design, as `prepare` needs them, and the limits.

    The pair of poles is decay +- sqrt(discriminant), see `tracking.matched`.
    """

    single: float  # the pole next to the pair [1/s]; order 2: 0
    decay: float  # of the pair [1/s]
    discriminant: float  # of the pair [1/s^2]
    reset_from: float  # errors from here on are reset (J2) instead of injected [rad]
    doubtful: float  # innovations beyond it are [rad], see `correction`
    saturation: float  # M [rad]
    fastest: float  # speed limit [rad/s]


def init_2(measurement: float, design: SampledDesign) -> tuple:
    """Return the state after the first sample [rad], second order."""
    return (measurement, 0.0, 0.0, 1.0)


def init_3(measurement: float, design: SampledDesign) -> tuple:
    """Return the state after the first sample [rad], third order."""
    return (measurement, 0.0, 0.0, 0.0, 1.0)


def estimate_2(state: tuple) -> tuple[float, float, float]:
    """Return position [rad], velocity [rad/s], no acceleration."""
    last, error, velocity, _ = state
    return last - error, velocity, math.nan


def estimate_3(state: tuple) -> tuple[float, float, float]:
    """Return position [rad], velocity [rad/s], acceleration [rad/s^2]."""
    last, error, velocity, acceleration, _ = state
    return last - error, velocity, acceleration


def resume_2(state: tuple, measurement: float) -> tuple:
    """Return the state after a gap: at the measurement [rad], with the speed as it was."""
    _, _, velocity, phase = state
    return (measurement, 0.0, velocity, phase)


def resume_3(state: tuple, measurement: float) -> tuple:
    """Return the same of the third order; the acceleration is forgotten."""
    _, _, velocity, _, phase = state
    return (measurement, 0.0, velocity, 0.0, phase)


def sampled_design(
    design: Design, reset_from: float, doubtful: float, saturation: float, fastest: float
) -> SampledDesign:
    """Return what `prepare` needs of a continuous design; arguments as its fields."""
    # real ones first, so that a complex pair comes last; of three real ones any two are a pair
    *others, one, other = sorted(design.poles, key=lambda pole: (abs(pole.imag), pole.real))
    single = others[0].real if others else 0.0
    half_difference = 0.5 * (one - other)
    return SampledDesign(
        single,
        0.5 * (one + other).real,
        (half_difference * half_difference).real,
        reset_from,
        doubtful,
        saturation,
        fastest,
    )


def prepare_2(design: SampledDesign, dt: float) -> tuple:
    """Return the coefficients of the second order.

    (alpha, beta/dt, dt, reset_from, doubtful, saturation, fastest)
    """
    alpha, beta = matched(design.decay, design.discriminant, dt)
    return (
        alpha,
        beta / dt,
        dt,
        design.reset_from,
        design.doubtful,
        design.saturation,
        design.fastest,
    )


def prepare_3(design: SampledDesign, dt: float) -> tuple:
    """Return the coefficients of the third order.

    (alpha, beta/dt, gamma/dt^2, dt, reset_from, doubtful, saturation, fastest, z of the single
    pole)

    With p, v, a the prediction and e the innovation, x = p + alpha e, v += beta/dt e,
    a += gamma/dt^2 e have the z-polynomial
    z^3 + (alpha + beta + gamma/2 - 3) z^2 + (3 - 2 alpha - beta + gamma/2) z + alpha - 1.
    With the elementary symmetric sums E1, E2, E3 of d_i = 1 - z_i, so that nothing cancels in a
    slow loop: alpha = E1 - E2 + E3, beta = E2 - 3/2 E3, gamma = E3.
    """
    of_pair, product = matched(design.decay, design.discriminant, dt)  # d1 + d2 - d1 d2, d1 d2
    d = -math.expm1(-design.single * dt)
    gamma = d * product
    return (
        d + of_pair - d * of_pair,
        (product + d * of_pair - 0.5 * gamma) / dt,
        gamma / (dt * dt),
        dt,
        design.reset_from,
        design.doubtful,
        design.saturation,
        design.fastest,
        1.0 - d,
    )


def prepare_triple(design: SampledDesign, dt: float) -> tuple:
    """Return the same as `prepare_3` for a triple real pole, whose z is one exponential."""
    single, _, _, reset_from, doubtful, saturation, fastest = design
    z = math.exp(-single * dt)
    rate = (1.0 - z) / dt
    slope = (1.0 - z) * rate
    return (
        1.0 - z * z * z,
        1.5 * slope * (1.0 + z),
        slope * rate,
        dt,
        reset_from,
        doubtful,
        saturation,
        fastest,
        z,
    )


def noise_gains_2(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Return variances of position, velocity [1/s^2] and innovation per unit variance of noise."""
    alpha, beta_rate, dt, _, _, _, _ = coefficients
    return noise_of_two(alpha, beta_rate * dt, dt)


def noise_gains_3(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Return the same as `noise_gains_2`, third order, any poles."""
    alpha, beta_rate, gamma_rate, dt, _, _, _, _, _ = coefficients
    return noise_of_three(alpha, beta_rate * dt, gamma_rate * dt * dt, dt)


def noise_gains_triple(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Return the same as `noise_gains_3` for a triple real pole z, where the equation factors.

    With d = 1 - z: d (1 + 6 z + 16 z^2 + 24 z^3 + 19 z^4), d^3 (13 + 50 z + 49 z^2)/(2 dt^2) and
    20 + 10 z + 2 z^2, all over (1 + z)^5.
    """
    _, _, _, dt, _, _, _, _, z = coefficients
    d = 1.0 - z
    rate = d / dt
    one = 1.0 + z
    two = one * one
    scale = 1.0 / (two * two * one)
    return (
        d * (1.0 + z * (6.0 + z * (16.0 + z * (24.0 + z * 19.0)))) * scale,
        d * rate * rate * (6.5 + z * (25.0 + 24.5 * z)) * scale,
        (20.0 + z * (10.0 + 2.0 * z)) * scale,
    )
