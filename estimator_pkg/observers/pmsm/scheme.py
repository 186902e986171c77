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

from estimator_pkg.observers.pmsm.drive import DriveSample
from estimator_pkg.observers.pmsm.state import Core, Scheme

FRAME_SPEED_LIMIT = 1e6  # rad/s: the frame speed saturates here, so that it stays finite
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
    scheme: Scheme, resistance: float, inductance: float, k_p: float, k_i: float, dt: float
) -> None:
    """Set the coefficients of one step that depend on dt [s].

    With A0 = [[-(R/L + kp), 1/L], [-ki, 0]]: E = exp(A0 dt), G0 = A0^-1 (E - I),
    G1 = A0^-1 (G0/dt - I). G0 multiplies the value of the drive at the start, G1 its change.
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
    scheme.dt, scheme.e11, scheme.e12, scheme.e21, scheme.e22 = dt, e11, e12, e21, e22
    scheme.iu, scheme.ia, scheme.iw = g11 * b, g11 * k_p + g12 * k_i, g11
    scheme.idd, scheme.idw = f11 * k_p + f12 * k_i, f11
    scheme.hu, scheme.ha, scheme.hw = g21 * b, g21 * k_p + g22 * k_i, g21
    scheme.hdd, scheme.hdw = f21 * k_p + f22 * k_i, f21


def half_turn(angle: float) -> tuple[float, float, float]:
    """Return cos and sin of half a sample's rotation, and what its mean lacks of the voltage."""
    sine = math.sin(angle)
    if sine * angle > SMALLEST_SINC * angle * angle:
        return math.cos(angle), sine, angle / sine
    return math.cos(angle), sine, 1.0 if angle == 0.0 else LARGEST_STRETCH


def advance(
    core: Core,
    scheme: Scheme,
    acting: DriveSample,
    x: float,
    k_eta: float,
    gamma: float,
    turning: float,
) -> tuple[float, float]:
    """Advance i, h and z by one more sample; return (x after it, frame speed).

    The frame speed is computed in two passes: predicted, then the mean of both ends. They are
    written out, because in plain Python this function takes half the time of a sample. The caller
    normalises z at every clock tick.

    Parameters
    ----------
    acting : current at the end of the interval [A] (that at its start is in `core`), and mean
        voltage over it [V].
    turning : speed [rad/s] added to that of the frame; 0 unless the rotor is being searched.
    """
    i1, i2, h1, h2, z1, z2 = core.i1, core.i2, core.h1, core.h2, core.z1, core.z2
    half_dt = 0.5 * scheme.dt
    half_gain = gamma * half_dt
    s1, s2 = z1 * core.i_alpha + z2 * core.i_beta, z1 * core.i_beta - z2 * core.i_alpha
    i_alpha, i_beta, u_alpha, u_beta = acting.i_alpha, acting.i_beta, acting.u_alpha, acting.u_beta
    end1, end2 = z1 * i_alpha + z2 * i_beta, z1 * i_beta - z2 * i_alpha
    drive1, drive2 = z1 * u_alpha + z2 * u_beta, z1 * u_beta - z2 * u_alpha
    first = abs(complex(h1, h2)) * x + k_eta * h1 + turning
    if not -FRAME_SPEED_LIMIT < first < FRAME_SPEED_LIMIT:
        first = FRAME_SPEED_LIMIT if first > 0.0 else -FRAME_SPEED_LIMIT
    lean = x + half_gain * h1
    # in the frame the current goes from s to m = end, turned back: the terms with s are the same in
    # both passes, those with m are not
    e21, e22, hu, hdd, hdw = scheme.e21, scheme.e22, scheme.hu, scheme.hdd, scheme.hdw
    a, w = scheme.ha - hdd, scheme.hw - hdw
    base1, base2 = e21 * i1 + e22 * h1 + a * s1, e21 * i2 + e22 * h2 + a * s2
    # first pass
    cosine, sine, mean = half_turn(first * half_dt)
    m1, m2 = end1 * cosine + end2 * sine, end2 * cosine - end1 * sine
    m1, m2 = m1 * cosine + m2 * sine, m2 * cosine - m1 * sine
    u1, u2 = drive1 * cosine + drive2 * sine, drive2 * cosine - drive1 * sine
    p1 = base1 + hu * mean * u1 + hdd * m1 + first * (w * s2 + hdw * m2)
    p2 = base2 + hu * mean * u2 + hdd * m2 - first * (w * s1 + hdw * m1)
    size = abs(complex(p1, p2))
    speed = 0.5 * (first + size * (lean + half_gain * p1) + k_eta * p1 + turning)
    if not -FRAME_SPEED_LIMIT < speed < FRAME_SPEED_LIMIT:
        speed = FRAME_SPEED_LIMIT if speed > 0.0 else -FRAME_SPEED_LIMIT
    # second pass
    cosine, sine, mean = half_turn(speed * half_dt)
    turn1, turn2 = cosine * cosine - sine * sine, cosine * sine + sine * cosine
    m1, m2 = end1 * turn1 + end2 * turn2, end2 * turn1 - end1 * turn2
    u1, u2 = drive1 * cosine + drive2 * sine, drive2 * cosine - drive1 * sine
    u1, u2 = mean * u1, mean * u2
    core.h1 = base1 + hu * u1 + hdd * m1 + speed * (w * s2 + hdw * m2)
    core.h2 = base2 + hu * u2 + hdd * m2 - speed * (w * s1 + hdw * m1)
    e11, e12, iu, idd, idw = scheme.e11, scheme.e12, scheme.iu, scheme.idd, scheme.idw
    a, w = scheme.ia - idd, scheme.iw - idw
    core.i1 = e11 * i1 + e12 * h1 + a * s1 + iu * u1 + idd * m1 + speed * (w * s2 + idw * m2)
    core.i2 = e11 * i2 + e12 * h2 + a * s2 + iu * u2 + idd * m2 - speed * (w * s1 + idw * m1)
    core.z1, core.z2 = z1 * turn1 - z2 * turn2, z1 * turn2 + z2 * turn1
    return lean + half_gain * core.h1, speed


def turned_emf(
    before_alpha: float, before_beta: float, y_alpha: float, y_beta: float, dt: float
) -> tuple[float, float, float]:
    """Return (integral of y over the sample [V s], two numbers, the angle by which y turned [rad]).

    The trapezoidal rule times tan(a)/a, with a half the turned angle, is exact for a vector that
    turns at constant speed.
    """
    turned = math.atan2(
        before_alpha * y_beta - before_beta * y_alpha, before_alpha * y_alpha + before_beta * y_beta
    )
    half = 0.5 * turned
    stretch = 1.0
    if 1e-4 < half < 1.4 or -1.4 < half < -1e-4:
        stretch = math.tan(half) / half
    scale = 0.5 * dt * stretch
    return (before_alpha + y_alpha) * scale, (before_beta + y_beta) * scale, turned
