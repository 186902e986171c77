# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The rivals are what their papers say, each on a signal on which its claim can be checked."""

import numpy as np
import pytest

from benchmarks import rivals
from benchmarks.columns import Column
from benchmarks.signals import Samples

H = 0.01


def _relative(found, true, after):
    return np.sqrt(np.mean((found - true)[after:] ** 2) / np.mean(true[after:] ** 2))


def test_adaptive_input_estimation_beats_the_difference_where_nobody_knows_the_noise():
    """Two tones at 20 dB, the paper's kind of example; the noise then falls to 40 dB."""
    time = np.arange(3000) * H
    clean = np.sin(5.0 * time) + np.sin(20.0 * time)
    true = 5.0 * np.cos(5.0 * time) + 20.0 * np.cos(20.0 * time)
    noise = np.where(time < 20.0, 0.1, 0.01) * np.random.default_rng(0).standard_normal(3000)
    found = rivals.adaptive_input(time, clean + noise, 1e-6, rivals.RETROSPECTIVE)
    difference = np.diff(clean + noise, prepend=0.0) / H
    early = slice(1000, 2000)
    assert _relative(found[early], true[early], 0) < 0.35
    assert _relative(difference[early], true[early], 0) > 0.9


def test_the_input_estimate_minimises_the_retrospective_cost(monkeypatch):
    """Against the normal equations of the whole past, at each of 60 samples."""
    monkeypatch.setattr(rivals, 'PAST', 2)
    monkeypatch.setattr(rivals, 'FILTER', 3)
    monkeypatch.setattr(rivals, 'ETA', (1e-6, 1e-6))
    reading = np.cumsum(np.random.default_rng(4).standard_normal(60)) * H
    prior, penalty = 1e-3, 1e-4
    found = rivals.adaptive_input(np.arange(60) * H, reading, 1e-6, (prior, penalty))
    d, z, keep, phi = [0.0] * 60, [0.0] * 60, [0.0] * 60, np.zeros((60, 5))
    state = known = 0.0
    theta, normal, right = np.zeros(5), prior * np.eye(5), np.zeros(5)
    for k in range(60):
        z[k] = state - (reading[k] - reading[0])
        spare = np.var(z[: k + 1]) - known - 1e-6
        noise = max(spare, 0.0)
        keep[k] = noise / (known + 1e-6 + noise)
        known = keep[k] * (known + 1e-6)
        phi[k] = [
            *(d[k - i] if k >= i else 0.0 for i in (1, 2)),
            *(z[k - i] if k >= i else 0.0 for i in (0, 1, 2)),
        ]
        d[k] = phi[k] @ theta
        assert found[k] == pytest.approx(d[k], rel=1e-5, abs=1e-9), k
        response = [H, H * keep[k - 1], H * keep[k - 1] * keep[k - 2]]
        through = [(h, k - i) for i, h in enumerate(response, 1) if k >= i]
        past = sum((h * phi[i] for h, i in through), np.zeros(5))
        offset = z[k] - sum(h * d[i] for h, i in through)
        normal += np.outer(past, past) + penalty * np.outer(phi[k], phi[k])
        right -= past * offset
        theta = np.linalg.solve(normal, right)
        state += (keep[k] - 1.0) * z[k] + H * d[k]


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


def test_the_spline_beats_the_difference_in_coarse_irregular_noisy_samples():
    """The authors' signal, at h = 0.01 +- 50 % and a noise of 0.01, with their lambda."""
    rng = np.random.default_rng(2)
    time = np.cumsum(H * rng.uniform(0.5, 1.5, 600))
    fast, slow = 2.0 * np.pi, 3.1 * np.pi
    clean = time - 1.0 + 0.5 * (np.sin(fast * time) / fast + np.sin(slow * time) / slow)
    true = 1.0 + 0.5 * (np.cos(fast * time) + np.cos(slow * time))
    reading = clean + 0.01 * rng.standard_normal(600)
    raw = np.diff(reading, prepend=0.0) / np.diff(time, prepend=0.0)
    found = rivals.spline(time, reading, 1e-6, rivals.LAMBDA)
    assert _relative(found, true, 100) < 0.15 * _relative(raw, true, 100)


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


def test_every_rival_follows_a_constant_speed():
    time = np.arange(2000) * 1e-3
    angle = np.floor(1.3 * time / 2e-3) * 2e-3
    stamps = 10**9 + (time * 1e9).astype(np.int64)
    column = Column('x', Samples(stamps, angle, np.full(len(time), 1.3)), 2e-3)
    for law in rivals.rivals():
        if 'authors' not in law.name:
            runs = [law.run(column, value)[1000:] for value in law.values]
            errors = [np.sqrt(np.nanmean((run - 1.3) ** 2)) for run in runs]
            assert min(errors) < 0.2, law.name  # a raw difference has 1.0
