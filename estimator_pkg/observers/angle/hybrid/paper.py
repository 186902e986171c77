# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Algorithm 1 of Brentari et al. (2018), as printed (with the absolute-value bars it lost)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from estimator_pkg.observers.angle.hybrid.injections import Injection
from estimator_pkg.observers.circle import wrap
from estimator_pkg.observers.maths.tracking import noise_of_two

UNSTABLE = 1e300  # a noise gain that nothing bounds; unlike inf, it may be multiplied by 0

Algorithm = Callable[
    [float, float, float, float, float, float, float, float], tuple[float, float, float]
]


class Design(NamedTuple):
    """What the gains imply whatever the sample time is."""

    l1: float  # [1/s]
    l2: float  # [1/s^2]
    margin: float  # delta_pi [rad]
    saturation: float  # M [rad]
    period: float  # of the circle [rad]


def make_algorithm_1(injection: Injection, period: float = 2.0 * math.pi) -> Algorithm:
    """Algorithm 1 with this injection.

    Returns
    -------
    ``(position, velocity, measurement, dt, l1, l2, margin, saturation) -> (position, velocity,
    innovation)``; positions in rad, l1 in 1/s, l2 in 1/s^2, margin = delta_pi and saturation = M in
    rad. Position and measurement lie in [-pi - margin, pi + margin].
    """
    half = 0.5 * period

    def algorithm_1(
        position: float,
        velocity: float,
        measurement: float,
        dt: float,
        l1: float,
        l2: float,
        margin: float,
        saturation: float,
    ) -> tuple[float, float, float]:
        predicted = position + dt * velocity  # line 3
        innovation = measurement - predicted
        injected = injection(innovation, period, saturation)
        position = predicted + dt * l1 * injected
        velocity += dt * l2 * injected
        if abs(abs(measurement - position) - half) <= margin:  # line 4: in J2
            position = measurement
        if abs(position) >= half + margin:  # line 7: in J1
            position -= math.copysign(period, position)
        return position, velocity, innovation

    return algorithm_1


def init(measurement: float, design: Design) -> tuple:
    """Return (position [rad], velocity [rad/s]) at the first sample, at rest."""
    return (wrap(measurement, design.period), 0.0)


def prepare(design: Design, dt: float) -> tuple:
    """Return (dt, l1 [1/s], l2 [1/s^2], margin, saturation, period [rad], pace [1/s]).

    The errors decay at the pace of the slowest pole, a root of z^2 - (2 - a - b) z + 1 - a with
    a = T l1 and b = T^2 l2.
    """
    alpha, beta = dt * design.l1, dt * dt * design.l2
    middle = 1.0 - 0.5 * (alpha + beta)
    square = middle * middle - (1.0 - alpha)
    slowest = abs(middle) + math.sqrt(square) if square > 0.0 else math.sqrt(1.0 - alpha)
    pace = -math.log(slowest) / dt if slowest > 0.0 else math.inf
    return (dt, design.l1, design.l2, design.margin, design.saturation, design.period, pace)


def make_correct(algorithm_1: Algorithm) -> Callable[[tuple, tuple, float], tuple[tuple, float]]:
    """Return `correct`, made of Algorithm 1; a measurement of any convention is wrapped."""

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple[tuple, float]:
        dt, l1, l2, margin, saturation, period, _ = coefficients
        position, velocity = state
        position, velocity, innovation = algorithm_1(
            position, velocity, wrap(measurement, period), dt, l1, l2, margin, saturation
        )
        return (position, velocity), wrap(innovation, period)

    return correct


def estimate(state: tuple) -> tuple[float, float, float]:
    """Return position [rad], velocity [rad/s], no acceleration."""
    position, velocity = state
    return position, velocity, math.nan


def make_resume(period: float) -> Callable[[tuple, float], tuple]:
    """Return `resume`: at the measurement [rad], with the speed as it was."""

    def resume(state: tuple, measurement: float) -> tuple:
        _, velocity = state
        return (wrap(measurement, period), velocity)

    return resume


def noise_gains(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Return what `tracking.noise_of_two` gives for alpha = T l1 and beta = T^2 l2.

    As good as infinite where this one sample time is beyond the stability limit.
    """
    dt, l1, l2, _, _, _, _ = coefficients
    alpha, beta = dt * l1, dt * dt * l2
    if 2.0 * alpha + beta >= 4.0:
        return UNSTABLE, UNSTABLE, 1.0
    return noise_of_two(alpha, beta, dt)


def pace(state: tuple, coefficients: tuple, dt: float) -> float:
    """Return how fast the errors of a start decay [1/s]."""
    _, _, _, _, _, _, slowest = coefficients
    return slowest
