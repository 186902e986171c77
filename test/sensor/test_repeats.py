# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Streams that repeat their readings: recognised, dropped, and nothing else taken for one."""

import math

import numpy as np
import pytest
from observer_cases import angle_observers, make, plain, wrapped

from estimator_pkg.estimate import COASTING, TRACKING
from estimator_pkg.sensor.guard import DUPLICATE, REPEATED_READING

START = 1_700_000_000_000_000_000
TURN = 2.0 * math.pi


def read(times, angle, counts):
    """What an encoder shows; 0 counts: no quantisation."""
    quantum = TURN / counts if counts else 0.0
    values = angle(times)
    return wrapped(np.floor(values / quantum) * quantum if counts else values)


def held(count, ratio):
    """Which reading each message carries, where only every `ratio`-th sample is a new one."""
    newest = np.floor(np.arange(count) / ratio + 1e-9)
    return np.ceil(newest * ratio - 1e-9).astype(int)


def ns(times):
    return START + np.rint(times * 1e9).astype(np.int64)


def run(name, times, angles, gains=None, **settings):
    joint = make(name, gains, **settings)
    return joint, joint.run(ns(times), angles)


def rms(out, speed, after):
    """Of the velocity from `after` [s] on, at samples that are published."""
    valid = after & (out.verdict < DUPLICATE) & np.isin(out.status, (TRACKING, COASTING))
    return math.sqrt(np.mean((out.velocity - speed)[valid] ** 2))


def sine(frequency, amplitude=1.2):
    rate = TURN * frequency
    return (lambda t: amplitude * np.sin(rate * t), lambda t: rate * amplitude * np.cos(rate * t))


def turning(speed):
    return (lambda t: speed * t, lambda t: speed + 0.0 * t)


def noisy_sine(times):
    return sine(1.0)[0](times) + np.random.default_rng(1).normal(0.0, 1e-3, len(times))


KNOWN, LINE = {'quantum': TURN / 8000}, {'wrap_period': 0.0}
# rate of the messages [Hz], and over that of the sensor; motion, counts, error over the twin's
SLOWER = [
    *((224.0, 2, sine(f), 8000, more, 1.1) for f in (0.5, 1.0, 2.0) for more in ({}, KNOWN)),
    *((1000.0, ratio, sine(0.8, 3.0), 8000, {}, 1.3) for ratio in (2.5, 3, 5)),
    (1000.0, 2, sine(0.8, 3.0), 4096, {}, 1.3),
    (1000.0, 10, sine(0.8, 3.0), 2**16, {}, 1.3),
    (10_000.0, 10, sine(0.8, 3.0), 2**20, {}, 1.3),
    # a fresh reading is stamped up to one message late: that much error is the stamps'
    (224.0, 224.0 / 150.0, sine(1.0), 8000, {}, 1.5),
    (224.0, 2, sine(1.0, 10.0), 8000, LINE, 1.3),
    (224.0, 2, (noisy_sine, sine(1.0)[1]), 0, {}, 1.3),
    *((224.0, 2, turning(speed), 8000, {}, 1.6) for speed in (1.0, -20.0)),
]


@pytest.mark.long
@pytest.mark.parametrize('rate, ratio, motion, counts, more, worse', SLOWER)
@pytest.mark.parametrize('name', angle_observers())
def test_a_sensor_slower_than_its_messages_is_as_good_as_alone(
    name, rate, ratio, motion, counts, more, worse
):
    angle, speed = motion
    times = np.arange(round(6.0 * rate)) / rate
    angles = read(times, angle, counts)
    source = held(len(times), ratio)
    fresh = np.unique(source)
    gains = {key: value for key, value in more.items() if key == 'quantum'}
    settings = {key: value for key, value in more.items() if key != 'quantum'}
    joint, out = run(name, times, angles[source], gains, **settings)
    twin, alone = run(name, times[fresh], angles[fresh], gains, **settings)
    assert twin.dropped() == {}
    later = times > 1.0
    assert rms(out, speed(times), later) < worse * rms(alone, speed(times[fresh]), later[fresh])
    repeated = np.diff(source, prepend=-1) == 0
    dropped = out.verdict == REPEATED_READING
    assert ratio % 1.0 > 0.0 or not np.any(dropped & ~repeated)
    assert np.flatnonzero(dropped)[0] < rate and dropped.sum() > 0.78 * repeated.sum()
    assert 'repeats its readings' in joint.why()


def test_rest_and_motion_again():
    """At rest every reading repeats: as many are used as the sensor gives, and none is late."""

    def angle(t):
        phase = np.clip(t % 4.0 - 1.0, 0.0, 2.0)
        return 2.0 * (1.0 - np.cos(math.pi * phase))

    times = np.arange(20_000) / 1000.0
    angles = read(times, angle, 8000)[held(len(times), 5)]
    joint, out = run('kalman', times, angles)
    used = np.flatnonzero(out.verdict < DUPLICATE)
    later = used[used > 2000]
    assert np.max(np.diff(later)) <= 5 and joint.events() == {}
    assert len(later) == pytest.approx(18_000 / 5, rel=0.02)
    assert 'repeats' in joint.why()


