# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The sample-by-sample functions of the off-line smoother, which Numba compiles.

State (q, v, a) driven by white jerk of intensity `qc`, measured position with variance `r`, the
inverse of a reading's weight:

    F = [[1, h, h^2/2], [0, 1, h], [0, 0, 1]]
    Q = qc [[h^5/20, h^4/8, h^3/6], [h^4/8, h^3/3, h^2/2], [h^3/6, h^2/2, h]]

Forward it is a Kalman filter with a wrapped innovation; backward the adjoint form of the
fixed-interval smoother (Bierman 1973), equal to Rauch, Tung and Striebel without inverting a
covariance. A state is (q, v, a, p00, p01, p02, p11, p12, p22).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UNSETTLED = 5  # innovations at the start of a piece depend more on its start than on the noise


def predict(x: tuple, h: float, qc: float) -> tuple:
    """Return the state `h` seconds later."""
    q, v, a, p00, p01, p02, p11, p12, p22 = x
    k = 0.5 * h * h
    a0 = p00 + h * p01 + k * p02
    a1 = p01 + h * p11 + k * p12
    a2 = p02 + h * p12 + k * p22
    b1 = p11 + h * p12
    b2 = p12 + h * p22
    return (
        q + h * v + k * a,
        v + h * a,
        a,
        a0 + h * a1 + k * a2 + qc * h * h * h * h * h / 20.0,
        a1 + h * a2 + qc * h * h * h * h / 8.0,
        a2 + qc * h * h * h / 6.0,
        b1 + h * b2 + qc * h * h * h / 3.0,
        b2 + qc * k,
        p22 + qc * h,
    )


def correct(x: tuple, e: float, weight: float) -> tuple:
    """Return the state after a reading with innovation `e`."""
    q, v, a, p00, p01, p02, p11, p12, p22 = x
    kept = 1.0 / (1.0 + weight * p00)
    g = weight * kept
    return (
        q + p00 * g * e,
        v + p01 * g * e,
        a + p02 * g * e,
        p00 * kept,
        p01 * kept,
        p02 * kept,
        p11 - g * p01 * p01,
        p12 - g * p01 * p02,
        p22 - g * p02 * p02,
    )


def _wrap(e: float, period: float) -> float:
    """Return `e` in [-period/2, period/2); unchanged for period 0."""
    if period > 0.0:
        return e - period * math.floor(e / period + 0.5)
    return e


def likelihood(
    start: tuple, steps: Array, readings: Array, r: float, qc: float, period: float
) -> tuple[float, float, int]:
    """Return (sum of log S, sum of e^2 / S, their number) over the innovations of one piece.

    Parameters
    ----------
    start : the state at the first reading, which it already includes.
    steps : shape (n,), time since the previous reading [s]; the first is not used.
    readings : shape (n,); nan: no reading.
    """
    x = start
    logs, squares, count = 0.0, 0.0, 0
    for i in range(1, len(readings)):
        x = predict(x, steps[i], qc)
        y = readings[i]
        if y == y:
            e = _wrap(y - x[0], period)
            s = x[3] + r
            if i > UNSETTLED:
                logs += math.log(s)
                squares += e * e / s
                count += 1
            x = correct(x, e, 1.0 / r)
    return logs, squares, count


def forward(
    x: tuple,
    steps: Array,
    readings: Array,
    weights: Array,
    qc: float,
    period: float,
    states: Array,
    innovations: Array,
) -> tuple:
    """Run the filter from the state `x` over a stretch; return the state after its last reading.

    Parameters
    ----------
    weights : shape (n,), inverse variances of the readings; 0: no reading.
    states : shape (n, 9), filled with the state after each reading.
    innovations : shape (n, 2), filled with (e / S, 1 / S), S being the innovation's variance.
    """
    for i in range(len(readings)):
        x = predict(x, steps[i], qc)
        w = weights[i]
        if w > 0.0:
            e = _wrap(readings[i] - x[0], period)
            g = w / (1.0 + w * x[3])
            innovations[i, 0] = e * g
            innovations[i, 1] = g
            x = correct(x, e, w)
        else:
            innovations[i, 0] = 0.0
            innovations[i, 1] = 0.0
        for j in range(9):
            states[i, j] = x[j]
    return x


def backward(
    adjoint: tuple, steps: Array, weights: Array, states: Array, innovations: Array, smoothed: Array
) -> tuple:
    """Run backward over the same stretch; return the adjoint before its first reading.

    Parameters
    ----------
    adjoint : (l0, l1, l2, m00, m01, m02, m11, m12, m22), from the readings after the stretch.
    smoothed : shape (n, 4), filled with position, velocity and the standard deviation of each.
    """
    l0, l1, l2, m00, m01, m02, m11, m12, m22 = adjoint
    for i in range(len(steps) - 1, -1, -1):
        q, v = states[i, 0], states[i, 1]
        p00, p01, p02 = states[i, 3], states[i, 4], states[i, 5]
        p11, p12 = states[i, 6], states[i, 7]
        smoothed[i, 0] = q - (p00 * l0 + p01 * l1 + p02 * l2)
        smoothed[i, 1] = v - (p01 * l0 + p11 * l1 + p12 * l2)
        w0 = m00 * p00 + m01 * p01 + m02 * p02
        w1 = m01 * p00 + m11 * p01 + m12 * p02
        w2 = m02 * p00 + m12 * p01 + m22 * p02
        smoothed[i, 2] = math.sqrt(max(p00 - (p00 * w0 + p01 * w1 + p02 * w2), 0.0))
        w0 = m00 * p01 + m01 * p11 + m02 * p12
        w1 = m01 * p01 + m11 * p11 + m12 * p12
        w2 = m02 * p01 + m12 * p11 + m22 * p12
        smoothed[i, 3] = math.sqrt(max(p11 - (p01 * w0 + p11 * w1 + p12 * w2), 0.0))
        w = weights[i]
        if w > 0.0:  # through the measurement: (I - K H)' l - H' e / S, with K = P H' w
            kept, k1, k2 = innovations[i, 1] / w, p01 * w, p02 * w  # 1 - k0, not subtracted
            l0 = kept * l0 - k1 * l1 - k2 * l2 - innovations[i, 0]
            u0 = kept * m00 - k1 * m01 - k2 * m02
            u1 = kept * m01 - k1 * m11 - k2 * m12
            u2 = kept * m02 - k1 * m12 - k2 * m22
            m00 = kept * u0 - k1 * u1 - k2 * u2 + innovations[i, 1]
            m01, m02 = u1, u2
        h = steps[i]  # through the prediction: F' l and F' M F
        k = 0.5 * h * h
        l2 = l2 + h * l1 + k * l0
        l1 = l1 + h * l0
        a1 = m01 + h * m00
        a2 = m02 + h * m01 + k * m00
        b1 = m11 + h * m01
        b2 = m12 + h * m11 + k * m01
        c2 = m22 + h * m12 + k * m02
        m22 = c2 + h * b2 + k * a2
        m12 = b2 + h * a2
        m11 = b1 + h * a1
        m01, m02 = a1, a2
    return l0, l1, l2, m00, m01, m02, m11, m12, m22
