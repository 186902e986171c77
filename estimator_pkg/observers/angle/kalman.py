# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The Kalman filter of a joint that is moved by white noise, with wrapped innovation and true dt.

    constant_velocity        v' = w,         w white acceleration of density q [(rad/s^2)^2 s]
    constant_acceleration    a' = w, v' = a, w white jerk of density q [(rad/s^3)^2 s]

The covariance is propagated over each sample's own dt, in units of the measurement noise variance
R. A start knows nothing of speed and acceleration, so the speed is right from the second sample.

With `bandwidth_hz` set, the density is not used; instead q = w0^(2n) R dt, which puts the poles of
the continuous-time filter on the Butterworth circle of radius w0 (n = 2 or 3), whatever R and dt:

    constant_velocity        v/v_true = w0^2/(s^2 + sqrt(2) w0 s + w0^2)
    constant_acceleration    (2 w0^2 s + w0^3)/(s^3 + 2 w0 s^2 + 2 w0^2 s + w0^3)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from estimator_pkg.observers.angle.core import (
    LAG_2,
    LAG_3,
    AngleCore,
    AngleGains,
    around,
    variance_floor,
)
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import Functions, Observer
from estimator_pkg.observers.maths.covariance import (
    of_noise_2,
    of_noise_3,
    start_2,
    start_3,
    steady_gains_2,
    step_2,
    step_3,
)
from estimator_pkg.observers.maths.scatter import FIRST as FIRST_VARIANCE
from estimator_pkg.observers.maths.scatter import begin_scatter, follow_scatter, resume_scatter
from estimator_pkg.observers.maths.tracking import noise_of_three, noise_of_two
from estimator_pkg.parameters import parameter, structural

