# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Discretisation of the observer: exact for the linear fast part, rotation on the unit circle.

In the estimated frame the current and back-EMF estimates obey a linear system with constant
coefficients, driven by measured current and voltage. Its solution over one sample is the matrix
exponential. The current is interpolated linearly in the frame; the voltage is its rotated mean. The
scheme is stable for every sample time and all gains.
"""

from __future__ import annotations

import math
from cmath import rect

FASTEST = 1e6  # rad/s: the frame speed saturates here, so that a diverging frame stays finite
SMALLEST_SINC = 0.2  # the voltage's mean is corrected for rotation down to this sin(a)/a
LARGEST_STRETCH = 1.0 / SMALLEST_SINC


def exponential(
    a: float, b: float, c: float, d: float, dt: float
) -> tuple[float, float, float, float]:
    """Return exp([[a, b], [c, d]] dt), row by row, in closed form.

    With the mean m of the diagonal, A - m I squares to a multiple of I.
    """
    mean = 0.5 * (a + d) * dt
    half = 0.5 * (a - d)
    square = (half * half + b * c) * dt * dt
    if square > 1e-8:
        root = math.sqrt(square)
        slow, fast = math.exp(mean + root), math.exp(mean - root)  # cosh alone might overflow
        even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast) / root * dt
    elif square < -1e-8:
        root, scale = math.sqrt(-square), math.exp(mean)
        even, odd = scale * math.cos(root), scale * math.sin(root) / root * dt
    else:
        scale = math.exp(mean)
        even, odd = scale * (1.0 + 0.5 * square), scale * (1.0 + square / 6.0) * dt
    return even + odd * half, odd * b, odd * c, even - odd * half


def prepare_scheme(
    resistance: float, inductance: float, k_p: float, k_i: float, dt: float
) -> tuple[float, ...]:
    """Return the coefficients of one step that depend on dt [s].

    With A0 = [[-(R/L + kp), 1/L], [-ki, 0]]: E = exp(A0 dt), G0 = A0^-1 (E - I),
    G1 = A0^-1 (G0/dt - I). G0 multiplies the value of the drive at the start, G1 its change.

    Returns
    -------
    dt, E11, E12, E21, E22, then five weights for the current and five for the back-EMF: of the
    voltage, of the current at the start, of -j w times it, of the current's change, and of -j w
    times that.
    """
    a, b, c = -(resistance / inductance + k_p), 1.0 / inductance, -k_i
    e11, e12, e21, e22 = exponential(a, b, c, 0.0, dt)
    # A0^-1 = [[0, 1/c], [1/b, -a/(b c)]]
    i12, i21, i22 = 1.0 / c, 1.0 / b, -a / (b * c)
    p11, p12, p21, p22 = e11 - 1.0, e12, e21, e22 - 1.0
    g11, g12 = i12 * p21, i12 * p22
    g21, g22 = i21 * p11 + i22 * p21, i21 * p12 + i22 * p22
    q11, q12, q21, q22 = g11 / dt - 1.0, g12 / dt, g21 / dt, g22 / dt - 1.0
    f11, f12 = i12 * q21, i12 * q22
    f21, f22 = i21 * q11 + i22 * q21, i21 * q12 + i22 * q22
    return (
        dt,
        e11,
        e12,
        e21,
        e22,
        g11 * b,
        g11 * k_p + g12 * k_i,
        g11,
        f11 * k_p + f12 * k_i,
        f11,
        g21 * b,
        g21 * k_p + g22 * k_i,
        g21,
        f21 * k_p + f22 * k_i,
        f21,
    )


def advance(
    i: complex,
    h: complex,
    z: complex,
    x: float,
    before: complex,
    now: complex,
    voltage: complex,
    scheme: tuple,
    k_eta: float,
    gamma: float,
    turning: float,
) -> tuple[complex, complex, complex, float, float]:
    """Return (i, h, z, x, frame speed) after one more sample.

    The frame speed is computed in two passes: predicted, then the mean of both ends. They are
    written out, because in plain Python this function takes half the time of a sample. The caller
    normalises z at every clock tick.

    Parameters
    ----------
    before, now : measured current at both ends of the interval [A], static frame.
    voltage : mean voltage over the interval [V], static frame.
    scheme : from `prepare_scheme`.
    turning : speed [rad/s] added to that of the frame; 0 unless the rotor is being searched.
    """
    (dt, e11, e12, e21, e22, iu, ia, iw, idd, idw, hu, ha, hw, hdd, hdw) = scheme
    half_dt = 0.5 * dt
    half_gain = gamma * half_dt
    back = z.conjugate()
    start = back * before
    end = back * now
    drive = back * voltage
    pull = h.real
    first = abs(h) * x + k_eta * pull + turning
    if not -FASTEST < first < FASTEST:
        first = FASTEST if first > 0.0 else -FASTEST
    lean = x + half_gain * pull
    # in the frame the current goes from start to moved = end, turned back: the terms with start are
    # the same in both passes, those with moved are not
    base_h = e21 * i + e22 * h + (ha - hdd) * start
    lag_h = (hw - hdw) * start
    # first pass
    angle = first * half_dt
    half_turn = rect(1.0, -angle)
    sine = -half_turn.imag
    if sine * angle > SMALLEST_SINC * angle * angle:
        mean = angle / sine
    else:
        mean = 1.0 if angle == 0.0 else LARGEST_STRETCH
    moved = end * half_turn * half_turn
    new_h = (
        base_h
        + (hu * mean) * (drive * half_turn)
        + hdd * moved
        - (first * 1j) * (lag_h + hdw * moved)
    )
    pull = new_h.real
    speed = 0.5 * (first + abs(new_h) * (lean + half_gain * pull) + k_eta * pull + turning)
    if not -FASTEST < speed < FASTEST:
        speed = FASTEST if speed > 0.0 else -FASTEST
    # second pass
    angle = speed * half_dt
    half_turn = rect(1.0, -angle)
    sine = -half_turn.imag
    if sine * angle > SMALLEST_SINC * angle * angle:
        mean = angle / sine
    else:
        mean = 1.0 if angle == 0.0 else LARGEST_STRETCH
    turn = half_turn * half_turn
    moved = end * turn
    mean_drive = mean * (drive * half_turn)
    lead = speed * 1j
    new_h = base_h + hu * mean_drive + hdd * moved - lead * (lag_h + hdw * moved)
    new_i = (
        e11 * i
        + e12 * h
        + (ia - idd) * start
        + iu * mean_drive
        + idd * moved
        - lead * ((iw - idw) * start + idw * moved)
    )
    return new_i, new_h, z * turn.conjugate(), lean + half_gain * new_h.real, speed


def turned_emf(before: complex, now: complex, dt: float) -> tuple[complex, float]:
    """Return (integral of y over the sample [V s], the angle by which y turned [rad]).

    The trapezoidal rule times tan(a)/a, with a half the turned angle, is exact for a vector that
    turns at constant speed.
    """
    product = before.conjugate() * now
    turned = math.atan2(product.imag, product.real)
    half = 0.5 * turned
    stretch = 1.0
    if 1e-4 < half < 1.4 or -1.4 < half < -1e-4:
        stretch = math.tan(half) / half
    return (before + now) * (0.5 * dt * stretch), turned
