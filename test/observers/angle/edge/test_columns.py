# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The edge-aware adaptive observer on the columns of the benchmark: one setting for all."""

import numpy as np
import pytest
from edge_encoder import DT, QUANTUM

from benchmarks import accuracy as bench_accuracy
from benchmarks.signals import FURTHER, SIGNALS
from estimator_pkg.evaluation.entries import Entry

BOUNDS = {
    'slow': 1e-4,
    'sine': 0.053,
    'trapezoid': 0.070,
    'fast': 0.005,
    'jitter': 0.055,
    'drops': 0.055,
}
REVERSAL = 0.0046  # the best of all other observers, each tuned for this column
TIMES_KALMAN = 1.05
BY_NAME = {signal.name: signal for signal in SIGNALS + FURTHER}
ENTRY = Entry('edge_adaptive', 'edge_adaptive')


def check(rows):
    """The issue's numbers, for every column that has one."""
    ours = {row['signal']: row for row in rows if row['observer'] == 'edge_adaptive'}
    for name, bound in BOUNDS.items():
        assert ours[name]['pooled'] <= bound, name
    assert ours['reversal']['pooled'] <= REVERSAL
    for name, row in ours.items():
        assert row['worst_ratio'] <= TIMES_KALMAN, name
    assert ours['noise']['worst_ratio'] > 0.5  # the yardstick was there
    if rows[0]['draws'] == bench_accuracy.DRAWS:
        for name in MOVING:  # a shaft at rest is known better than by a variance
            # overdue edges are in doubt: wider than 95 %, and with a lower interval score than 98 %
            most = {'trapezoid': 0.99, 'steps': 0.99, 'reversal': 0.999}.get(name, 0.98)
            assert 0.93 <= ours[name]['coverage'] <= most, name


@pytest.mark.long
def test_one_setting_serves_every_column():
    check(bench_accuracy.drawn(draws=3, duration=5.0))


@pytest.mark.slow
def test_one_setting_serves_every_column_at_a_hundred_phases_and_speeds():
    check(bench_accuracy.drawn(draws=100))


def test_delay_on_the_sine_is_at_most_half_a_millisecond():
    found = bench_accuracy.measure(ENTRY, BY_NAME['sine'].samples(duration=5.0))
    assert 0.0 < found['delay_s'] <= 0.5e-3
    assert found['published'] == 1.0


MOVING = (
    'sine',
    'trapezoid',
    'jitter',
    'drops',
    'reversal',
    'steps',
    'noise',
    '100 Hz',
    '200 Hz',
    '10 kHz',
)


@pytest.mark.long
def test_standard_deviation_covers_in_motion():
    rows = bench_accuracy.drawn(
        [ENTRY], [BY_NAME[name] for name in MOVING if name != '10 kHz'], draws=4, duration=5.0
    )
    for row in rows:
        # of four draws; between two edges of a slow reversal nearly all errors are bounded
        most = 0.999 if row['signal'] == 'reversal' else 0.99
        assert 0.915 <= row['coverage'] <= most, row['signal']


def test_drawn_columns_differ_in_phase_and_speed_and_are_repeatable():
    for signal in SIGNALS + FURTHER:
        one, again, other = signal.drawn(1, 2.0), signal.drawn(1, 2.0), signal.drawn(2, 2.0)
        assert np.array_equal(one.angle, again.angle)
        assert not np.array_equal(one.angle[:100], other.angle[:100])
        steps = np.abs(np.diff(np.sort(one.angle)))
        assert np.allclose(steps / signal.quantum, np.rint(steps / signal.quantum), atol=1e-6)
    beats = [BY_NAME['beat'].drawn(k, 0.1).velocity[0] * DT / QUANTUM for k in range(40)]
    nearest = [min(abs(x - p / q) for q in range(1, 7) for p in range(1, q + 1)) for x in beats]
    assert max(nearest) < 0.041 and len({round(x, 6) for x in beats}) == 40


def test_the_table_of_draws_says_how_often_the_yardstick_is_better():
    found = bench_accuracy.drawn(
        [bench_accuracy.YARDSTICK, Entry('slow', 'pll')], (BY_NAME['sine'],), draws=2, duration=2.0
    )
    rows = {row['observer']: row for row in found}
    assert rows['kalman acceleration']['worst_ratio'] == 1.0
    assert rows['slow']['worse'] == 2 and rows['slow']['worst_ratio'] > 1.05
    assert '2 of 2' in bench_accuracy.describe_drawn(found)
    assert rows['slow']['score'] >= rows['slow']['width'] > 0.0


def test_the_interval_score_is_least_for_the_right_width():
    error = np.random.default_rng(1).normal(0.0, 0.2, 20_000)
    covered, width, score = bench_accuracy.interval_score(error, np.full(len(error), 0.2))
    assert covered == pytest.approx(0.95, abs=0.005) and width == pytest.approx(2.0 * 1.96 * 0.2)
    assert score == pytest.approx(4.67 * 0.2, rel=0.02)  # of a normal distribution
    for wrong in (0.1, 0.4):
        worse = bench_accuracy.interval_score(error, np.full(len(error), wrong))
        assert worse[2] > 1.1 * score
