# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Stamps of regular devices are repaired, those of irregular ones are left alone."""

import math
from functools import lru_cache

import numpy as np
import pytest
from observer_cases import make

from benchmarks.signals import Signal, constant, encoder, sine, trapezoid
from estimator_pkg.sensor.guard import DUPLICATE
from estimator_pkg.sensor.stamp_repair import (
    COLLECTING,
    FIRST_FIT,
    LEFT_ALONE,
    REPAIRED,
    SLOW_FIRST_FIT,
    StampRepair,
)
from estimator_pkg.streams.clocks import Clocks

TURN = 2.0 * math.pi
MOTIONS = {
    'sine': sine(5.0, 2.0),
    'trapezoid': trapezoid(20.0, 100.0, 0.8),
    'fast': constant(200.0),
}
MS = 1_000_000
START = 1_700_000_000_000_000_000


def repaired(stamps, angle, names=('joint',)):
    """(times that are used, states, the repair)."""
    repair, times, states = StampRepair(lambda name: TURN), [], []
    for stamp, reading in zip(np.asarray(stamps).tolist(), np.asarray(angle).tolist()):
        times.append(repair(stamp, names, (reading,) * len(names)))
        states.append(repair.state)
    return np.array(times), states, repair


@lru_cache
def recorded(name, rate=1000.0, jitter=0.0, dropped=0.0, duration=7.0):
    return Signal('', '', MOTIONS[name], rate=rate, jitter=jitter, dropped=dropped).samples(
        duration=duration
    )


def error(observer, stamps, samples, skipped=5.0):
    """The rms velocity error with these stamps, after `skipped` [s]."""
    out = make(observer).run(np.asarray(stamps, np.int64), samples.angle)
    counted = (out.verdict < DUPLICATE) & (samples.stamps - samples.stamps[0] > 1e9 * skipped)
    return float(np.sqrt(np.mean((out.velocity - samples.velocity)[counted] ** 2)))


def delays(kind, count, random):
    """Delays of messages [ns]."""
    if kind == 'either way':
        return random.integers(-MS, MS, count)
    if kind == 'in order':  # they wait in a queue
        times = np.arange(count) * MS
        return np.maximum.accumulate(times + random.integers(0, MS, count)) - times
    return random.integers(0, MS, count)


@pytest.mark.parametrize(
    'name, kind, observer',
    [
        ('sine', 'late', 'edge_adaptive'),
        pytest.param('sine', 'either way', 'edge_adaptive', marks=pytest.mark.slow),
        ('sine', 'either way', 'hybrid_angle'),
        pytest.param('sine', 'in order', 'hybrid_angle', marks=pytest.mark.slow),
        ('trapezoid', 'late', 'hybrid_angle'),
        pytest.param('trapezoid', 'either way', 'edge_adaptive', marks=pytest.mark.slow),
        ('trapezoid', 'in order', 'edge_adaptive'),
        ('fast', 'either way', 'hybrid_angle'),
    ],
)
@pytest.mark.long
def test_a_millisecond_of_jitter_at_a_kilohertz(name, kind, observer):
    samples = recorded(name)
    stamps = samples.stamps + delays(kind, len(samples.stamps), np.random.default_rng(1))
    times, states, repair = repaired(stamps, samples.angle)
    true = error(observer, samples.stamps, samples)
    assert 0.9 * true < error(observer, times, samples) < 1.2 * true
    assert states[0] == COLLECTING and states[-1] == REPAIRED
    assert np.all(np.diff(times[states.index(REPAIRED) :]) > 0)
    assert repair.period == pytest.approx(1e-3, rel=2e-5)
    assert 0.2e-3 < repair.jitter < 0.6e-3


@pytest.mark.parametrize('name', ['sine', 'trapezoid'])
@pytest.mark.parametrize('jitter', [0.1, 0.4])
def test_sampling_that_jitters_is_left_alone(name, jitter):
    samples = recorded(name, jitter=jitter)
    times, states, _ = repaired(samples.stamps, samples.angle)
    assert np.array_equal(times, samples.stamps)
    assert states[-1] == LEFT_ALONE


