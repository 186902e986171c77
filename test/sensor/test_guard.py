# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The guard for time and data: whatever the stamps, nothing is lost silently and nothing breaks."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from observer_cases import angle_observers, make, plain, wrapped

from estimator_pkg.estimate import COASTING, INITIALISING, TRACKING
from estimator_pkg.sensor.guard import (
    AFTER_CLOCK_JUMP,
    AFTER_GAP,
    AFTER_OUTAGE,
    DROP_REASONS,
    DUPLICATE,
    FIRST_SAMPLE,
    LATE_IN_A_ROW,
    LATE_STAMP,
    NON_FINITE,
    USED_SAMPLE,
    VERDICTS,
    ZERO_STAMP,
    why_dropped,
)

MS = 1_000_000
START = 1_700_000_000_000_000_000
FARTHEST = 2**63 - 1

anything = st.integers(-(2**63), FARTHEST)
steps = st.one_of(
    st.sampled_from([0, 1, MS, -MS, -150 * MS, 250 * MS, 10**18, -(10**18)]),
    st.integers(-300 * MS, 300 * MS),
)
angles = st.one_of(st.floats(-4.0, 4.0), st.sampled_from([math.nan, math.inf, -math.inf, 1e300]))


@st.composite
def arrivals(draw):
    """Stamps that mostly go on from the last, and at times are anything an int64 can be."""
    now = draw(st.one_of(st.just(START), anything))
    rows = []
    for step, wild, stamp, angle in draw(
        st.lists(st.tuples(steps, st.integers(0, 9), anything, angles), min_size=1, max_size=60)
    ):
        if wild == 0:
            rows.append((stamp, angle))
            continue
        now = min(max(now + step, -(2**63)), FARTHEST)
        rows.append((now, angle))
    return rows


@settings(max_examples=300, deadline=None)
@given(arrivals())
@example([(1, 0.0), (FARTHEST, 0.1), (2, 0.2), (-(2**63), 0.3), (3, 0.4)])
@example([(START, 0.0), (START, 0.0), (START - 1, 0.0), (0, 0.0), (START + 10**18, 0.0)])
@pytest.mark.long
def test_received_is_used_plus_each_kind_of_dropped(rows):
    joint = make('kalman')
    used = 0
    for stamp, angle in rows:
        before, counts = joint.channel.track, list(joint.counts)
        used += joint.update(stamp, angle)
        assert sum(joint.counts) == sum(counts) + 1
        assert joint.counts[joint.verdict] == counts[joint.verdict] + 1
        if joint.verdict >= DUPLICATE:
            after = joint.channel.track
            assert after.clock.last_ns == before.clock.last_ns
            assert repr(after.state) == repr(before.state) and after.reading == before.reading
        else:
            assert joint.last_ns == stamp > 0
    assert joint.received == len(rows)
    assert joint.used == used == len(rows) - sum(joint.dropped().values())
    assert sum(joint.events().values()) <= used


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(arrivals())
def test_batch_judges_as_the_live_joint_does(rows):
    """The engine counts in int64, Python in whole numbers of any size."""
    live, slow, fast = make('pll'), plain('pll'), make('pll')
    verdicts = []
    for stamp, angle in rows:
        live.update(stamp, angle)
        verdicts.append(live.verdict)
    at = np.array([stamp for stamp, _ in rows], np.int64)
    measured = np.array([angle for _, angle in rows])
    for joint in (slow, fast):
        out = joint.run(at, measured)
        assert out.verdict.tolist() == verdicts
        assert joint.counts == live.counts
        assert repr(joint.channel.track.clock) == repr(live.channel.track.clock)


def running(name='kalman', speed=5.0, count=1000, dt_ns=MS, gains=None, **settings):
    """A joint that tracks, and a function that feeds it more of the same motion."""
    joint = make(name, gains, **settings)

    def feed(stamp, moment=None):
        t = ((stamp if moment is None else moment) - START) * 1e-9
        joint.update(stamp, wrapped(speed * t).item())
        return joint.verdict

    for i in range(count):
        feed(START + i * dt_ns)
    assert joint.estimate()[3] == TRACKING
    return joint, feed, START + (count - 1) * dt_ns


