# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Backward pass of the fixed-lag smoother, and the score of the likelihood that it shows.

The adjoint form (Bryson and Frazier 1963; Bierman 1973) needs no inverse of a covariance. Its
square and its variance are equal in the mean where the density of the jerk is right (Koopman and
Shephard 1992).
"""

from __future__ import annotations

AHEAD = 3.0  # weight of the innovations in the score, over that of the adjoint

State = tuple[float, float, float, float, float, float, float, float, float]  # x v a, P of them
Result = tuple[float, float, float, float]  # position, velocity, one standard deviation of each
# what a reading brought: (innovation over its variance, one over that variance, one over the
# variance of the reading, whether it shows the noise)
News = tuple[float, float, float, bool]
NO_NEWS: News = (0.0, 0.0, 0.0, False)


def widened(state: State, scale: float) -> State:
    """Return the state as a steady one is with a density scale^6 times as large."""
    x, v, a, p00, p01, p02, p11, p12, p22 = state
    w2 = scale * scale
    w3 = w2 * scale
    return (x, v, a, p00 * scale, p01 * w2, p02 * w3, p11 * w3, p12 * w2 * w2, p22 * w2 * w3)


def backward(
    steps: list[float], states: list[State], news: list[News], density: float, count: int
) -> tuple[list[Result], tuple[float, float], tuple[float, float, int]]:
    """Smooth backward.

    Returns
    -------
    (x, v, variance of each) for the first `count` readings. Over their steps: square of the
    adjoint, and its variance, in units of the density. Of these readings, where they show the
    noise: what their smoothed residuals have beyond their variance, the weight of this, and their
    number.
    """
    l0 = l1 = l2 = m00 = m01 = m02 = m11 = m12 = m22 = 0.0
    results = []
    square = freedom = above = weights = ahead = foreseen = 0.0
    used = 0
    for i in range(len(steps) - 1, -1, -1):
        d, g, weight, shows = news[i]
        x, v, _, p00, p01, p02, p11, p12, _ = states[i]
        if i < count:
            if i == count - 1:
                square = freedom = 0.0
            w0 = m00 * p00 + m01 * p01 + m02 * p02
            w1 = m01 * p00 + m11 * p01 + m12 * p02
            w2 = m02 * p00 + m12 * p01 + m22 * p02
            of_x = p00 - (p00 * w0 + p01 * w1 + p02 * w2)
            w0 = m00 * p01 + m01 * p11 + m02 * p12
            w1 = m01 * p01 + m11 * p11 + m12 * p12
            w2 = m02 * p01 + m12 * p11 + m22 * p12
            of_v = p11 - (p01 * w0 + p11 * w1 + p12 * w2)
            moved = p00 * l0 + p01 * l1 + p02 * l2
            results.append(
                (
                    x - moved,
                    v - (p01 * l0 + p11 * l1 + p12 * l2),
                    of_x if of_x > 0.0 else 0.0,
                    of_v if of_v > 0.0 else 0.0,
                )
            )
            if shows:
                u = d + weight * moved
                above += u * u + weight * (weight * of_x - 1.0)
                weights += weight * weight
                used += 1
            if shows:
                part = 1.0 - g / weight
                ahead += part * d * d / g
                foreseen += part
        if weight > 0.0:  # through the reading: (I - K H)' l - H' e / S, with K = P H' weight
            kept, k1, k2 = g / weight, p01 * weight, p02 * weight
            l0 = kept * l0 - k1 * l1 - k2 * l2 - d
            u0 = kept * m00 - k1 * m01 - k2 * m02
            u1 = kept * m01 - k1 * m11 - k2 * m12
            u2 = kept * m02 - k1 * m12 - k2 * m22
            m00 = kept * u0 - k1 * u1 - k2 * u2 + g
            m01, m02 = u1, u2
        h = steps[i]  # through the prediction: F' l and F' M F
        k = 0.5 * h * h
        l2 += h * l1 + k * l0
        l1 += h * l0
        a1 = m01 + h * m00
        a2 = m02 + h * m01 + k * m00
        b2 = m12 + h * m11 + k * m01
        m22 += h * m12 + k * m02 + h * b2 + k * a2
        m12 = b2 + h * a2
        m11 += h * m01 + h * a1
        m01, m02 = a1, a2
        square += h * l2 * l2
        freedom += h * m22
    results.reverse()
    score = density * square + AHEAD * ahead, density * freedom + AHEAD * foreseen
    return results, score, (above, weights, used)