@pytest.mark.parametrize('ratio', [2, 3, 2.03, 4.97])
def test_lost_and_late_messages_and_clocks_that_drift(ratio):
    random = np.random.default_rng(5)
    angle, speed = sine(0.7, 2.0)
    times = np.arange(10_000) / 1000.0
    angles = read(times, angle, 8000)[held(len(times), ratio)]
    keep = random.random(len(times)) > 0.02
    stamped = times + random.uniform(0.0, 2e-4, len(times))
    joint, out = run('kalman', stamped[keep], angles[keep])
    times, stamped, angles = times[keep], stamped[keep], angles[keep]
    changed = np.flatnonzero(np.diff(angles) != 0.0) + 1
    assert np.all(out.verdict[changed] < DUPLICATE)
    _, alone = run('kalman', stamped[changed], angles[changed])
    assert rms(out, speed(times), times > 1.0) < 1.2 * rms(
        alone, speed(times[changed]), times[changed] > 1.0
    )
    share = np.mean(out.verdict[1000:] == REPEATED_READING)
    assert share == pytest.approx(1.0 - 1.0 / ratio, abs=0.04)


def test_undone_as_soon_as_the_pattern_breaks():
    angle, _ = sine(1.0)
    times = np.arange(4000) / 1000.0
    source = np.where(times < 2.0, held(len(times), 2), np.arange(len(times)))
    joint, out = run('hybrid_angle', times, read(times, angle, 2**18)[source])
    assert np.any(out.verdict[1000:2000] == REPEATED_READING)
    assert not np.any(out.verdict[2000:] == REPEATED_READING)
    assert 'repeats' not in joint.why()
    assert joint.mean_dt == pytest.approx(1e-3, rel=1e-3)


def test_recognition_survives_a_gap_and_ends_with_a_reset():
    angle, _ = sine(1.0)
    times = np.arange(4000) / 1000.0
    angles = read(times, angle, 8000)[held(len(times), 2)]
    times[2000:] += 5.0
    joint, out = run('kalman', times, angles)
    assert np.all(out.verdict[2003:][::2] == REPEATED_READING) and joint.events() == {'outage': 1}
    joint.reset()
    joint.update(START + 10**11, 0.0)
    assert 'repeats' not in joint.why()


def test_lost_repetitions_do_not_end_the_recognition():
    angle, _ = sine(1.0)
    times = np.arange(1200) / 224.0
    kept = ~((np.arange(1200) % 2 == 1) & (np.arange(1200) >= 600) & (np.arange(1200) < 640))
    _, out = run('finite_difference', times[kept], read(times, angle, 8000)[held(1200, 2)][kept])
    repeats = np.arange(1200)[kept] % 2 == 1
    assert np.array_equal(out.verdict[224:] == REPEATED_READING, repeats[224:])


@pytest.mark.parametrize('sense', [1.0, -1.0])
def test_a_sensor_that_becomes_slower_in_motion_is_not_taken_for_one_at_rest(sense):
    """Each reading comes twice, and then three times: a motion of equal direction all the time."""
    times = np.arange(3000) / 1000.0
    source = np.concatenate([held(1500, 2), 1500 + held(1500, 3)])
    angles = read(times, lambda t: sense * (2.0 * t + 0.8 * t**2), 8000)[source]
    _, out = run('finite_difference', times, angles)
    fresh = np.diff(source, prepend=-1) > 0
    assert np.array_equal(out.verdict[1600:] == REPEATED_READING, ~fresh[1600:])


def held_at_random(rate, shortest, longest, seed, seconds=20.0):
    """(times, readings, true velocity) of a sine, read over a bus at random times [s]."""
    random = np.random.default_rng(seed)
    times = np.arange(1, int(seconds * rate) + 1) / rate
    read_at = np.cumsum(random.uniform(shortest, longest, int(1.5 * seconds / shortest)))
    at = read_at[np.maximum(np.searchsorted(read_at, times) - 1, 0)]
    angle, speed = sine(0.5, 0.6)
    return times, np.round(angle(at) / 3.83e-4) * 3.83e-4, speed(times)


def fastest_hold(times, readings):
    """Largest way between two readings over the time between them [rad/s]."""
    at = np.r_[0, np.flatnonzero(np.diff(readings)) + 1]
    return np.max(np.abs(np.diff(readings[at])) / np.diff(times[at]))


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('rate, shortest, longest', [(350, 0.02, 0.1), (500, 0.028, 0.12)])
@pytest.mark.parametrize('name', angle_observers())
def test_readings_that_are_held_at_random_show_no_speed_that_nothing_moved(
    name, rate, shortest, longest, seed
):
    """84 rad/s of 1.9 was published: a reading that stayed was predicted on, and then jumped."""
    times, readings, speed = held_at_random(rate, shortest, longest, seed)
    joint, out = run(name, times, readings)
    later = (times > 2.0) & (out.verdict < DUPLICATE)
    most = fastest_hold(times, readings)
    assert np.max(np.abs(out.velocity[later])) < 1.3 * most
    assert rms(out, speed, times > 2.0) < 0.73
    assert 'repeats its readings' in joint.why()


