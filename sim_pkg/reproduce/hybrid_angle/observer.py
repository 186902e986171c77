# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The continuous-time hybrid observer (3) of Brentari et al. (2018): its flow and its jumps.

Figures 4 and 5 integrate it; a node runs the sampled forms of `hybrid_angle`. Every function is
pure and in the subset that Numba compiles; all angles are on the circle of 2 pi.

References
----------
M. Brentari, P. Bosetti, L. Zaccarian, "A class of hybrid velocity observers for angular
measurements with jumps", IEEE L-CSS 2(4), 2018: the plant (1), the observer (3), the Lyapunov
function (7), (8) and Lemma 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from estimator_pkg.observers.circle import wrap

TURN = 2.0 * math.pi

Injection = Callable[[float, float], float]
Flow = Callable[[float, float, float, tuple[float, float, float]], tuple[float, float]]
Potential = Callable[[float, float], float]


def observer_gains(k1: float, k2: float, epsilon: float) -> tuple[float, float]:
    """Return L = (k1/epsilon [1/s], k2/epsilon^2 [1/s^2]).

    k1 is the paper's k_v and k2 its k_p: the error polynomial of (3) is s^2 + l1 s + l2.
    """
    return k1 / epsilon, k2 / (epsilon * epsilon)


def sin(error: float, limit: float) -> float:
    """Return the injection of an error, both [rad]: case study 1."""
    return math.sin(error)


def tan(error: float, limit: float) -> float:
    """Return the injection of case study 2 [rad]."""
    return 2.0 * math.tan(0.5 * error)


def saw(error: float, limit: float) -> float:
    """Return the injection of case study 3 [rad]: the wrapped error."""
    return wrap(error, TURN)


def sat(error: float, limit: float) -> float:
    """Return the injection of case study 4 [rad]: the wrapped error saturated at +-limit [rad]."""
    return max(-limit, min(limit, wrap(error, TURN)))


INJECTIONS: dict[str, Injection] = {'sin': sin, 'tan': tan, 'saw': saw, 'sat': sat}


def make_flow(injection: Injection) -> Flow:
    """Return the flow map of (3a) with this injection."""

    def flow(
        position: float, velocity: float, measurement: float, gains: tuple[float, float, float]
    ) -> tuple[float, float]:
        """Return the derivatives of the estimated position [rad/s] and velocity [rad/s^2].

        gains : l1 [1/s], l2 [1/s^2], saturation limit M [rad] of the injection.
        """
        l1, l2, limit = gains
        corrected = injection(measurement - position, limit)
        return velocity + l1 * corrected, l2 * corrected  # (3a)

    return flow


def in_first_jump_set(angle: float, margin: float) -> bool:
    """Return True in J1 of (1d): `angle` [rad] is beyond pi by `margin` = delta_pi [rad]."""
    return abs(angle) >= math.pi + margin


def first_jump(angle: float) -> float:
    """Return h1 of (1c): one turn back. The plant and the observer's position share it."""
    return angle - TURN if angle > 0.0 else angle + TURN


def in_second_jump_set(error: float, margin: float) -> bool:
    """Return True in J2 of (3b): the output error [rad] is within `margin` [rad] of half a turn.

    The second jump map h2 needs no function: the estimated position becomes the measurement, the
    estimated velocity stays.
    """
    return abs(abs(error) - math.pi) <= margin


def potential_sin(error: float, limit: float) -> float:
    """Return psi of (7) [rad^2]: the integral of sin(e)."""
    return 1.0 - math.cos(error)


def potential_tan(error: float, limit: float) -> float:
    """Return psi of (7) [rad^2]: the integral of 2 tan(e/2)."""
    return -4.0 * math.log(abs(math.cos(0.5 * error)))


def potential_saw(error: float, limit: float) -> float:
    """Return psi of (7) [rad^2]: the integral of the wrapped error."""
    wrapped = wrap(error, TURN)
    return 0.5 * wrapped * wrapped


def potential_sat(error: float, limit: float) -> float:
    """Return psi of (7) [rad^2]: the integral of the wrapped error saturated at +-limit [rad]."""
    size = abs(wrap(error, TURN))
    if size <= limit:
        return 0.5 * size * size
    return limit * size - 0.5 * limit * limit


POTENTIALS: dict[str, Potential] = {
    'sin': potential_sin,
    'tan': potential_tan,
    'saw': potential_saw,
    'sat': potential_sat,
}


def make_lyapunov(potential: Potential) -> Callable[[float, float, float, float], float]:
    """Return the Lyapunov function (8) over this potential."""

    def lyapunov(position_error: float, velocity_error: float, l2: float, limit: float) -> float:
        """Return V [rad^2] of the errors [rad, rad/s]; l2 [1/s^2], saturation limit [rad]."""
        return potential(position_error, limit) + velocity_error * velocity_error / (2.0 * l2)

    return lyapunov