def test_verdict_of_each_kind():
    joint, feed, now = running(count=200)
    assert joint.counts[FIRST_SAMPLE] == 1 and joint.counts[USED_SAMPLE] == 199
    assert feed(now) == DUPLICATE
    assert feed(now - 1) == LATE_STAMP
    assert feed(now + MS) == USED_SAMPLE
    assert feed(0) == ZERO_STAMP and feed(-5) == ZERO_STAMP
    joint.update(now + 2 * MS, math.nan)
    assert joint.verdict == NON_FINITE
    assert feed(now + 3 * MS) == USED_SAMPLE
    assert feed(now + 300 * MS) == AFTER_GAP
    assert feed(now + 301 * MS) == USED_SAMPLE
    assert feed(now + 201 * MS) == LATE_STAMP  # by just the reorder window
    assert feed(now + 201 * MS - 1) == AFTER_CLOCK_JUMP
    assert joint.dropped() == {'duplicate': 1, 'late': 2, 'zero_stamp': 2, 'non_finite': 1}
    assert joint.events() == {'gap': 1, 'clock_jump': 1}
    assert set(VERDICTS) >= set(joint.dropped()) | set(joint.events())


@pytest.mark.parametrize('position', [0, 1, 2, 50])
@pytest.mark.parametrize('dt_ns', [MS, 10 * MS, 1000 * MS])
def test_a_far_future_stamp_anywhere_in_a_stream_does_no_lasting_harm(position, dt_ns):
    joint = make('finite_difference', {'bandwidth_hz': 0.3e9 / dt_ns})
    verdicts = []
    for i in range(100):
        stamp = START + i * dt_ns + (10**17 if i == position else 0)
        joint.update(stamp, wrapped(0.1 * i).item())
        verdicts.append(joint.verdict)
    assert joint.dropped() == {}
    assert verdicts[position + 4 :] == [USED_SAMPLE] * (96 - position)
    # a first stamp from there cannot be reported from a clock that jumped
    assert ('clock_jump' in joint.events()) == (position == 0)
    assert joint.estimate()[3] == TRACKING
    assert joint.estimate()[1] == pytest.approx(0.1e9 / dt_ns, rel=1e-6)
    assert joint.mean_dt == pytest.approx(dt_ns * 1e-9, rel=0.05)


def test_three_late_ones_in_a_row_mean_that_the_clock_jumped():
    joint, feed, now = running()
    back = now - 50 * MS  # within the reorder window
    assert [feed(back + i * MS) for i in range(4)] == [LATE_STAMP] * (LATE_IN_A_ROW - 1) + [
        AFTER_CLOCK_JUMP,
        USED_SAMPLE,
    ]
    joint, feed, now = running()
    for i in range(20):  # never in a row
        assert feed(now + 2 * i * MS - 3 * MS) in (LATE_STAMP, DUPLICATE)
        assert feed(now + 2 * i * MS - 5 * MS) in (LATE_STAMP, DUPLICATE)
        assert feed(now + 2 * (i + 1) * MS) == USED_SAMPLE
    assert joint.events() == {}


def test_a_stream_that_becomes_slow_is_learnt():
    joint, feed, now = running(speed=0.5)
    for i in range(1, 40):
        feed(now + i * 1000 * MS)
    assert joint.events() == {'outage': 2}  # the first might be an outage, two in a row are none
    assert joint.estimate()[3] == TRACKING
    for i in range(1, 2000):
        feed(now + 39_000 * MS + i * MS)
    assert feed(now + 41_300 * MS) == AFTER_GAP  # and the fast rate again


def test_a_gap_flags_and_keeps_the_speed():
    for name in ('finite_difference', 'pll', 'kalman', 'hybrid_angle'):
        joint, feed, now = running(name)
        assert feed(now + 500 * MS) == AFTER_GAP
        position, velocity, _, status = joint.estimate()
        assert status == COASTING
        assert velocity == pytest.approx(5.0, abs=1e-6)
        assert position == pytest.approx(wrapped(5.0 * (now + 500 * MS - START) * 1e-9))
        for i in range(1, 400):
            feed(now + 500 * MS + i * MS)
            assert joint.estimate()[1] == pytest.approx(5.0, abs=1e-6)
        assert joint.estimate()[3] == TRACKING


