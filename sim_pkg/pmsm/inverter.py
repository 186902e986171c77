# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The inverter: voltage limit and dead time. All functions are in the subset of the engine."""

from __future__ import annotations

import math

HALF_ROOT_3 = 0.5 * math.sqrt(3.0)


def limited(voltage: complex, dc_voltage: float) -> complex:
    """Return the vector, shortened to the limit of space-vector modulation, dc_voltage/sqrt(3)."""
    size = abs(voltage)
    most = dc_voltage / math.sqrt(3.0)
    if size > most:
        return voltage * (most / size)
    return voltage


def _sign(value: float) -> float:
    if value > 0.0:
        return 1.0
    return -1.0 if value < 0.0 else 0.0


def phase_signs(current: complex) -> tuple[float, float, float]:
    """Return the signs of the three phase currents."""
    half = HALF_ROOT_3 * current.imag
    return (
        _sign(current.real),
        _sign(half - 0.5 * current.real),
        _sign(-half - 0.5 * current.real),
    )


def dead_time_error(current: complex, dc_voltage: float, part: float) -> complex:
    """Return the mean voltage lost to dead time [V]; `part` is dead time over period."""
    a, b, c = phase_signs(current)
    return dc_voltage * part * complex((2.0 * a - b - c) / 3.0, (b - c) / (2.0 * HALF_ROOT_3))
