# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The transformation of Clarke between three phases and a vector (alpha, beta)."""

from __future__ import annotations

import math


def clarke(a: float, b: float, c: float) -> tuple[float, float]:
    """Return (alpha, beta) of three phase quantities, amplitude-invariant, no zero sequence."""
    return (2.0 * a - b - c) / 3.0, (b - c) / math.sqrt(3.0)


def phases(alpha: float, beta: float) -> tuple[float, float, float]:
    """Return (a, b, c) of an amplitude-invariant vector, without a zero-sequence component."""
    half = 0.5 * math.sqrt(3.0) * beta
    return alpha, -0.5 * alpha + half, -0.5 * alpha - half