@pytest.mark.parametrize('name', angle_observers())
@pytest.mark.parametrize('outage', [0.501, 5.0, 60.0, 3000.0])
def test_nothing_of_the_speed_before_an_outage_is_published(name, outage):
    """8 rad/s, silence, and back at rest at a new angle: never a speed that is not of now."""
    joint, feed, now = running(name, speed=8.0)
    begin = now + round(outage * 1e9)
    for i in range(500):
        joint.update(begin + i * MS, 1.234)
        assert joint.verdict == (AFTER_OUTAGE if i == 0 else USED_SAMPLE)
        _, velocity, _, status = joint.estimate()
        assert abs(velocity) < 1e-6 or status == INITIALISING
        assert i > 0 or status == INITIALISING
    assert joint.estimate()[3] == TRACKING
    assert joint.events() == {'outage': 1}
    assert joint.mean_dt == pytest.approx(1e-3, rel=1e-6)


def test_an_outage_is_longer_than_timeout_gap_max_and_four_sample_times():
    """Each of the three is the longest once; a nanosecond tells."""
    for dt_ms, values, longest in (
        (1, {}, 500),
        (1, {'gap_max': 0.9}, 900),
        (1, {'timeout': 2.0}, 2000),
        (200, {}, 800),
    ):
        for more, verdict in ((0, None), (1 if dt_ms == 1 else MS, AFTER_OUTAGE)):
            joint, feed, now = running(speed=0.5, count=100, dt_ns=dt_ms * MS, **values)
            found = feed(now + longest * MS + more)
            assert found == verdict if verdict else found in (AFTER_GAP, USED_SAMPLE)


@pytest.mark.parametrize('name', angle_observers())
@pytest.mark.parametrize('rate', [0.5, 1.0, 2.0, 5.0])
def test_slow_streams_track_after_five_samples(name, rate):
    joint = make(name)
    for i in range(40):
        stamp = START + round(i * 1e9 / rate)
        joint.update(stamp, wrapped(0.1 * i).item())
        assert joint.verdict == (USED_SAMPLE if i else FIRST_SAMPLE)
        if i >= 5:
            assert joint.estimate()[3] == TRACKING
            assert joint.silence == pytest.approx(max(0.5, 4.0 / rate))
    assert joint.estimate()[1] == pytest.approx(0.1 * rate, rel=0.02)


@pytest.mark.parametrize('first', [1.0, 5.0, 8.0, 60.0])
def test_an_odd_first_sample_time_is_no_rate(first):
    """A message, silence, and then 1 kHz: neither a slow stream nor a speed over the silence."""
    for name in angle_observers():
        joint = make(name)
        joint.update(START, 1.0)
        begin = START + round(first * 1e9)
        for i in range(300):
            joint.update(begin + i * MS, wrapped(2.0 + 3e-3 * i).item())
            _, velocity, _, status = joint.estimate()
            assert status != TRACKING or velocity == pytest.approx(3.0, rel=0.2)
        assert joint.estimate()[3] == TRACKING
        assert joint.mean_dt == pytest.approx(1e-3, rel=1e-3)
        assert joint.events() == {'outage': 1} and joint.dropped() == {}


@pytest.mark.parametrize('name', angle_observers())
def test_turns_survive_outages_and_jumps_of_the_clock(name):
    joint = make(name, unwrap=True)
    for i in range(2000):
        joint.update(START + i * MS, wrapped(10e-3 * i).item())
    assert joint.estimate()[0] == pytest.approx(19.99, abs=0.01) and joint.why() == ''
    for begin in (START + 60_000 * MS, START):
        for i in range(100):
            joint.update(begin + i * MS, wrapped(20.5).item())
        assert joint.estimate()[0] == pytest.approx(20.5, abs=0.01)
        assert 'turns' in joint.why()
    assert joint.events() == {'outage': 1, 'clock_jump': 1}
    joint.reset()
    for i in range(100):
        joint.update(START + 90_000 * MS + i * MS, wrapped(20.5).item())
    assert joint.estimate()[0] == pytest.approx(wrapped(20.5), abs=0.01)
    assert 'turns' not in joint.why()


