# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The edge-aware adaptive observer on the columns of the benchmark: one setting for all."""

import numpy as np
import pytest
from edge_encoder import DT, QUANTUM

from benchmarks import columns, runner
from benchmarks.signals import FURTHER, SIGNALS, SKIPPED
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
DRAWS = 100
# the textbook filter: with noise readings repeat, and our low-speed bound would limit its velocity
YARDSTICK = Entry('kalman acceleration', 'kalman', (('low_speed_bound', False),))
BY_NAME = {signal.name: signal for signal in SIGNALS + FURTHER}
ENTRY = Entry('edge_adaptive', 'edge_adaptive')


def drawn(entries, signals, draws, duration=6.0):
    """Pooled error, coverage and largest ratio to the yardstick (first), at random phases."""
    for signal in signals:
        repeats, yard = [signal.drawn(number, duration) for number in range(draws)], None
        for entry in entries:
            joint = entry.joint(quantum=signal.quantum)
            rms, coverage = np.array([_draw(joint, each) for each in repeats]).T
            row = {'observer': entry.label, 'signal': signal.name}
            row |= {'pooled': np.sqrt(np.mean(rms * rms)), 'coverage': np.mean(coverage)}
            if entry == YARDSTICK:
                yard = np.maximum(rms, 1e-12)
            if yard is not None:
                row['worst_ratio'] = np.max(rms / yard)
            yield row


def _draw(joint, samples):
    joint.reset()
    out = joint.run(samples.stamps, samples.angle)
    counted = (samples.stamps - samples.stamps[0]) * 1e-9 >= SKIPPED
    error = (out.velocity - samples.velocity)[counted]
    return np.sqrt(np.mean(error * error)), runner.covered(error, out.velocity_stddev[counted])


def check(draws, duration=6.0):
    """The issue's numbers, for every column that has one."""
    rows = drawn((YARDSTICK, ENTRY), SIGNALS + FURTHER, draws, duration)
    ours = {row['signal']: row for row in rows if row['observer'] == 'edge_adaptive'}
    for name, bound in BOUNDS.items():
        assert ours[name]['pooled'] <= bound, name
    assert ours['reversal']['pooled'] <= REVERSAL
    for name, row in ours.items():
        assert row['worst_ratio'] <= TIMES_KALMAN, name
    assert ours['noise']['worst_ratio'] > 0.5  # the yardstick was there
    if draws == DRAWS:
        for name in MOVING:  # a shaft at rest is known better than by a variance
            # overdue edges and the time after a manoeuvre are in doubt: wider than 95 %
            most = {'trapezoid': 0.999, 'steps': 0.999, 'reversal': 1.0}.get(name, 0.985)
            assert 0.93 <= ours[name]['coverage'] <= most, name


@pytest.mark.long
def test_one_setting_serves_every_column():
    check(3, 5.0)


@pytest.mark.slow
def test_one_setting_serves_every_column_at_a_hundred_phases_and_speeds():
    check(DRAWS)


def test_delay_on_the_sine_is_at_most_half_a_millisecond():
    found = runner.result(columns.of_signal(BY_NAME['sine'], 5.0), ENTRY)
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
    moving = [BY_NAME[name] for name in MOVING if name != '10 kHz']
    for row in drawn([ENTRY], moving, 4, 5.0):
        # of four draws of 5 s, in which it is wider after the start: test_observer.py has the limit
        assert row['coverage'] >= 0.915, row['signal']


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
