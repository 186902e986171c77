# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The rivals are what their papers say, each on a signal on which its claim can be checked."""

import numpy as np
import pytest

from benchmarks import rivals

H = 0.01


def test_the_spline_is_the_optimum_of_its_cost_at_uneven_times():
    """Against the whole problem, solved at once for the curvature at each knot."""
    rng = np.random.default_rng(1)
    steps = H * rng.uniform(0.5, 1.5, 40)
    time = np.concatenate([[0.0], np.cumsum(steps)])
    reading = np.sin(7.0 * time) + 0.01 * rng.standard_normal(len(time))
    weight, k = 1e-4, len(time)
    # unknown: x_1, z_1 and z' at the inner knots; z'' = 0 in the first and the last interval
    bends = np.zeros((k, k))
    bends[1:-1, 2:] = np.eye(k - 2)
    bends[0], bends[-1] = bends[1], bends[-2]
    x, z = np.zeros((k, k)), np.zeros((k, k))
    x[0, 0] = z[0, 1] = 1.0
    cost = np.zeros((k, k))
    for i, h in enumerate(steps):
        old, new = bends[i], bends[i + 1]
        z[i + 1] = z[i] + h * (old + new) / 2.0
        x[i + 1] = x[i] + h * z[i] + h * h * (old / 3.0 + new / 6.0)
        mixed = np.outer(old, old) + np.outer(new, new) + 0.5 * np.outer(old, new)
        cost += weight * h / 3.0 * (mixed + 0.5 * np.outer(new, old))
    best = np.linalg.solve(x.T @ x + cost, x.T @ reading)
    assert rivals.spline(time, reading, 1e-6, weight)[-1] == pytest.approx(z[-1] @ best, rel=1e-6)


def test_the_robust_exact_law_stays_within_its_worst_case_for_any_noise():
    """2 sqrt(2 N L) + L h / 2, without knowing N; exact to L h / 2 without noise."""
    time, bound = np.arange(2000) * H, 1.0
    rng = np.random.default_rng(3)
    square = np.where(np.arange(2000) // 30 % 2, 1.0, -1.0)
    for noise in (0.0, 0.01, 0.08):
        for shape in (rng.uniform(-1.0, 1.0, 2000), square):
            reading = np.sin(time) + noise * shape
            found = rivals.robust_exact(time, reading, noise / rivals.NOISE or 1e-9, bound)
            worst = np.abs(found - np.cos(time))[200:].max()
            assert worst <= 2.0 * np.sqrt(2.0 * noise * bound) + 0.51 * bound * H