VELOCITY, ACCELERATION = 'constant_velocity', 'constant_acceleration'
# -3 dB frequency of the velocity over w0; of the third order: the root of u^3 - 8 u - 1, u = w^2
BANDWIDTH_RATIO = {VELOCITY: 1.0, ACCELERATION: 1.6996647}
SETTLING = 4.0  # times 1/w0: the start's gains have come down to the steady ones
USUAL_DT = 1e-3  # [s] where a number is needed before the first sample (the sixth root of it)
FIRST_2 = (1.0, 0.0, 0.0)  # P/R after one sample: the rest is set by the second
FIRST_3 = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `kalman`."""

    model: str = structural(
        ACCELERATION,
        choices=(VELOCITY, ACCELERATION),
        description='what a joint does when left alone; constant_acceleration also gives the '
        'acceleration and has no ramp lag',
    )
    jerk_psd: float = parameter(
        1e3,
        unit='(rad/s^3)^2 s',
        range=(1e-12, 1e18),
        description='density of the white jerk that moves a constant_acceleration joint',
        equation='Q = q [[dt^5/20, dt^4/8, dt^3/6], [dt^4/8, dt^3/3, dt^2/2], '
        '[dt^3/6, dt^2/2, dt]]',
    )
    acceleration_psd: float = parameter(
        10.0,
        unit='(rad/s^2)^2 s',
        range=(1e-12, 1e18),
        description='density of the white acceleration that moves a constant_velocity joint',
        equation='Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]',
    )
    bandwidth_hz: float | None = parameter(
        None,
        unit='Hz',
        range=(0.001, 1e5),
        search=(0.5, 500.0),
        description='-3 dB frequency from true to estimated velocity; set, it takes the place of '
        'the density; automatic: follows from density and noise',
        equation='q = w0^(2n) R dt, w0 = 2 pi f / (1 or 1.69966), n = 2 or 3',
    )


class Design(NamedTuple):
    """What the gains imply whatever the sample time is."""

    density: float  # q of the white jerk or acceleration, per R where that is known
    period: float  # wrap period [rad]; 0: none
    per_dt: float  # 1.0 where the density is per R dt
    estimated: float  # 1.0 where R is estimated


def make_prepare(of_noise: Any) -> Any:
    """Return `prepare`: (dt, wrap period, Q over dt per R, 1 where R is estimated)."""

    def prepare(design: Design, dt: float) -> tuple:
        density = design.density
        if design.per_dt > 0.0:
            density *= dt
        return (dt, design.period, of_noise(density, dt), design.estimated)

    return prepare


def init_2(measurement: float, design: Design) -> tuple:
    """Return (position [rad], velocity [rad/s], P/R, 1 after the second sample, scatter)."""
    return (measurement, 0.0, FIRST_2, 0.0, begin_scatter(measurement))


def init_3(measurement: float, design: Design) -> tuple:
    """Return the same with the acceleration [rad/s^2] after the velocity."""
    return (measurement, 0.0, 0.0, FIRST_3, 0.0, begin_scatter(measurement))


def correct_2(state: tuple, coefficients: tuple, measurement: float) -> tuple[tuple, float]:
    """Return the state one sample further, and the innovation [rad]: constant velocity."""
    x, v, p, started, scatter = state
    dt, period, q, estimated = coefficients
    scale = 1.0
    if estimated > 0.0:
        scatter = follow_scatter(scatter, measurement, dt, period)
        variance, _, _, _, _, _, _ = scatter
        scale = 1.0 / variance
    innovation = measurement - x - v * dt
    if innovation + innovation >= period or innovation + innovation < -period:
        innovation = wrap(innovation, period)
    if started == 0.0:
        return (measurement, v + innovation / dt, start_2(dt), 1.0, scatter), 0.0
    p, K1, of_s = step_2(p, dt, scale, q)
    # prediction + K0 e is measurement - e/S, which stays on the measurement's turn
    return (measurement - of_s * innovation, v + K1 * innovation, p, 1.0, scatter), innovation


def correct_3(state: tuple, coefficients: tuple, measurement: float) -> tuple[tuple, float]:
    """Return the state one sample further, and the innovation [rad]: constant acceleration."""
    x, v, a, p, started, scatter = state
    dt, period, q, estimated = coefficients
    scale = 1.0
    if estimated > 0.0:
        scatter = follow_scatter(scatter, measurement, dt, period)
        variance, _, _, _, _, _, _ = scatter
        scale = 1.0 / variance
    gained = a * dt
    innovation = measurement - x - (v + 0.5 * gained) * dt
    if innovation + innovation >= period or innovation + innovation < -period:
        innovation = wrap(innovation, period)
    if started == 0.0:
        return (measurement, v + innovation / dt, 0.0, start_3(dt), 1.0, scatter), 0.0
    p, K1, K2, of_s = step_3(p, dt, scale, q)
    return (
        (
            measurement - of_s * innovation,
            v + gained + K1 * innovation,
            a + K2 * innovation,
            p,
            1.0,
            scatter,
        ),
        innovation,
    )


def estimate_2(state: tuple) -> tuple[float, float, float]:
    """Return position [rad], velocity [rad/s], no acceleration."""
    x, v, _, _, _ = state
    return x, v, math.nan


def estimate_3(state: tuple) -> tuple[float, float, float]:
    """Return position [rad], velocity [rad/s], acceleration [rad/s^2]."""
    x, v, a, _, _, _ = state
    return x, v, a


def resume_2(state: tuple, measurement: float) -> tuple:
    """Return the state after a gap: a start, whose kept speed finds the next sample's turn."""
    _, v, _, _, scatter = state
    return (measurement, v, FIRST_2, 0.0, resume_scatter(scatter, measurement))


def resume_3(state: tuple, measurement: float) -> tuple:
    """Return the same as `resume_2`; the acceleration is forgotten."""
    _, v, _, _, _, scatter = state
    return (measurement, v, 0.0, FIRST_3, 0.0, resume_scatter(scatter, measurement))


