# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The laws of practitioners are what their papers say."""

import numpy as np
import pytest

from benchmarks import practice, rivals
from benchmarks.columns import Column
from benchmarks.signals import Samples

H, QUANTUM = 1e-3, 2e-3
TIME = np.arange(2000) * H


def counted(angle):
    return np.round(angle / QUANTUM) * QUANTUM


@pytest.mark.long
def test_every_law_follows_a_constant_speed():
    stamps = 10**9 + (TIME * 1e9).astype(np.int64)
    column = Column('x', Samples(stamps, counted(1.3 * TIME), np.full(len(TIME), 1.3)), QUANTUM)
    laws, missing = practice.practice()
    assert len(laws) == 6 and not missing
    swept = [each for each in rivals.rivals() if 'authors' not in each.name]
    for law in [*laws, *swept]:
        errors = [
            np.sqrt(np.nanmean((law.run(column, value)[1000:] - 1.3) ** 2)) for value in law.values
        ]
        assert min(errors) < (0.2 if law in swept else 0.02), law.name  # a raw difference has 1.0


def test_the_slope_at_the_end_of_a_parabola_is_exact_for_one():
    """At even and at uneven times."""
    law = next(each for each in practice.practice()[0] if each.name == 'Savitzky-Golay, causal')
    for jitter in (0.0, 0.3):
        time = TIME + jitter * H * np.random.default_rng(1).random(len(TIME))
        samples = Samples(np.rint(1e9 + 1e9 * time).astype(np.int64), 0.4 * time**2, 0.8 * time)
        column = Column('x', samples, QUANTUM, period=0.0)
        found = law.run(column, 14 * H)[100:]
        np.testing.assert_allclose(found, samples.velocity[100:], atol=1e-5)


def test_adaptive_windows_are_as_long_as_the_chord_holds():
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, 400))
    angle = counted(0.3 * np.sin(9.0 * time)) + 1e-4 * rng.standard_normal(400)
    found = practice.adaptive_windows(time, angle, QUANTUM, 1.5)
    for k in range(1, 400, 7):
        n = 0
        while n < min(k, practice.length(time, practice.LONGEST)):
            chord = np.interp(time[k - n - 1 : k + 1], time[[k - n - 1, k]], angle[[k - n - 1, k]])
            if np.abs(chord - angle[k - n - 1 : k + 1]).max() > 1.5 * QUANTUM:
                break
            n += 1
        slope = np.polyfit(time[k - n : k + 1], angle[k - n : k + 1], 1)[0]
        assert found[k] == pytest.approx(slope, rel=1e-6, abs=1e-9), k


def test_edges_are_where_the_count_changes():
    """Exact for a constant speed, below one count per sample and above; at rest it is 0."""
    for speed in (0.31, 7.77):
        found = practice.edges(TIME, counted(speed * TIME), QUANTUM, 30)
        assert np.abs(found[500:] - speed).max() < 0.03 * speed
    stopped = counted(0.31 * np.minimum(TIME, 1.0))
    found = practice.edges(TIME, stopped, QUANTUM, 10)
    assert found[990] == pytest.approx(0.31, rel=0.05) and not found[1100:].any()


def test_the_filtering_differentiator_is_exact_within_its_bound():
    """A jerk of 40 rad/s^3, without noise: exact up to the step if the bound is larger."""
    angle = 40.0 / 6.0 * TIME**3
    errors = [
        np.abs(practice.filtering(TIME, angle, QUANTUM, bound) - 20.0 * TIME**2)[1500:].max()
        for bound in (100.0, 20.0)
    ]
    assert errors[0] < 0.1 < errors[1]
