# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Every sensor fault, seen in the data at the rate it was asked for, and alone."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from estimator_pkg.errors import UsageError
from estimator_pkg.parameters import build
from sim_pkg.joints.sensor import TURN, AngleSensor, Episodes, Line, SensorParameters, written

COUNT = 40_000
MS = 1_000_000  # [ns]
GRID = np.arange(COUNT) * MS
CLEAN = {'counts_per_revolution': 0, 'convention': 'multi_turn'}


def parameters(**values):
    return build(SensorParameters, values)


def read(angle, seed=1, chunk=1000, **values):
    sensor = AngleSensor(parameters(**values), seed)
    return np.concatenate(
        [sensor.read(angle[at : at + chunk]) for at in range(0, len(angle), chunk)]
    )


def carry(count=COUNT, chunk=1000, **values):
    line = Line(parameters(**values), 1)
    parts = [line.carry(chunk) for _ in range(count // chunk)]
    return [np.concatenate([part[which] for part in parts]) for which in range(4)]


def ramp(speed=3.0):
    return speed * np.arange(COUNT) * 1e-3


class Seen(NamedTuple):
    """What becomes of a ramp: errors of the readings, where they are stale, times, copies."""

    error: np.ndarray
    stale: np.ndarray
    taken: np.ndarray
    stamp: np.ndarray
    due: np.ndarray
    copies: np.ndarray


def seen(**values):
    reading = read(ramp(), **CLEAN, **values)
    stale = np.diff(reading, prepend=-1.0) == 0.0
    return Seen(reading - ramp(), stale, *carry(**CLEAN, **values))


def runs(mask):
    """Lengths of the runs of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    return np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)


# By fault: parameters, where it is seen, part of the samples, and [samples] length of an episode.
FAULTS = {
    'outliers': ({'outliers': 0.02}, lambda s: np.abs(s.error) > 0.5, 0.02, 0),
    'repeated': ({'repeated': 0.1}, lambda s: s.stale, 0.1, 0),
    'dropped': ({'dropped': 0.05}, lambda s: s.copies == 0, 0.05, 0),
    'duplicated': ({'duplicated': 0.03}, lambda s: s.copies == 2, 0.03, 0),
    'stuck': ({'stuck_every': 0.5, 'stuck_length': 0.05}, lambda s: s.stale, 0.05 / 0.55, 50),
    'gap': ({'gap_every': 0.7, 'gap_length': 0.1}, lambda s: s.copies == 0, 0.1 / 0.8, 100),
    'burst': ({'burst_every': 0.5, 'burst_length': 0.03}, lambda s: s.due > s.taken, 3 / 53, 30),
}
OTHERS = {'noise': 1e-3, 'eccentricity': 0.05, 'sampling_jitter': 2e-4, 'stamp_jitter': 2e-4}


@pytest.mark.parametrize('name', FAULTS)
def test_a_fault_comes_at_its_rate_whatever_else_is_on(name):
    values, symptom, rate, length = FAULTS[name]
    struck = symptom(seen(**values))
    if length:
        lengths = runs(struck)  # two may follow one another directly, and the last be cut off
        assert (lengths[:-1] % length == 0).all()
        assert struck.mean() == pytest.approx(rate, rel=0.35)
    else:
        assert struck.mean() == pytest.approx(rate, abs=5.0 * math.sqrt(rate / COUNT))
    np.testing.assert_array_equal(symptom(seen(**values, **OTHERS)), struck)
    assert not symptom(seen(**OTHERS)).any()


def test_errors_of_the_reading_have_their_size():
    error = seen(noise=0.02).error
    assert error.std() == pytest.approx(0.02, rel=0.03)
    assert abs(error.mean()) < 5 * 0.02 / math.sqrt(COUNT)
    assert abs(np.mean(error[1:] * error[:-1])) < 5 * 0.02**2 / math.sqrt(COUNT)  # white
    np.testing.assert_allclose(seen(eccentricity=0.05).error, 0.05 * np.sin(ramp()), atol=1e-9)
    error = seen(outliers=0.02, outlier_size=2.5).error
    out = error[np.abs(error) > 1e-9]
    np.testing.assert_allclose(np.abs(out), 2.5)
    assert (out > 0).mean() == pytest.approx(0.5, abs=0.1)
    held = read(ramp(), chunk=7, **CLEAN, update_every=3)
    np.testing.assert_array_equal(held, np.repeat(ramp()[::3], 3)[:COUNT])


def test_jitter_of_sampling_has_right_stamps_and_jitter_of_stamps_right_sampling():
    late = seen(sampling_jitter=0.0008)
    assert 0 <= (late.taken - GRID).min() < 8_000 and 792_000 < (late.taken - GRID).max() <= 800_000
    assert (late.taken == late.stamp).all() and (late.taken == late.due).all()
    wrong = seen(stamp_jitter=0.0004)
    assert (wrong.taken == GRID).all() and (wrong.due == GRID).all()
    off = wrong.stamp - GRID
    assert -400_000 <= off.min() < -396_000 and 396_000 < off.max() <= 400_000
    assert abs(off.mean()) < 6_000


def test_a_burst_arrives_at_once_with_its_own_stamps():
    found = seen(burst_every=0.5, burst_length=0.03)
    np.testing.assert_array_equal(found.stamp, found.taken)
    held = found.due > found.taken
    assert (np.diff(found.due) >= 0).all() and (found.copies == 1).all()
    starts = np.flatnonzero(np.diff(held.astype(int)) == 1) + 1
    for start, length in zip(starts[:-1], runs(held)[:-1]):
        if length == 30:
            assert (found.due[start : start + 30] == found.taken[start] + 30 * MS).all()


@pytest.mark.parametrize('counts', [7, 1000, 4096, 16384])
def test_quantisation_rounds_down_to_whole_counts(counts):
    angle, quantum = ramp(-3.0), TURN / counts
    reading = read(angle, counts_per_revolution=counts, convention='multi_turn')
    error = reading - angle
    assert -quantum - 1e-9 < error.min() < -0.9 * quantum
    assert -0.1 * quantum < error.max() < 1e-9
    np.testing.assert_allclose(reading / quantum, np.round(reading / quantum), atol=1e-6)


@pytest.mark.parametrize('counts', [0, 7, 1000, 4096])
@pytest.mark.parametrize(
    ('convention', 'low', 'high'), [('signed', -math.pi, math.pi), ('unsigned', 0.0, TURN)]
)
def test_wrapped_conventions_stay_in_their_interval(counts, convention, low, high):
    ends = np.array([-1e-17, math.pi, -math.pi, 0.0, TURN, 1e-300])
    angle = np.concatenate([ramp(-40.0), ends, np.arange(-50, 50) * math.pi])
    reading = read(angle, counts_per_revolution=counts, convention=convention)
    assert reading.min() >= low
    assert reading.max() < high
    turns = (read(angle, counts_per_revolution=counts, convention='multi_turn') - reading) / TURN
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


def test_raw_counts_are_whole_and_in_one_turn():
    reading = read(ramp(-40.0), counts_per_revolution=1000, convention='raw_counts')
    assert set(reading) == set(range(1000))
    angles = read(ramp(-40.0), counts_per_revolution=1000, convention='unsigned')
    np.testing.assert_allclose(reading * TURN / 1000, angles, atol=1e-12)


def test_lower_edge_of_signed_is_exactly_minus_pi():
    """An observer takes anything below -pi for a multi-turn reading."""
    for counts in (10, 50, 100, 200, 1000, 4096):
        assert written(np.array([counts / 2]), counts, 'signed')[0] == -math.pi


def test_grid_does_not_drift_at_an_odd_rate():
    taken = carry(rate=3.0, count=30_000)[0]
    assert np.abs(taken - np.arange(30_000) * 1e9 / 3.0).max() <= 1.0


@pytest.mark.long
def test_chunks_do_not_matter():
    every = {key: value for values, *_ in FAULTS.values() for key, value in values.items()}
    every |= {**OTHERS, 'update_every': 2, 'counts_per_revolution': 1024}
    np.testing.assert_array_equal(
        read(ramp()[:8000], **every), read(ramp()[:8000], chunk=1, **every)
    )
    for one, other in zip(carry(10_000, **every), carry(10_000, chunk=8, **every)):
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


def test_episode_is_at_least_one_sample():
    ends = Episodes(parameters(gap_every=0.01, gap_length=0.0), 'gap', 1).ends(0, 10_000)
    struck = np.flatnonzero(ends)
    np.testing.assert_array_equal(ends[struck], struck + 1)
