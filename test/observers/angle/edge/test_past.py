# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts that skip counts: once the quantum is found it is worth what a given one is."""

import math

import numpy as np
import pytest
from observer_cases import make, stamps, wrapped
from quantum_starts import Start, compare, starts, states, stream

from estimator_pkg import VelocityEstimator
from estimator_pkg.observers.angle.edge.past import fits
from estimator_pkg.observers.angle.edge.quantum import SEARCH

# Two starts of each kind at which the errors differed most; the ratio that it was
WORST = [
    (Start('jump', 0.0, 100.0, 4000.0, 65536, 0.5933, 0.7754), 1.5),
    (Start('jump', 0.0, 100.0, 200.0, 4096, 0.2444, 0.9869), 0.73),
    (Start('motor', 0.005, 10.0, 500.0, 1048576, 0.0814, 0.4956), 5.4),
    (Start('motor', 0.02, 100.0, 200.0, 4096, 0.0222, 0.6114), 0.39),
    (Start('ramp', 0.02, 100.0, 1000.0, 16384, 0.3420, 0.4191), 0.04),
    (Start('ramp', 0.02, 30.0, 1000.0, 65536, 0.6812, 0.4990), 1.8),
]


@pytest.mark.parametrize('start, was', WORST)
def test_once_found_the_error_is_that_with_the_quantum_given(start, was):
    found, given, unknown = compare(start)
    assert found > 2
    assert 0.95 < unknown / given < 1.05, was


def test_once_found_the_state_is_that_with_the_quantum_given():
    start, _ = WORST[0]
    (given, _), (unknown, _) = (states(start, gains) for gains in ({'quantum': start.quantum}, {}))
    for one, other in zip(given[-1][:4], unknown[-1][:4]):  # motion, covariance, band, sensor
        assert other == pytest.approx(one, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize('start', [start for start, _ in WORST])
def test_once_found_the_start_is_as_old_as_with_the_quantum_given(start):
    (given, _), (unknown, _) = (states(start, gains) for gains in ({'quantum': start.quantum}, {}))
    ages = []
    for (*_, one, _, _), (_, _, _, (used, *_), *_, other, _, _) in zip(given, unknown):
        if used == pytest.approx(start.quantum, rel=1e-6):
            _, _, *one_since, _, _ = one
            _, _, *other_since, _, _ = other
            assert other_since == pytest.approx(one_since, abs=1e-9)
            ages += other_since
    assert 0.2 < max(ages) < 0.26


def irregular(seed):
    """(stamps, readings) of a joint that rests, and then moves by 0, 6 or 9 counts of 4096."""
    counts = np.random.default_rng(seed).choice([0, 6, 9], 300)
    counts[:50] = 0
    return stamps(300), wrapped(2.0 * math.pi / 4096.0 * np.cumsum(counts))


@pytest.mark.long
@pytest.mark.parametrize('chunk', [7, 1000])
def test_readings_in_blocks_and_compiled_count_again_as_live(chunk):
    for at, read in (*(stream(start)[:2] for start, _ in WORST), *map(irregular, range(5))):
        live, blocks, expected = make('edge_adaptive'), make('edge_adaptive'), []
        for stamp, reading in zip(at.tolist(), read.tolist()):
            live.update(stamp, reading)
            position, velocity, acceleration, _ = live.estimate()
            expected.append((position, velocity, acceleration, *live.stddev()))
        found = [
            np.stack(blocks.run(at[i : i + chunk], read[i : i + chunk], fast=True)[:5], axis=1)
            for i in range(0, len(at), chunk)
        ]
        np.testing.assert_array_equal(np.concatenate(found), expected)
        assert (live._past is None) == (blocks._past is None)


@pytest.mark.parametrize('given', [0.0, 0.01])
def test_a_rest_ends_the_past_alike_live_and_in_blocks(given):
    live, blocks = (make('edge_adaptive', {'quantum': given}) for _ in range(2))
    for stamp in stamps(10).tolist():
        live.update(stamp, 0.3)
    blocks.run(stamps(10), np.full(10, 0.3), fast=False)
    assert live._past == blocks._past == (None if given else ())


def test_a_quantum_that_is_taken_back_is_searched_for_live_and_in_blocks():
    at, read = irregular(1)
    live, blocks = VelocityEstimator(quantum=0.01), VelocityEstimator(quantum=0.01)
    velocity = [live.update(*each).velocity for each in zip(at[:40].tolist(), read[:40].tolist())]
    found = blocks.run(at[:40], read[:40], fast=False).velocity.tolist()
    for each in (live, blocks):
        each.set(quantum=0.0)
    assert live._joint._past == blocks._joint._past == ()
    velocity += [live.update(*each).velocity for each in zip(at[40:].tolist(), read[40:].tolist())]
    found += blocks.run(at[40:], read[40:], fast=False).velocity.tolist()
    assert found == velocity


def lengths(joint, readings, at=10**9):
    """Numbers of readings in the past after each of these at 1 kHz."""
    found = []
    for i, reading in enumerate(readings.tolist()):
        joint.update(at + 10**6 * i, reading)
        found.append(max(0, len(joint._past or ()) - 1))
    return found


def test_the_past_is_bounded_and_ends_with_the_search_and_at_a_gap():
    _, read, _ = stream(WORST[-1][0])
    known = lengths(make('edge_adaptive', {}), read)
    assert 50 < max(known) < SEARCH and known[-1] == 0
    assert not any(lengths(make('edge_adaptive', {'quantum': WORST[-1][0].quantum}), read))
    noise = np.cumsum(np.random.default_rng(1).normal(0.1, 0.01, 300))
    joint = make('edge_adaptive', {}, wrap_period=0.0)
    assert max(lengths(joint, noise)) == SEARCH and not joint._past
    joint = make('edge_adaptive', {}, wrap_period=0.0)
    assert lengths(joint, noise[:20])[-1] == 19
    assert lengths(joint, noise[:1] + 30.0, 2 * 10**9) == [0]


def test_readings_that_are_no_counts_are_not_taken_in_again():
    random = np.random.default_rng(3)
    angle = np.where(np.arange(300) < 50, 0.0, 0.02 * np.arange(-50, 250))
    readings = wrapped(angle + random.normal(0.0, 1e-3, 300))
    one, without = make('edge_adaptive'), make('edge_adaptive')
    without._past = None
    found, expected = (each.run(stamps(300), readings, fast=False) for each in (one, without))
    np.testing.assert_array_equal(found.velocity, expected.velocity)


def test_only_steps_that_are_multiples_fit():
    quantum, wraps = 2.0 * math.pi / 4096, 2.0 * math.pi
    first = 3.0 - 3.0 % quantum
    past = ((first, 0.0, 0.0), (1e-3, first + 5 * quantum, 0.0))
    for count in (17, 40, 300):  # the last one is over the wrap
        reading = first + count * quantum
        reading -= wraps if reading >= math.pi else 0.0
        past = (*past, (1e-3, reading, 0.0))
    assert fits(past, quantum, wraps) and not fits(past, 2.0 * quantum, wraps)
    past = (*past, (1e-3, reading + 0.3 * quantum, 0.0))
    assert not fits(past, quantum, wraps)


@pytest.mark.slow
def test_once_found_the_error_is_that_with_the_quantum_given_at_150_starts():
    """It differed by more than 5 % at 36 of them."""
    compared = [compare(start) for start in starts()]
    ratios = [each.unknown / each.given for each in compared if each.found >= 0]
    assert min(ratios) > 0.95 and max(ratios) < 1.05
    assert len(ratios) >= 136  # readings as smooth as floats show no counter