def noise_of_third(alpha: float, beta: float, dt: float) -> tuple[float, float, float]:
    """Return the same as `noise_gains_2`, after the third sample.

    That is a line through two, corrected by the second difference of all three. Its gains, if they
    stayed, could be those of an unstable observer.
    """
    return alpha, (2.0 - 6.0 * beta * (1.0 - beta)) / (dt * dt), 6.0


def noise_gains_2(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Return the variances that white noise alone causes at the present gains, per R.

    P itself also holds the motion that the model allows for: at constant speed it is several times
    what is really there.
    """
    _, _, (K0, K1, _), started, _ = state
    dt, _, _, _ = coefficients
    if started == 0.0:
        return 1.0, 2.0 / (dt * dt), 2.0  # as the second sample will leave it
    alpha, beta = K0, K1 * dt
    if 2.0 * alpha + beta < 4.0:
        return noise_of_two(alpha, beta, dt)
    return noise_of_third(alpha, beta, dt)


def noise_gains_3(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Return the same as `noise_gains_2`."""
    _, _, _, (K0, K1, K2, _, _, _), started, _ = state
    dt, _, _, _ = coefficients
    if started == 0.0:
        return 1.0, 2.0 / (dt * dt), 2.0
    alpha, beta, gamma = K0, K1 * dt, K2 * dt * dt
    if 2.0 * alpha + beta < 4.0 and alpha * (2.0 * beta + gamma) > 2.0 * gamma:
        return noise_of_three(alpha, beta, gamma, dt)
    return noise_of_third(alpha, beta, dt)


def build(gains: Gains, circle: Circle) -> Functions:
    """Return the functions of the filter at these gains."""
    order = 2 if gains.model == VELOCITY else 3
    density = gains.acceleration_psd if order == 2 else gains.jerk_psd
    variance = variance_floor(gains.quantum)
    if gains.noise is not None:
        variance += gains.noise * gains.noise
    per_dt, estimated = 0.0, 0.0
    if gains.bandwidth_hz is not None:
        radius = 2.0 * math.pi * gains.bandwidth_hz / BANDWIDTH_RATIO[gains.model]
        density = radius ** (2 * order)
        per_dt = 1.0
    else:
        if variance == 0.0:
            estimated = 1.0
            usual = density / FIRST_VARIANCE
        else:
            density /= variance
            usual = density
        radius = (usual / USUAL_DT) ** (0.5 / order)

    def design() -> Design:
        return Design(density, float(circle.period), per_dt, estimated)

    def group_delay(dt: float) -> float:
        if order == 3:
            return 0.0  # a constant acceleration is followed without lag
        if estimated > 0.0:
            return math.nan  # it follows from noise that is not known
        of_r = density * dt if per_dt > 0.0 else density
        alpha, beta = steady_gains_2(of_r, dt)
        return dt * (alpha / beta - 0.5)

    functions = (
        (init_2, correct_2, estimate_2, resume_2, noise_gains_2, of_noise_2)
        if order == 2
        else (init_3, correct_3, estimate_3, resume_3, noise_gains_3, of_noise_3)
    )
    init, correct, estimate, resume, noise_gains, of_noise = functions
    return around(
        AngleCore(
            design=design,
            settle=SETTLING / radius,
            prepare=make_prepare(of_noise),
            init=init,
            correct=correct,
            estimate=estimate,
            resume=resume,
            noise_gains=noise_gains,
            limits=lambda dt: None,
            group_delay=group_delay,
            turns=True,
            lag=LAG_2 if order == 2 else LAG_3,
        ),
        gains,
        circle,
    )


OBSERVER = Observer(
    name='kalman',
    summary='Kalman filter of constant velocity or constant acceleration',
    gains=Gains,
    build=build,
    reference='textbook; Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking '
    'and Navigation (2001), section 6.2',
    gives_acceleration=lambda gains: gains.model == ACCELERATION,
)
