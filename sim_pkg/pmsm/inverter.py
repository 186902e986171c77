# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The inverter: voltage limit, dead time, and the three-phase bridge that switches.

A period of the carrier starts at its valley, where all three low-side switches are on. All
functions are in the subset that the engine has.
"""

from __future__ import annotations

import math

from sim_pkg.pmsm.plant import Plant, move

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


def edges(
    voltage: complex, current: complex, dc_voltage: float, part: float
) -> tuple[float, float, float, float, float, float]:
    """Return when each phase goes high and low, as fractions of the period: (a, a, b, b, c, c).

    The common part of the three duties is centred (min-max). While both switches of a leg are open
    the current decides: a positive one delays the rising edge, a negative one the falling edge.
    """
    half = HALF_ROOT_3 * voltage.imag
    a, b, c = voltage.real, half - 0.5 * voltage.real, -half - 0.5 * voltage.real
    middle = 0.5 * (max(a, b, c) + min(a, b, c))
    scale = 0.5 / dc_voltage
    sign_a, sign_b, sign_c = phase_signs(current)
    da = 0.25 + (a - middle) * scale  # half of each duty
    db = 0.25 + (b - middle) * scale
    dc = 0.25 + (c - middle) * scale
    ra, rb, rc = max(0.0, sign_a) * part, max(0.0, sign_b) * part, max(0.0, sign_c) * part
    fa, fb, fc = max(0.0, -sign_a) * part, max(0.0, -sign_b) * part, max(0.0, -sign_c) * part
    return (
        0.5 - da + ra,
        0.5 + da + fa,
        0.5 - db + rb,
        0.5 + db + fb,
        0.5 - dc + rc,
        0.5 + dc + fc,
    )


def switch(
    current: complex,
    theta: float,
    speed: float,
    load: float,
    plant: Plant,
    voltage: complex,
    dc_voltage: float,
    dead: float,
    period: float,
) -> tuple[complex, float, float]:
    """Return (current, electrical angle, speed) after a carrier period.

    Parameters
    ----------
    voltage : commanded for this period [V].
    dead : dead time over period.
    """
    on_a, off_a, on_b, off_b, on_c, off_c = edges(voltage, current, dc_voltage, dead)
    now = 0.0
    while now < 1.0:
        until = 1.0
        for edge in (on_a, off_a, on_b, off_b, on_c, off_c):
            if now < edge < until:
                until = edge
        middle = 0.5 * (now + until)
        a = 1.0 if on_a < middle < off_a else 0.0
        b = 1.0 if on_b < middle < off_b else 0.0
        c = 1.0 if on_c < middle < off_c else 0.0
        vector = dc_voltage * complex((2.0 * a - b - c) / 3.0, (b - c) / (2.0 * HALF_ROOT_3))
        current, theta, speed = move(
            current, vector, theta, speed, load, plant, (until - now) * period
        )
        now = until
    return current, theta, speed