def test_the_convention_of_a_multi_turn_reading_survives_an_outage():
    joint = make('hybrid_angle')
    for i in range(2000):
        joint.update(START + i * MS, 10e-3 * i)
    for i in range(100):
        joint.update(START + 60_000 * MS + i * MS, 3.1 - 1e-3 * i)
        assert joint.estimate()[0] == pytest.approx(3.1 - 1e-3 * i, abs=0.01)


EVEN = range(1000)  # [ms]


@pytest.mark.parametrize(
    'after, events, mean_dt',
    [
        ((*EVEN, 1900), {'outage': 1}, 1e-3),
        ((*EVEN, -3_600_000, -3_599_600), {'gap': 1, 'clock_jump': 1}, 1e-3),
        ((*EVEN, 4000, 7000, *range(7001, 7050), 10_050), {'outage': 3}, 1e-3),
        ((*EVEN, 1200, 1000, 1001), {'gap': 1, 'stray_stamp': 1}, 1e-3),
        ((*EVEN, 10**12, 1000, 1001), {'outage': 1, 'stray_stamp': 1}, 1e-3),
        ((0, 2000, 10, 20), {'stray_stamp': 1}, 0.01),
        # of two holes in a row the shorter one shows the rate
        ((*range(0, 500, 10), 990, 2990), {'gap': 1, 'outage': 1}, 0.5),
        # the slowest stream has half a hertz, with three samples lost
        ((0, 7900), {}, 7.9),
        ((0, 8500), {'outage': 1}, 0.0),
    ],
)
def test_holes_and_stray_stamps_do_not_make_the_rate_look_slow(after, events, mean_dt):
    joint = make('kalman')
    for stamp in after:
        joint.update(START + stamp * MS, 0.0)
    assert joint.events() == events and joint.dropped() == {}
    assert joint.mean_dt == pytest.approx(mean_dt, rel=1e-6)


def test_a_few_holes_one_behind_the_other_do_not_make_the_rate_look_slow():
    """Three holes with one sample between them, as a bad radio link makes them, at 1 kHz: two make
    the mean sample time that of a slow stream, and a hundred short steps mend it: the next hole is
    found to be one.
    """
    joint, feed, now = running()
    assert feed(now + 300 * MS) == AFTER_GAP and joint.mean_dt == pytest.approx(1e-3)
    assert feed(now + 600 * MS) == AFTER_GAP and joint.mean_dt == pytest.approx(0.3)
    feed(now + 900 * MS)
    for i in range(1, 100):
        feed(now + 900 * MS + i * MS)
    assert joint.mean_dt < 0.05
    assert feed(now + 1300 * MS) == AFTER_GAP


def test_gap_max_and_reorder_window_are_what_is_set():
    joint, feed, now = running(gap_max=0.5, reorder_window=0.02, timeout=0.501)
    assert feed(now + 400 * MS) == USED_SAMPLE
    assert feed(now + 901 * MS) == AFTER_GAP
    assert feed(now + 902 * MS) == USED_SAMPLE
    assert feed(now + 882 * MS) == LATE_STAMP
    assert feed(now + 881 * MS) == AFTER_CLOCK_JUMP


def test_a_hole_too_long_for_the_gains_is_passed_over_as_a_gap():
    """Algorithm 1 with epsilon = 0.1 s is unstable beyond 29.7 ms. At 1 kHz one dt of 150 ms is no
    reason to give up, but a step over it would throw the position far off."""
    joint, feed, now = running('hybrid_angle', gains={'form': 'paper', 'epsilon': 0.1})
    assert joint.longest_dt == pytest.approx(0.029666, rel=1e-3)
    assert feed(now + 150 * MS) == AFTER_GAP
    assert joint.estimate()[1] == pytest.approx(5.0, abs=1e-2)
    assert joint.estimate()[3] == COASTING
    assert feed(now + 151 * MS) == USED_SAMPLE
    assert joint.dropped() == {}


def test_only_missing_stamps_have_the_remedy_for_stamps():
    for kind in DROP_REASONS:
        said = why_dropped(10, {kind: 10}, 'stamp them')
        assert said.startswith('every sample dropped: ')
        assert said.endswith(': stamp them') is (kind == 'zero_stamp')
    assert why_dropped(10, {'late': 5}, 'stamp them') == ''
