# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The continuous-time hybrid observer (3) of Brentari et al. (2018): its flow and its jumps.

Figures 4 and 5 integrate it; a node runs the sampled forms of `hybrid_angle`. All angles are on the
circle of 2 pi. An injection is `kind`, the index of its name in `injections.NAMES`.

References
----------
M. Brentari, P. Bosetti, L. Zaccarian, "A class of hybrid velocity observers for angular
measurements with jumps", IEEE L-CSS 2(4), 2018: the plant (1), the observer (3), the Lyapunov
function (7), (8) and Lemma 1.
"""

from __future__ import annotations

import math

from estimator_pkg.circle import wrap
from estimator_pkg.observers.angle.hybrid.injections import SAT, SIN, TAN

TURN = 2.0 * math.pi


def injection(kind: int, error: float, limit: float) -> float:
    """Return the injection of an error, both [rad]: case studies 1 to 4."""
    if kind == SIN:
        return math.sin(error)
    if kind == TAN:
        return 2.0 * math.tan(0.5 * error)
    wrapped = wrap(error, TURN)
    return max(-limit, min(limit, wrapped)) if kind == SAT else wrapped


def flow(
    kind: int,
    position: float,
    velocity: float,
    measurement: float,
    l1: float,
    l2: float,
    limit: float,
) -> tuple[float, float]:
    """Return (3a), the derivatives of the estimated position [rad/s] and velocity [rad/s^2].

    l1 [1/s], l2 [1/s^2], saturation limit M [rad] of the injection.
    """
    corrected = injection(kind, measurement - position, limit)
    return velocity + l1 * corrected, l2 * corrected


def first_jump(angle: float) -> float:
    """Return h1 of (1c): one turn back. The plant and the observer's position share it."""
    return angle - TURN if angle > 0.0 else angle + TURN


def potential(kind: int, error: float, limit: float) -> float:
    """Return psi of (7) [rad^2]: the integral of the injection."""
    if kind == SIN:
        return 1.0 - math.cos(error)
    if kind == TAN:
        return -4.0 * math.log(abs(math.cos(0.5 * error)))
    size = abs(wrap(error, TURN))
    if kind == SAT and size > limit:
        return limit * size - 0.5 * limit * limit
    return 0.5 * size * size


def lyapunov(
    kind: int, position_error: float, velocity_error: float, l2: float, limit: float
) -> float:
    """Return V of (8) [rad^2] of the errors [rad, rad/s]; l2 [1/s^2], saturation limit [rad]."""
    return potential(kind, position_error, limit) + velocity_error * velocity_error / (2.0 * l2)
