# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The sample-by-sample functions of the off-line smoother, in the subset that the engine has.

State (q, v, a) driven by white jerk of intensity `qc`, measured position with variance `r`, the
inverse of a reading's weight:

    F = [[1, h, h^2/2], [0, 1, h], [0, 0, 1]]
    Q = qc [[h^5/20, h^4/8, h^3/6], [h^4/8, h^3/3, h^2/2], [h^3/6, h^2/2, h]]

Forward it is a Kalman filter with a wrapped innovation; backward the adjoint form of the
fixed-interval smoother (Bierman 1973), equal to Rauch, Tung and Striebel without inverting a
covariance. The functions get an array of shape (n, m) flat, row by row.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.record import record

Array = NDArray[np.float64]

SIZE = 9  # numbers of a state


@record
class SmootherState:
    """A state and its covariance."""

    q: float
    v: float
    a: float
    p00: float
    p01: float
    p02: float
    p11: float
    p12: float
    p22: float


def put(states: Array, row: int, x: SmootherState) -> None:
    """Write a state to a row."""
    at = SIZE * row
    states[at], states[at + 1], states[at + 2] = x.q, x.v, x.a
    states[at + 3], states[at + 4], states[at + 5] = x.p00, x.p01, x.p02
    states[at + 6], states[at + 7], states[at + 8] = x.p11, x.p12, x.p22


def get(x: SmootherState, states: Array, row: int) -> None:
    """Read the state of a row."""
    at = SIZE * row
    x.q, x.v, x.a = states[at], states[at + 1], states[at + 2]
    x.p00, x.p01, x.p02 = states[at + 3], states[at + 4], states[at + 5]
    x.p11, x.p12, x.p22 = states[at + 6], states[at + 7], states[at + 8]


def predict(x: SmootherState, h: float, qc: float) -> None:
    """Move the state by `h` seconds."""
    k = 0.5 * h * h
    a1 = x.p01 + h * x.p11 + k * x.p12
    a2 = x.p02 + h * x.p12 + k * x.p22
    b2 = x.p12 + h * x.p22
    x.q = x.q + h * x.v + k * x.a
    x.v = x.v + h * x.a
    x.p00 = x.p00 + h * x.p01 + k * x.p02 + h * a1 + k * a2 + qc * h * h * h * h * h / 20.0
    x.p01 = a1 + h * a2 + qc * h * h * h * h / 8.0
    x.p02 = a2 + qc * h * h * h / 6.0
    x.p11 = x.p11 + h * x.p12 + h * b2 + qc * h * h * h / 3.0
    x.p12 = b2 + qc * k
    x.p22 = x.p22 + qc * h


def correct(x: SmootherState, push: float, weight: float) -> None:
    """Correct the state by a reading.

    Parameters
    ----------
    weight : inverse variance of the reading. push : that times its innovation.
    """
    kept = 1.0 / (1.0 + weight * x.p00)
    e, g = push * kept, weight * kept
    x.q = x.q + x.p00 * e
    x.v = x.v + x.p01 * e
    x.a = x.a + x.p02 * e
    x.p11 = x.p11 - g * x.p01 * x.p01
    x.p12 = x.p12 - g * x.p01 * x.p02
    x.p22 = x.p22 - g * x.p02 * x.p02
    x.p00 = x.p00 * kept
    x.p01 = x.p01 * kept
    x.p02 = x.p02 * kept


def _wrap(e: float, period: float) -> float:
    """Return `e` in [-period/2, period/2); unchanged for period 0."""
    if period > 0.0:
        return e - period * math.floor(e / period + 0.5)
    return e


def forward(
    start: SmootherState,
    count: int,
    steps: Array,
    readings: Array,
    weights: Array,
    qc: float,
    period: float,
    states: Array,
    innovations: Array,
) -> None:
    """Run the filter over a piece.

    Parameters
    ----------
    start : the state before the first reading.
    steps : shape (count,), time since the previous reading [s].
    weights : shape (count,), inverse variances of the readings; 0: no reading.
    states : shape (count, SIZE), filled with the state after each reading.
    innovations : shape (count, 2), filled with (e / S, 1 / S), S being the innovation's variance.
    """
    x = SmootherState()
    x.take(start)
    for i in range(count):
        predict(x, steps[i], qc)
        w = weights[i]
        innovations[2 * i], innovations[2 * i + 1] = 0.0, 0.0
        if w > 0.0:
            push = w * _wrap(readings[i] - x.q, period)
            kept = 1.0 / (1.0 + w * x.p00)
            innovations[2 * i], innovations[2 * i + 1] = push * kept, w * kept
            correct(x, push, w)
        put(states, i, x)


def backward(
    count: int, steps: Array, weights: Array, states: Array, innovations: Array, smoothed: Array
) -> None:
    """Run backward over the same piece.

    Parameters
    ----------
    smoothed : shape (count, 4), filled with position, velocity and the standard deviation of each.
    """
    x = SmootherState()
    l0 = l1 = l2 = 0.0  # adjoint: what later readings say about a state, and its variance
    m00 = m01 = m02 = m11 = m12 = m22 = 0.0
    for i in range(count - 1, -1, -1):
        get(x, states, i)
        p00, p01, p02, p11, p12 = x.p00, x.p01, x.p02, x.p11, x.p12
        smoothed[4 * i] = x.q - (p00 * l0 + p01 * l1 + p02 * l2)
        smoothed[4 * i + 1] = x.v - (p01 * l0 + p11 * l1 + p12 * l2)
        w0 = m00 * p00 + m01 * p01 + m02 * p02
        w1 = m01 * p00 + m11 * p01 + m12 * p02
        w2 = m02 * p00 + m12 * p01 + m22 * p02
        smoothed[4 * i + 2] = math.sqrt(max(p00 - (p00 * w0 + p01 * w1 + p02 * w2), 0.0))
        w0 = m00 * p01 + m01 * p11 + m02 * p12
        w1 = m01 * p01 + m11 * p11 + m12 * p12
        w2 = m02 * p01 + m12 * p11 + m22 * p12
        smoothed[4 * i + 3] = math.sqrt(max(p11 - (p01 * w0 + p11 * w1 + p12 * w2), 0.0))
        w = weights[i]
        if w > 0.0:  # through the measurement: (I - K H)' l - H' e / S, with K = P H' w
            e, g = innovations[2 * i], innovations[2 * i + 1]
            kept, k1, k2 = g / w, p01 * w, p02 * w  # 1 - k0, not subtracted
            l0 = kept * l0 - k1 * l1 - k2 * l2 - e
            u0 = kept * m00 - k1 * m01 - k2 * m02
            u1 = kept * m01 - k1 * m11 - k2 * m12
            u2 = kept * m02 - k1 * m12 - k2 * m22
            m00 = kept * u0 - k1 * u1 - k2 * u2 + g
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
