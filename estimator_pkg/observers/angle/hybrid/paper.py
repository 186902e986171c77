"""Algorithm 1 of Brentari et al. (2018), as printed (with the absolute-value bars it lost)."""

from __future__ import annotations

import math
from collections.abc import Callable

from estimator_pkg.observers.angle.hybrid.injections import Injection
from estimator_pkg.observers.circle import wrap
from estimator_pkg.observers.maths.tracking import noise_of_two

UNSTABLE = 1e300  # a noise gain that nothing bounds; unlike inf, it may be multiplied by 0

Algorithm = Callable[
    [float, float, float, float, float, float, float, float], tuple[float, float, float]
]


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
        surprise = measurement - predicted
        push = injection(surprise, period, saturation)
        position = predicted + dt * l1 * push
        velocity += dt * l2 * push
        if abs(abs(measurement - position) - half) <= margin:  # line 4: in J2
            position = measurement
        if abs(position) >= half + margin:  # line 7: in J1
            position -= math.copysign(period, position)
        return position, velocity, surprise

    return algorithm_1


def init(measurement: float, design: tuple) -> tuple:
    """At the first sample, at rest: (position [rad], velocity [rad/s])."""
    return (wrap(measurement, design[4]), 0.0)


def prepare(design: tuple, dt: float) -> tuple:
    """(dt, l1 [1/s], l2 [1/s^2], margin, saturation, period [rad]): nothing depends on dt."""
    return (dt, design[0], design[1], design[2], design[3], design[4])


def make_correct(algorithm_1: Algorithm) -> Callable[[tuple, tuple, float], tuple[tuple, float]]:
    """`correct` made of Algorithm 1; the measurement is wrapped on entry, in any convention."""

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple[tuple, float]:
        dt, l1, l2, margin, saturation, period = coefficients
        position, velocity, surprise = algorithm_1(
            state[0], state[1], wrap(measurement, period), dt, l1, l2, margin, saturation
        )
        return (position, velocity), wrap(surprise, period)

    return correct


def estimate(state: tuple) -> tuple[float, float, float]:
    """Position [rad], velocity [rad/s], no acceleration."""
    return state[0], state[1], math.nan


def make_resume(period: float) -> Callable[[tuple, float], tuple]:
    """`resume`: at the measurement, with the speed as it was."""

    def resume(state: tuple, measurement: float) -> tuple:
        return (wrap(measurement, period), state[1])

    return resume


def noise_gains(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Of the loop of `tracking.noise_of_two` with alpha = T l1 and beta = T^2 l2.

    As good as infinite where this one sample time is beyond the stability limit.
    """
    dt, l1, l2 = coefficients[0], coefficients[1], coefficients[2]
    alpha, beta = dt * l1, dt * dt * l2
    if 2.0 * alpha + beta >= 4.0:
        return UNSTABLE, UNSTABLE, 1.0
    return noise_of_two(alpha, beta, dt)
