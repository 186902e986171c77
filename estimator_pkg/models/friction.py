# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Dry friction as a function of velocity."""

from __future__ import annotations

from typing import Any

import numpy as np

STRIBECK = 0.02  # default width of the smoothed sign [rad/s or m/s]


def smooth_sign(v: Any, width: float) -> Any:
    """Return tanh(v / width); for width 0 the sign of v, with 0 at 0."""
    return np.tanh(v / width) if width > 0.0 else np.sign(v)


def asymmetric(v: Any, forward: float, backward: float, width: float) -> Any:
    """Return Coulomb friction with a different level per direction: forward for v >= 0."""
    return np.where(v >= 0.0, forward, backward) * smooth_sign(v, width)
