# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The smoother of a window, forward and backward, against Gaussian conditioning of all its states.

The conditional mean and covariance of all states given all readings need no recursion. What the
adjoint shows follows from them: with filtered (f) and smoothed (s) states, the adjoint before a
reading's step is P_f^-1 (x_f - x_s), and its variance P_f^-1 (P_f - P_s) P_f^-1.
"""

import numpy as np
import pytest

from estimator_pkg.observers.angle.adjoint import NO_NEWS, backward
from estimator_pkg.observers.angle.smoother import Smoother

DENSITY, NOISE, COUNT, READINGS, STRAY = 3e4, 1e-6, 7, 12, 4
FIRST = np.array([0.2, 1.0, -3.0])  # x, v, a at the last result
COVARIANCE = np.array([[2e-6, 1e-5, 2e-4], [1e-5, 3e-2, 0.1], [2e-4, 0.1, 20.0]])
UPPER = np.triu_indices(3)


def transition(h):
    """Of x, v and a over h [s]: (transition matrix, covariance of white jerk of unit density)."""
    return np.array([[1.0, h, h**2 / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]]), np.array(
        [
            [h**5 / 20.0, h**4 / 8.0, h**3 / 6.0],
            [h**4 / 8.0, h**3 / 3.0, h**2 / 2.0],
            [h**3 / 6.0, h**2 / 2.0, h],
        ]
    )


def conditional(steps, readings, used):
    """(mean (n + 1, 3), covariance (n + 1, 3, 3)) of the states, the first before all steps."""
    n = len(steps) + 1
    mean, covariance = np.zeros(3 * n), np.zeros((3 * n, 3 * n))
    mean[:3], covariance[:3, :3] = FIRST, COVARIANCE
    for k, h in enumerate(steps, 1):
        f, q = transition(h)
        here, before = slice(3 * k, 3 * k + 3), slice(3 * k - 3, 3 * k)
        mean[here] = f @ mean[before]
        covariance[here, : 3 * k] = f @ covariance[before, : 3 * k]
        covariance[: 3 * k, here] = covariance[here, : 3 * k].T
        covariance[here, here] = f @ covariance[before, before] @ f.T + DENSITY * q
    rows = [3 * k + 3 for k in used]
    gain = np.linalg.solve(
        covariance[np.ix_(rows, rows)] + NOISE * np.eye(len(rows)), covariance[rows]
    ).T
    mean += gain @ (np.asarray(readings)[list(used)] - mean[rows])
    covariance -= gain @ covariance[rows]
    blocks = covariance.reshape(n, 3, n, 3)
    return mean.reshape(n, 3), np.array([blocks[k, :, k] for k in range(n)])


def window():
    """(steps, readings with a stray one, the other readings) of a joint that accelerates."""
    random = np.random.default_rng(1)
    steps = random.uniform(4e-3, 15e-3, READINGS)
    times = np.cumsum(steps)
    readings = 0.2 + times - 30.0 * times**2 + 1e-3 * random.standard_normal(READINGS)
    readings[STRAY] += 1.0
    return steps.tolist(), readings.tolist(), [k for k in range(READINGS) if k != STRAY]


def test_the_smoother_is_the_conditional_mean_with_its_variance():
    steps, readings, used = window()
    smoother = Smoother(0.1, 0.0)
    smoother.noise = NOISE
    state = (*FIRST.tolist(), *COVARIANCE[UPPER].tolist())
    states, news, size, number = smoother._forward(
        state, DENSITY, steps, readings, np.diff(readings, prepend=0.2).tolist()
    )
    results, (square, freedom), (above, weights, count) = backward(steps, states, news, 0.0, COUNT)
    assert news[STRAY] == NO_NEWS and number == READINGS - 1

    filtered = [conditional(steps, readings, [k for k in used if k < n]) for n in range(13)]
    for k in range(READINGS):
        mean, covariance = (each[k + 1] for each in filtered[k + 1])
        assert states[k][:3] == pytest.approx(mean, rel=1e-7)
        assert states[k][3:] == pytest.approx(covariance[UPPER], rel=1e-6)
    mean, covariance = conditional(steps, readings, used)
    everything, _, _ = backward(steps, states, news, 0.0, READINGS)
    assert results == everything[:COUNT]
    for k, (x, v, of_x, of_v) in enumerate(everything):
        assert (x, v) == pytest.approx(mean[k + 1, :2], rel=1e-8)
        assert (of_x, of_v) == pytest.approx(np.diag(covariance[k + 1])[:2], rel=1e-5)

    # size of the innovations, and by how much the smoothed residuals exceed their variance
    known = [k for k in used if k < COUNT]
    squares, foreseen = [], []
    for k in used:
        f, q = transition(steps[k])
        before, of_it = (each[k] for each in filtered[k])
        ahead = (f @ of_it @ f.T + DENSITY * q)[0, 0]
        squares.append((readings[k] - (f @ before)[0]) ** 2 / (ahead + NOISE))
        foreseen.append(ahead / (ahead + NOISE))
    assert size == pytest.approx(sum(squares), rel=1e-6)
    residuals = (np.array(readings) - mean[1:, 0]) ** 2 + covariance[1:, 0, 0] - NOISE
    assert count == len(known)
    assert above / weights == pytest.approx(np.mean(residuals[known]), rel=1e-5)

    # the score: square of the adjoint and its variance, and the same of the innovations
    pairs = [(0.0, 0.0)]
    for k in range(COUNT):
        (before, p), after = (each[k] for each in filtered[k]), mean[k]
        inverse = np.linalg.inv(p)
        adjoint = inverse @ (before - after)
        variance = inverse @ (p - covariance[k]) @ inverse
        pairs.append((steps[k] * adjoint[2] ** 2, steps[k] * variance[2, 2]))
    squared, varied = np.sum(pairs, axis=0)
    inner = [each for each, k in zip(zip(squares, foreseen), used) if k < COUNT]
    _, (with_square, with_freedom), _ = backward(steps, states, news, DENSITY, COUNT)
    assert (with_square - square) / DENSITY == pytest.approx(squared, rel=1e-4)
    assert (with_freedom - freedom) / DENSITY == pytest.approx(varied, rel=1e-4)
    assert square == pytest.approx(3.0 * sum(part * each for each, part in inner), rel=1e-6)
    assert freedom == pytest.approx(3.0 * sum(part for _, part in inner), rel=1e-6)
