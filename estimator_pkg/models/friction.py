# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Dry friction as a function of velocity."""

from __future__ import annotations

import math

STRIBECK = 0.02  # default width of the smoothed sign [rad/s or m/s]


def smooth_sign(v: float, width: float) -> float:
    """Return tanh(v / width); for width 0 the sign of v, with 0 at 0."""
    if width > 0.0:
        return math.tanh(v / width)
    return 1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0


def asymmetric(v: float, forward: float, backward: float, width: float) -> float:
    """Return Coulomb friction with a different level per direction: forward for v >= 0."""
    return (forward if v >= 0.0 else backward) * smooth_sign(v, width)
