# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Every sensor fault, seen in the data at the rate it was asked for, and alone."""

import math

import numpy as np
import pytest

from estimator_pkg.errors import UsageError
from estimator_pkg.parameters import build
from sim_pkg.joints.sensor import TURN, AngleSensor, Episodes, Line, SensorParameters, written

COUNT = 40_000


def parameters(**values):
    return build(SensorParameters, values)


def read(angle, seed=1, joint=0, chunk=1000, **values):
    sensor = AngleSensor(parameters(**values), seed, joint)
    return np.concatenate(
        [sensor.read(angle[at : at + chunk]) for at in range(0, len(angle), chunk)]
    )


def carry(seed=1, count=COUNT, chunk=1000, **values):
    line = Line(parameters(**values), seed)
    parts = [line.carry(chunk) for _ in range(count // chunk)]
    taken, stamp, due, copies = (
        np.concatenate([part[which] for part in parts]) for which in range(4)
    )
    return taken, stamp, due, copies


def ramp(speed=3.0, count=COUNT):
    return speed * np.arange(count) * 1e-3


def clean(**values):
    return {'counts_per_revolution': 0, 'convention': 'multi_turn', **values}


def runs(mask):
    """Lengths of the runs of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    return np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)


def about(rate, count=COUNT):
    """Five standard deviations of a fraction that is met by chance."""
    return pytest.approx(rate, abs=5.0 * math.sqrt(rate * (1.0 - rate) / count))


@pytest.mark.parametrize('counts', [7, 1000, 4096, 16384])
def test_quantisation_rounds_down_to_whole_counts(counts):
    angle = ramp(-3.0)
    error = read(angle, counts_per_revolution=counts, convention='multi_turn') - angle
    quantum = TURN / counts
    assert -quantum - 1e-9 < error.min() < -0.9 * quantum
    assert -0.1 * quantum < error.max() < 1e-9
    assert error.mean() == pytest.approx(-0.5 * quantum, rel=0.05)
    counted = read(angle, counts_per_revolution=counts, convention='multi_turn') / quantum
    np.testing.assert_allclose(counted, np.round(counted), atol=1e-6)


@pytest.mark.parametrize('counts', [0, 7, 1000, 4096])
@pytest.mark.parametrize(
    ('convention', 'low', 'high'), [('signed', -math.pi, math.pi), ('unsigned', 0.0, TURN)]
)
def test_wrapped_conventions_stay_in_their_interval(counts, convention, low, high):
    angle = np.concatenate(
        [
            ramp(-40.0),
            np.array([-1e-17, math.pi, -math.pi, 0.0, TURN, 1e-300]),
            np.arange(-50, 50) * math.pi,
        ]
    )
    reading = read(angle, counts_per_revolution=counts, convention=convention)
    assert reading.min() >= low
    assert reading.max() < high
    turns = (read(angle, counts_per_revolution=counts, convention='multi_turn') - reading) / TURN
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


def test_raw_counts_are_whole_and_in_one_turn():
    reading = read(ramp(-40.0), counts_per_revolution=1000, convention='raw_counts')
    np.testing.assert_array_equal(reading, np.floor(reading))
    assert set(reading) == set(range(1000))
    angles = read(ramp(-40.0), counts_per_revolution=1000, convention='unsigned')
    np.testing.assert_allclose(reading * TURN / 1000, angles, atol=1e-12)


def test_noise_has_its_standard_deviation_and_is_white():
    error = read(ramp(), **clean(noise=0.02)) - ramp()
    assert error.std() == pytest.approx(0.02, rel=0.03)
    assert abs(error.mean()) < 5 * 0.02 / math.sqrt(COUNT)
    assert abs(np.mean(error[1:] * error[:-1])) < 5 * 0.02**2 / math.sqrt(COUNT)


def test_eccentricity_is_a_once_per_turn_error():
    error = read(ramp(), **clean(eccentricity=0.05)) - ramp()
    np.testing.assert_allclose(error, 0.05 * np.sin(ramp()), atol=1e-9)


def test_outliers_come_at_their_rate_with_either_sign():
    error = read(ramp(), **clean(outliers=0.02, outlier_size=2.5)) - ramp()
    out = np.abs(error) > 1e-9
    assert out.mean() == about(0.02)
    np.testing.assert_allclose(np.abs(error[out]), 2.5)
    assert (error[out] > 0).mean() == about(0.5, out.sum())


def test_repeated_readings_are_stale_ones():
    reading = read(ramp(), **clean(repeated=0.1))
    stale = np.concatenate([[False], reading[1:] == reading[:-1]])
    assert stale.mean() == about(0.1)
    np.testing.assert_array_equal(reading[~stale], ramp()[~stale])


def test_update_every_holds_the_reading():
    reading = read(ramp(), chunk=7, **clean(update_every=3))
    np.testing.assert_array_equal(reading, np.repeat(ramp()[::3], 3)[:COUNT])


def test_stuck_sensor_sticks_for_its_length_and_at_its_rate():
    reading = read(ramp(), **clean(stuck_every=0.5, stuck_length=0.05))
    stuck = np.concatenate([[False], reading[1:] == reading[:-1]])
    lengths = runs(stuck)
    # two may follow one another directly, and the last may be cut off
    assert (lengths[:-1] % 50 == 0).all()
    assert lengths.sum() == pytest.approx(COUNT * 0.05 / 0.55, rel=0.35)
    assert 50 < len(lengths) < 100  # 40 s / 0.55 s = 73


def test_sampling_jitter_is_late_sampling_with_honest_stamps():
    taken, stamp, due, _ = carry(sampling_jitter=0.0008)
    late = taken - np.arange(COUNT) * 1_000_000
    assert 0 <= late.min() < 8_000
    assert 792_000 < late.max() <= 800_000
    assert late.mean() == pytest.approx(400_000, rel=0.02)
    np.testing.assert_array_equal(taken, stamp)
    np.testing.assert_array_equal(taken, due)
    assert (np.diff(taken) > 0).all()


def test_stamp_jitter_is_wrong_stamps_on_good_sampling():
    taken, stamp, due, _ = carry(stamp_jitter=0.0004)
    np.testing.assert_array_equal(taken, np.arange(COUNT) * 1_000_000)
    np.testing.assert_array_equal(due, taken)
    wrong = stamp - taken
    assert -400_000 <= wrong.min() < -396_000
    assert 396_000 < wrong.max() <= 400_000
    assert abs(wrong.mean()) < 6_000


def test_dropped_and_duplicated_come_at_their_rates():
    copies = carry(dropped=0.05)[3]
    assert set(copies) == {0, 1}
    assert (copies == 0).mean() == about(0.05)
    copies = carry(duplicated=0.03)[3]
    assert set(copies) == {1, 2}
    assert (copies == 2).mean() == about(0.03)
    copies = carry(dropped=0.05, duplicated=0.03)[3]
    assert (copies == 0).mean() == about(0.05)
    assert (copies == 2).mean() == about(0.03 * 0.95)


def test_gaps_have_their_length_and_rate():
    copies = carry(gap_every=0.7, gap_length=0.1)[3]
    lengths = runs(copies == 0)
    assert (lengths[:-1] % 100 == 0).all()
    assert 30 < len(lengths) < 70  # 40 s / 0.8 s = 50
    assert carry()[3].min() == 1


def test_bursts_arrive_all_at_once_with_their_own_stamps():
    taken, stamp, due, copies = carry(burst_every=0.5, burst_length=0.03)
    assert copies.min() == copies.max() == 1
    np.testing.assert_array_equal(stamp, taken)
    held = due > taken
    assert (np.diff(due) >= 0).all()
    lengths = runs(held)
    assert (lengths[:-1] % 30 == 0).all()
    assert 50 < len(lengths) < 105  # 40 s / 0.53 s = 75
    starts = np.flatnonzero(np.diff(held.astype(int)) == 1) + 1
    for start, length in zip(starts[:-1], lengths[:-1]):
        if length == 30:
            assert (due[start : start + 30] == taken[start] + 30_000_000).all()


def test_grid_does_not_drift_at_an_odd_rate():
    taken = carry(rate=3.0, count=30_000)[0]
    assert np.abs(taken - np.arange(30_000) * 1e9 / 3.0).max() <= 1.0


VALUE_FAULTS = {
    'noise': 0.01,
    'outliers': 0.05,
    'repeated': 0.1,
    'stuck_every': 0.3,
    'eccentricity': 0.1,
    'update_every': 2,
}
LINE_FAULTS = {
    'dropped': 0.1,
    'duplicated': 0.1,
    'gap_every': 0.5,
    'burst_every': 0.5,
    'sampling_jitter': 0.0002,
    'stamp_jitter': 0.0002,
}


@pytest.mark.parametrize('fault', ['noise', 'outliers', 'repeated', 'stuck_every'])
def test_value_faults_draw_independently(fault):
    """With all others on as well, this one strikes the same samples."""
    others = {name: value for name, value in VALUE_FAULTS.items() if name != fault}
    alone = read(ramp(), **clean(**{fault: VALUE_FAULTS[fault]}))
    both = read(ramp(), **clean(**VALUE_FAULTS))
    without = read(ramp(), **clean(**others))
    if fault in ('noise', 'outliers'):  # where the reading is a fresh one, they add up
        fresh = np.concatenate([[True], np.diff(without) != 0.0])
        np.testing.assert_allclose((both - without)[fresh], (alone - ramp())[fresh], atol=1e-9)
    else:
        stale = np.concatenate([[False], np.diff(alone) == 0.0])
        assert (np.diff(both)[stale[1:]] == 0.0).all()


@pytest.mark.parametrize('fault', LINE_FAULTS)
def test_line_faults_draw_independently(fault):
    def symptoms(**values):
        taken, stamp, due, copies = carry(count=10_000, **values)
        return {
            'dropped': copies == 0,
            'gap_every': copies == 0,
            'duplicated': copies == 2,
            'burst_every': due > taken,
            'stamp_jitter': stamp - taken,
            'sampling_jitter': taken - np.arange(10_000) * 1_000_000,
        }

    alone = symptoms(**{fault: LINE_FAULTS[fault]})
    both = symptoms(**LINE_FAULTS)
    if fault in ('dropped', 'gap_every'):  # these two have one symptom
        assert both[fault][alone[fault]].all()
    elif fault == 'duplicated':  # what does not arrive is not doubled
        np.testing.assert_array_equal(both[fault], alone[fault] & ~both['dropped'])
    else:
        np.testing.assert_array_equal(both[fault], alone[fault])


@pytest.mark.long
def test_chunks_do_not_matter():
    values = {**VALUE_FAULTS, 'counts_per_revolution': 1024}
    np.testing.assert_array_equal(
        read(ramp(), chunk=1000, **values), read(ramp(), chunk=1, **values)
    )
    for one, other in zip(
        carry(chunk=1000, count=10_000, **LINE_FAULTS), carry(chunk=8, count=10_000, **LINE_FAULTS)
    ):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ('values', 'said'),
    [
        ({'convention': 'raw_counts', 'counts_per_revolution': 0}, 'counts_per_revolution'),
        ({'rate': 100.0, 'sampling_jitter': 0.01}, 'shorter than one sample time, 0.01 s'),
        ({'dropped': 1.5}, r'outside \[0, 1\]'),
        ({'update_every': 0}, 'update_every'),
        ({'convention': 'wrapped'}, 'not one of signed'),
    ],
)
def test_what_makes_no_sense_is_refused(values, said):
    with pytest.raises(UsageError, match=said):
        parameters(**values)


def test_lower_edge_of_signed_is_exactly_minus_pi():
    """An observer takes anything below -pi for a multi-turn reading."""
    for counts in (10, 50, 100, 200, 1000, 4096):
        assert written(np.array([counts / 2]), counts, 'signed')[0] == -math.pi


def test_episode_is_at_least_one_sample():
    ends = Episodes(parameters(gap_every=0.01, gap_length=0.0), 'gap', 1).ends(0, 10_000)
    assert (ends > 0).mean() == pytest.approx(0.1, abs=0.02)
    struck = np.flatnonzero(ends)
    np.testing.assert_array_equal(ends[struck], struck + 1)
