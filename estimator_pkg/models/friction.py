"""Dry friction as a function of velocity."""

from __future__ import annotations

import math

STRIBECK = 0.02  # rad/s or m/s: width of the change of sign where none is given


def smooth_sign(v: float, width: float) -> float:
    """tanh(v / width); the plain sign, with 0 at 0, where width is 0."""
    if width > 0.0:
        return math.tanh(v / width)
    return 1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0


def asymmetric(v: float, forward: float, backward: float, width: float) -> float:
    """Coulomb friction whose level differs with the direction: forward for v >= 0."""
    return (forward if v >= 0.0 else backward) * smooth_sign(v, width)