@pytest.mark.parametrize('draw', ['poisson', 'uniform'])
def test_irregular_sampling_is_left_alone(draw):
    random = np.random.default_rng(3)
    steps = (
        random.exponential(1e-3, 7000) if draw == 'poisson' else random.uniform(2e-4, 2e-3, 7000)
    )
    time = np.cumsum(steps)
    stamps = 1_000_000_000 + np.rint(1e9 * time).astype(np.int64)
    times, _, _ = repaired(stamps, encoder(MOTIONS['sine'](time)[0]))
    assert np.array_equal(times, stamps)


def test_stamps_are_left_alone_where_readings_cannot_tell():
    samples = recorded('sine', duration=3.0)
    random = np.random.default_rng(2)
    noisy = samples.angle + 0.05 * random.standard_normal(len(samples.angle))
    stamps = samples.stamps + random.integers(0, MS // 10, len(samples.stamps))
    times, _, _ = repaired(stamps, noisy)
    assert np.array_equal(times, stamps)


def test_exact_stamps_stay_exact():
    for dropped in (0.0, 0.1):
        samples = recorded('sine', dropped=dropped)
        times, _, repair = repaired(samples.stamps, samples.angle)
        assert np.array_equal(times, samples.stamps)
        assert repair.period == pytest.approx(1e-3, rel=1e-9)


def test_lost_messages_of_a_quiet_clock():
    samples = recorded('sine', dropped=0.01)
    stamps = samples.stamps + np.random.default_rng(5).integers(0, 200_000, len(samples.stamps))
    times, states, _ = repaired(stamps, samples.angle)
    off = times - samples.stamps
    assert states[-1] == REPAIRED
    assert np.std(off[5000:]) < 60_000  # [ns]
    assert error('edge_adaptive', times, samples) < 1.2 * error(
        'edge_adaptive', samples.stamps, samples
    )


@pytest.mark.parametrize(
    'name, rate, dropped, drift',
    [
        pytest.param('fast', 1000.0, 0.05, 0.0, marks=pytest.mark.slow),
        ('fast', 200.0, 0.1, 1e-4),
        ('sine', 1000.0, 0.05, 1e-4),
        ('sine', 100.0, 0.1, 0.0),
        pytest.param('trapezoid', 1000.0, 0.1, 0.0, marks=pytest.mark.slow),
    ],
)
@pytest.mark.long
def test_messages_lost_from_the_first_one_on(name, rate, dropped, drift):
    """With 0.6 periods of jitter a line through the stamps has one period for each message."""
    motion = sine(1.5, 0.2) if rate == 100.0 else MOTIONS[name]
    whole = Signal('', '', motion, rate=rate).samples(duration=7.0 if rate > 100.0 else 12.0)
    random = np.random.default_rng(5)
    kept = random.random(len(whole.stamps)) > dropped
    samples = type(whole)(*(each[kept] for each in whole))
    passed = (samples.stamps - START) * (1.0 + drift)
    true = START + passed.astype(np.int64)
    stamps = true + (0.6e9 / rate * random.random(len(true))).astype(np.int64)
    times, states, repair = repaired(stamps, samples.angle)
    settled = times[samples.stamps - samples.stamps[0] > 5_000_000_000]
    assert np.std(settled - true[-len(settled) :]) < 0.08e9 / rate
    assert states[-1] == REPAIRED and repair.drift == pytest.approx(-drift, abs=5e-5)
    assert error('hybrid_angle', times, samples) < 1.2 * error('hybrid_angle', true, samples)


@pytest.mark.parametrize('back', [20, 50, 300, 500, 10_000])
def test_a_clock_that_jumps_back_begins_another_stretch(back):
    """Time must not go on slowly until the new clock has caught up with the old one."""
    samples = recorded('sine', duration=2.0)
    random = np.random.default_rng(6)
    stamps = samples.stamps + random.integers(0, MS, len(samples.stamps))
    stamps[1000:] -= back * MS
    times, states, repair = repaired(stamps, samples.angle)
    assert states[999] == REPAIRED and np.max(np.abs(times - stamps)) < 3 * MS
    assert repair.period == pytest.approx(1e-3, rel=1e-3) and COLLECTING not in states[100:]


@pytest.mark.parametrize('gap', [True, False])
def test_gaps_and_steps_of_the_clock_do_not_forget_the_period(gap):
    samples = recorded('sine', duration=9.0)
    stamps = samples.stamps + np.random.default_rng(7).integers(0, MS, len(samples.stamps))
    kept = np.ones(len(stamps), bool)
    if gap:
        kept[3000:3900] = False
    else:
        stamps[2000:] += 1_000_000_000
        stamps[5000:] -= 3_000_000_000
    true, stamps = samples.stamps[kept], stamps[kept]
    times, states, repair = repaired(stamps, samples.angle[kept])
    assert states.count(COLLECTING) < 70
    assert repair.period == pytest.approx(1e-3, rel=1e-4)
    assert np.max(np.abs(times - stamps)) < 3 * MS
    assert np.std((times - true)[true - true[0] > 6_000_000_000]) < 100_000


@pytest.mark.long
@pytest.mark.parametrize('first, then', [(500, 1000), (1000, 500)])
def test_another_period(first, then):
    samples = recorded('sine', duration=10.0)
    kept = np.ones(len(samples.stamps), bool)
    (kept[1:4000:2] if first == 500 else kept[4001::2])[:] = False
    rest = type(samples)(*(each[kept] for each in samples))
    stamps = rest.stamps + np.random.default_rng(8).integers(0, MS, len(rest.stamps))
    times, states, repair = repaired(stamps, rest.angle)
    assert repair.period == pytest.approx(1.0 / then, rel=1e-4)
    assert states[-1] == REPAIRED
    assert error('edge_adaptive', times, rest, 6.0) < 1.2 * error(
        'edge_adaptive', rest.stamps, rest, 6.0
    )


def test_the_period_is_that_of_least_squares_over_all_messages():
    """Until the memory ends, and while no residual is clipped: the recursion is exact."""
    times = np.arange(900) * 10 * MS
    stamps = START + times + np.random.default_rng(3).integers(-200_000, 200_000, 900)
    for count in (FIRST_FIT, 300, 900):
        _, states, repair = repaired(stamps[:count], np.zeros(count))
        slope, _ = np.polyfit(np.arange(count), stamps[:count] - START, 1)
        assert repair.period == pytest.approx(1e-9 * slope, rel=1e-9)
        assert repair.jitter == pytest.approx(100e-6, rel=0.1)
    assert set(states) == {COLLECTING, LEFT_ALONE}  # no reading shows which times are right


def test_it_is_repaired_within_a_second_of_motion_and_not_at_once():
    samples = recorded('trapezoid')
    stamps = samples.stamps + delays('either way', len(samples.stamps), np.random.default_rng(1))
    _, states, _ = repaired(stamps, samples.angle)
    assert 0.5e9 <= stamps[states.index(REPAIRED)] - stamps[0] < 1e9


def test_a_pause_of_seven_periods_is_part_of_the_first_fit():
    stamps = START + np.cumsum([0, 200, 200, 200, 1400, *[200] * 12]) * MS
    _, states, repair = repaired(stamps, np.zeros(len(stamps)))
    assert states.index(LEFT_ALONE) == SLOW_FIRST_FIT - 1
    assert repair.period == pytest.approx(0.2, rel=1e-9)


def test_joints_that_show_nothing_take_nothing_from_one_that_shows_lost_messages():
    whole, random = recorded('fast', duration=3.0), np.random.default_rng(5)
    kept = (np.arange(3000) < 1000) | (random.random(3000) > 0.02)
    samples = type(whole)(*(each[kept] for each in whole))
    stamps = samples.stamps + random.integers(0, 6 * MS // 10, len(samples.stamps))
    alone, _, _ = repaired(stamps, samples.angle)
    noise = 1e-3 * random.standard_normal(len(stamps))
    repair, names = StampRepair(lambda name: TURN), ('still', 'none', 'sways', 'joint')
    times = [
        repair(stamp, names, (0.4, math.nan, *readings))
        for stamp, *readings in zip(stamps.tolist(), noise.tolist(), samples.angle.tolist())
    ]
    assert np.array_equal(times, alone)
    assert np.std((alone - samples.stamps)[1000:]) < 60_000  # [ns]


@pytest.mark.parametrize('speed', [-0.6, 0.6])
def test_equal_readings_in_a_batch_are_not_one_message(speed):
    """0.6 counts per message: each third reading or so equals the one before."""
    counts = np.floor(speed * np.arange(3000))
    stamps = START + (np.arange(3000) // 5 + 1) * 5 * MS
    _, _, repair = repaired(stamps, counts * TURN / 4096)
    assert repair.period == pytest.approx(1e-3, rel=1e-3)


@pytest.mark.long
def test_messages_in_batches():
    samples = recorded('sine')
    stamps = samples.stamps.copy()
    for first in range(0, len(stamps) - 4, 5):
        stamps[first : first + 5] = stamps[first + 4]
    times, _, _ = repaired(stamps, samples.angle)
    true = error('edge_adaptive', samples.stamps, samples)
    assert error('edge_adaptive', stamps, samples) > 1.3 * true
    assert error('edge_adaptive', times, samples) < 1.2 * true


def test_messages_that_come_twice_are_known_again():
    samples = recorded('sine')
    random = np.random.default_rng(9)
    stamps = samples.stamps + random.integers(0, MS, len(samples.stamps))
    twice = np.sort(np.concatenate([np.arange(len(stamps)), random.integers(0, 7000, 400)]))
    times, _, repair = repaired(stamps[twice], samples.angle[twice])
    assert np.all(np.diff(times)[np.diff(twice) == 0] == 0)
    assert repair.period == pytest.approx(1e-3, rel=2e-5)
    once, _, _ = repaired(stamps, samples.angle)
    assert np.array_equal(times[np.unique(twice, return_index=True)[1]], once)


def test_messages_that_are_lost_again_and_again_are_known_while_nothing_moves():
    """The first ones are taken for delays until the stamps stay late, a period too early."""
    k = np.arange(2500)
    angle = 0.5 * np.sin(0.02 * np.minimum(k, 1000))
    arrives = (k < 1100) | (k % 40 != 0)
    stamps = START + MS * k + np.random.default_rng(3).integers(0, 520_000, len(k))
    times, states, _ = repaired(stamps[arrives], angle[arrives])
    late = (times - START - MS * k[arrives]) / MS
    late = (late - np.median(late))[1:][np.diff(k[arrives]) > 1]
    assert states[-1] == REPAIRED
    assert late[0] < -0.9
    assert np.max(np.abs(late[10:])) < 0.1


def test_stamps_that_are_none_pass():
    repair = StampRepair(lambda name: TURN)
    assert repair(0, ('joint',), (0.1,)) == 0
    assert repair(-5, ('joint',), (0.1,)) == -5
    assert repair(7, ('joint', 'more'), (0.1,)) == 7
    assert repair(1_000_000_000, ('joint',), (math.nan,)) == 1_000_000_000


def test_readings_that_are_none_do_no_harm():
    samples = recorded('sine')
    angle = samples.angle.copy()
    angle[0], angle[2500::7], angle[2501::70], angle[2502::90] = math.nan, math.nan, math.inf, 1e300
    stamps = samples.stamps + delays('late', len(angle), np.random.default_rng(1))
    _, states, repair = repaired(stamps, angle)
    assert states[-1] == REPAIRED
    assert repair.period == pytest.approx(1e-3, rel=2e-5)


def test_each_device_of_a_topic_has_its_clock():
    clocks = Clocks(lambda name: TURN)
    samples = recorded('sine')
    random = np.random.default_rng(10)
    late = random.integers(0, MS, (2, 7000))
    for k in range(7000):
        reading = float(samples.angle[k])
        clocks(int(samples.stamps[k] + late[0, k]), ['a', 'b'], (reading, reading))
        if k % 5 == 0:
            clocks(int(samples.stamps[k] + late[1, k]), ['c'], (reading,))
    assert clocks.about('a') == clocks.about('b')
    assert clocks.about('a')['device_period_s'] == pytest.approx(1e-3, rel=1e-4)
    assert clocks.about('c')['device_period_s'] == pytest.approx(5e-3, rel=1e-4)
    assert {clocks.about(name)['stamp_repair'] for name in 'abc'} == {REPAIRED}
    assert clocks.about('d') == {}
    clocks.reset()
    assert clocks.about('a') == {}


@pytest.mark.parametrize(
    'period, drift', [(1.0 / 100.05, 5e-4), (1.0 / 100.4, math.nan), (0.0, math.nan)]
)
def test_a_drift_is_that_from_a_whole_number_of_hertz_close_by(period, drift):
    repair = StampRepair(lambda name: TURN)
    repair.period = period
    assert repair.drift == pytest.approx(drift, nan_ok=True)
