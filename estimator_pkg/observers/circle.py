"""Angles on the circle."""

from __future__ import annotations

import math
from typing import NamedTuple


class Circle(NamedTuple):
    """How a joint's position is written: wrap period [rad], 0 for none; count turns or not."""

    period: float = 2.0 * math.pi
    unwrap: bool = False


def wrap(angle: float, period: float) -> float:
    """`angle` in [-period/2, period/2); unchanged where period is 0 (no circle).

    Parameters
    ----------
    angle : rad (m where the joint is prismatic).
    period : wrap period, rad; 0 for prismatic and multi-turn joints.
    """
    if period > 0.0:
        return angle - period * math.floor(angle / period + 0.5)
    return angle
