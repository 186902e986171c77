# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Streams that repeat their readings: recognised, dropped, and nothing else taken for one."""

import math

import numpy as np
import pytest
from observer_cases import angle_observers, make, plain, wrapped

from estimator_pkg.driver.batch import Estimates
from estimator_pkg.estimate import COASTING, INITIALISING, TRACKING
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


def beside_its_twin(name, rate, ratio, motion, counts, gains=None, readings=None, **settings):
    """(rms of the velocity after 1 s over that of the readings alone, the joint)."""
    angle, speed = motion
    times = np.arange(round(6.0 * rate)) / rate
    angles = read(times, angle, counts) if readings is None else readings(times)
    source = held(len(times), ratio)
    fresh = np.unique(source)
    joint, out = run(name, times, angles[source], gains, **settings)
    twin, alone = run(name, times[fresh], angles[fresh], gains, **settings)
    assert twin.dropped() == {}
    later = times > 1.0
    return (
        (rms(out, speed(times), later) / rms(alone, speed(times[fresh]), later[fresh])),
        joint,
        out,
    )


@pytest.mark.parametrize('name', angle_observers())
@pytest.mark.parametrize('known', [False, True])
@pytest.mark.parametrize('frequency', [0.5, 1.0, 2.0])
def test_each_second_reading_repeated(name, known, frequency):
    gains = {'quantum': TURN / 8000} if known else {}
    worse, joint, out = beside_its_twin(name, 224.0, 2, sine(frequency), 8000, gains)
    assert worse < 1.1
    assert np.all(out.verdict[224:][1::2] == REPEATED_READING) and not np.any(
        out.verdict[224:][::2] == REPEATED_READING
    )
    assert joint.dropped()['repeated'] > 540 and 'repeats its readings' in joint.why()
    assert joint.mean_dt == pytest.approx(2.0 / 224.0, rel=1e-4)


@pytest.mark.long
@pytest.mark.parametrize('name', angle_observers())
@pytest.mark.parametrize(
    ('rate', 'ratio', 'counts'),
    [
        (1000.0, 2, 4096),
        (1000.0, 3, 4096),
        (1000.0, 5, 8000),
        (1000.0, 10, 2**16),
        (10_000.0, 10, 2**20),
        (1000.0, 2.5, 8000),
    ],
)
def test_slower_sensors(name, rate, ratio, counts):
    worse, joint, out = beside_its_twin(name, rate, ratio, sine(0.8, 3.0), counts)
    assert worse < 1.3
    assert np.flatnonzero(out.verdict == REPEATED_READING)[0] < rate


@pytest.mark.parametrize('name', angle_observers())
def test_a_sensor_of_150_hz_published_at_224_hz(name):
    """A fresh reading is stamped up to one message late: that much error is the stamps'."""
    worse, joint, _ = beside_its_twin(name, 224.0, 224.0 / 150.0, sine(1.0), 8000)
    assert worse < 1.5
    assert joint.dropped()['repeated'] > 350


@pytest.mark.parametrize('name', angle_observers())
def test_without_a_circle_and_with_noise(name):
    worse, joint, _ = beside_its_twin(name, 224.0, 2, sine(1.0, 10.0), 8000, wrap_period=0.0)
    assert worse < 1.3 and joint.dropped()['repeated'] > 540
    random = np.random.default_rng(1)
    worse, joint, _ = beside_its_twin(
        name,
        224.0,
        2,
        sine(1.0),
        0,
        readings=lambda t: sine(1.0)[0](t) + random.normal(0.0, 1e-3, len(t)),
    )
    assert worse < 1.3 and joint.dropped()['repeated'] > 540


@pytest.mark.parametrize('speed', [1.0, 3.0, -20.0])
def test_at_constant_speed_from_the_start(speed):
    motion = (lambda t: speed * t, lambda t: speed + 0.0 * t)
    worse, joint, out = beside_its_twin('hybrid_angle', 224.0, 2, motion, 8000)
    assert worse < 1.1
    assert np.flatnonzero(out.verdict == REPEATED_READING)[0] < 224


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


def test_holds_of_every_length_at_random_are_no_pattern():
    """A driver that reads its sensor irregularly: one reading stays for one to nine messages."""
    random = np.random.default_rng(4)
    angle, _ = sine(0.5, 2.0)
    source = np.repeat(np.arange(0, 6000, 5), random.integers(1, 10, 1200))
    angles = read(np.arange(6000) / 1000.0, angle, 2**16)[source]
    joint, _ = run('finite_difference', np.arange(len(source)) / 1000.0, angles)
    assert joint.dropped() == {}


def encoders():
    """(label, times, readings) of streams that repeat nothing."""
    random = np.random.default_rng(2)
    for counts in (64, 4096, 2**16, 2**20):
        quantum = TURN / counts
        for rate in (100.0, 1000.0):
            count = round(max(4.0 * rate, 2000))
            number, times = np.arange(count), np.arange(count) / rate
            moving = {
                f'{d} counts a sample': d * quantum * number
                for d in (
                    0.0,
                    0.1,
                    1 / 3,
                    0.49,
                    0.5,
                    0.51,
                    2 / 3,
                    0.99,
                    1.0,
                    1.5,
                    2.0,
                    3.3,
                    counts - 0.5,
                    counts,
                    counts + 0.5,
                )
            }
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
@pytest.mark.parametrize(
    'name',
    [
        name if name == 'edge_adaptive' else pytest.param(name, marks=pytest.mark.slow)
        for name in angle_observers()
    ],
)
def test_live_plain_and_the_engine_agree(name):
    """At rest in noise, then a start; from 1 s on readings are repeated, and 0.4 s of rest."""
    angle, _ = sine(1.0)
    times = np.arange(2000) / 500.0
    angles = read(times, lambda t: angle(np.maximum(t - 0.5, 0.0)), 8000)
    angles[:250] += TURN / 8000 * np.random.default_rng(1).integers(-1, 2, 250)
    angles[500:] = angles[500:][held(1500, 3)]
    angles[1400:1600] = angles[1400]
    at = ns(times)
    live, rows = make(name), []
    for stamp, value in zip(at.tolist(), angles.tolist()):
        live.update(stamp, value)
        rows.append(live.verdict)
    slow, fast = plain(name), make(name)
    outs: list[Estimates] = [slow.run(at, angles), fast.run(at, angles)]
    for joint, out in zip((slow, fast), outs):
        assert out.verdict.tolist() == rows
        assert repr(joint.channel.track) == repr(live.channel.track)
        assert joint.counts == live.counts
    assert rows.count(REPEATED_READING) > 500
    used = outs[0].verdict < DUPLICATE
    for ours, twins in zip(outs[0][:5], outs[1][:5]):
        assert np.array_equal(twins[used], ours[used], equal_nan=True)
    assert np.isnan(outs[0].velocity[~used]).all() and np.any(outs[0].status == INITIALISING)