@pytest.mark.parametrize('times', [3, 5, 8])
@pytest.mark.parametrize('name', ['edge_adaptive', 'kalman', 'pll'])
def test_a_sensor_that_repeats_and_starts_to_move_is_not_predicted_on(name, times):
    """230 rad/s were published of 22."""
    at = np.arange(600) / 200.0
    speed = np.clip(150.0 * (at - 0.5), 0.0, 56.0)
    angles = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) / 200.0)])
    _, out = run(name, at, wrapped(angles)[np.arange(600) // times * times])
    assert np.nanmax(np.abs(out.velocity)) < 1.2 * 56.0


@pytest.mark.parametrize('speed', [2.0, 10.0])  # 0.3 and 1.6 counts a sample
def test_counts_that_do_not_come_name_a_stop_or_a_stuck_sensor(speed):
    times = np.arange(3200) / 1000.0
    joint = make('kalman')
    joint.run(ns(times[:3000]), read(times[:3000], lambda t: speed * t, 1000))
    assert joint.why() == ''
    joint.run(ns(times[3000:]), read(0.0 * times[3000:] + 3.0, lambda t: speed * t, 1000))
    assert 'a stop, or a stuck sensor' in joint.why()


def test_a_joint_that_indexes_is_covered_at_rest():
    """0.51 +- 0.08 rad/s was published of a joint that rests between its steps."""
    times = np.arange(2000) / 100.0
    steps = 0.05 * np.floor(times / 0.1 + 1e-6)
    _, out = run('edge_adaptive', times, steps, {'quantum': TURN / 65536}, **LINE)
    later = times > 2.0
    assert np.mean(np.abs(out.velocity[later]) > 5.0 * out.velocity_stddev[later]) < 0.02


STEPS = (0.0, 0.1, 1 / 3, 0.49, 0.5, 0.51, 2 / 3, 0.99, 1.0, 1.5, 2.0, 3.3)


def encoders():
    """(label, times, readings) of streams that repeat nothing."""
    random = np.random.default_rng(2)
    for counts in (64, 4096, 2**16, 2**20):
        quantum = TURN / counts
        for rate in (100.0, 1000.0):
            count = round(max(4.0 * rate, 2000))
            number, times = np.arange(count), np.arange(count) / rate
            whole = (counts - 0.5, counts, counts + 0.5)
            moving = {f'{d} counts a sample': d * quantum * number for d in (*STEPS, *whole)}
            for f in (0.1, 0.5, 2.0, rate / 7.3, rate / 5, rate / 4):
                for size in (5 * quantum, 0.3, 3.0):
                    moving[f'{f} Hz, {size} rad'] = size * np.sin(TURN * f * times + math.pi / 4)
            moving['stops'] = np.floor(8 * times) + np.clip(8 * times % 1.0 - 0.5, 0.0, 0.5) * 2
            for name, exact in moving.items():
                for noise in (0.0, 0.5, 2.0):
                    shown = wrapped(
                        np.floor(exact / quantum + noise * random.standard_normal(count)) * quantum
                    )
                    yield (counts, rate, name, noise), times, shown
                yield (counts, rate, name, 'clipped'), times, np.clip(shown, -0.5, 0.7)
                still = wrapped(np.floor(exact / quantum) * quantum)
                yield (counts, rate, name, 'float32'), times, still.astype(np.float32).astype(float)
                still[: count // 4] = 1e-12 * random.standard_normal(count // 4)
                yield (counts, rate, name, 'residue'), times, still


@pytest.mark.long
def test_nothing_else_is_taken_for_a_repeated_reading():
    joint = make('finite_difference')
    for label, times, shown in encoders():
        joint.reset()  # as a new one, which takes longer to make
        joint.run(ns(times), shown)
        assert joint.dropped() == {}, label


@pytest.mark.long
def test_plain_and_the_engine_agree():
    """At rest in noise, then a start; from 1 s on readings are repeated, and 0.4 s of rest."""
    angle, _ = sine(1.0)
    times = np.arange(2000) / 500.0
    angles = read(times, lambda t: angle(np.maximum(t - 0.5, 0.0)), 8000)
    angles[:250] += TURN / 8000 * np.random.default_rng(1).integers(-1, 2, 250)
    angles[500:] = angles[500:][held(1500, 3)]
    angles[1400:1600] = angles[1400]
    slow, fast = plain('edge_adaptive'), make('edge_adaptive')
    out, compiled = slow.run(ns(times), angles), fast.run(ns(times), angles)
    assert np.sum(out.verdict == REPEATED_READING) > 500
    assert repr(slow.channel) == repr(fast.channel)
    for one, other in zip(out, compiled):
        assert np.array_equal(one, other, equal_nan=True)
