# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Angles on the circle."""

from __future__ import annotations

import math
from typing import NamedTuple

LARGEST = 1e9  # beyond it [rad] a double does not resolve 1e-7 rad: no reading, but garbage
FEW_COUNTS_MARGIN = 1.5  # quanta by which a reading may be off where a turn has few
WHOLE_TURN_TOLERANCE = 0.01  # quanta by which a turn may differ from a whole number of them


class Circle(NamedTuple):
    """A joint's position format: wrap period [rad], 0 for no wrap; whether turns are counted."""

    period: float = 2.0 * math.pi
    unwrap: bool = False


def wrap(angle: float, period: float) -> float:
    """Return `angle` wrapped to [-period/2, period/2); unchanged if period is 0.

    Parameters
    ----------
    angle : rad (m where the joint is prismatic).
    period : wrap period, rad; 0 for prismatic and multi-turn joints.
    """
    if period > 0.0:
        return angle - period * math.floor(angle / period + 0.5)
    return angle


def is_next_count(off: float, quantum: float, period: float) -> bool:
    """Return True if a reading may be `off` [rad] because a turn has few counts: it is the next.

    Parameters
    ----------
    quantum : smallest step of the reading [rad], of which a turn must be a whole number.
    """
    return (
        abs(off) <= FEW_COUNTS_MARGIN * quantum
        and abs(wrap(period, quantum)) <= WHOLE_TURN_TOLERANCE * quantum
    )


def is_angle(measurement: float) -> bool:
    """Return False for NaN, infinities and numbers that no encoder gives [rad or m]."""
    return -LARGEST < measurement < LARGEST


def nearest_turn(angle: float, near: float, period: float) -> float:
    """Return `angle` plus the whole turns that bring it nearest to `near`.

    Parameters
    ----------
    angle, near : rad; if one of them is no angle, `angle` is returned unchanged.
    period : wrap period, rad; 0: no circle.
    """
    if period > 0.0 and is_angle(near) and is_angle(angle):
        return angle + period * math.floor((near - angle) / period + 0.5)
    return angle
