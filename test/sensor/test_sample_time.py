# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The time that passed between two readings, where stamps are right and where they are not."""

import math

import numpy as np
import pytest
from observer_cases import angle_observers, make, wrapped

from estimator_pkg.sensor.sample_time import SampleTime, begin_sample_time, sample_time

START = 1_700_000_000_000_000_000
QUANTUM = 2.0 * math.pi / 4096.0


def motion(t):
    """Position [rad] and velocity [rad/s]: 6 rad/s and a swing of 2.4 rad/s."""
    return 6.0 * t + 0.3 * np.sin(8.0 * t), 6.0 + 2.4 * np.cos(8.0 * t)


def estimates(name, t, stamped):
    """(velocity - true one at the reading, the output, the joint) after a second."""
    position, velocity = motion(t)
    joint = make(name, {'quantum': QUANTUM})
    reading = wrapped(np.floor(position / QUANTUM) * QUANTUM)
    out = joint.run(START + np.rint(stamped * 1e9).astype(np.int64), reading)
    used = (t > 1.0) & (out.verdict == 0)
    return (out.velocity - velocity)[used], velocity[used], joint


def times_of(passed, speed=6.0):
    """Times that are taken [s] for these, between the stamps, and the state of the clock."""
    clock = SampleTime()
    begin_sample_time(clock)
    return np.array([sample_time(clock, dt, speed * dt) for dt in passed]), clock


@pytest.mark.parametrize('tick', [1e-3, 1e-2])
@pytest.mark.parametrize('part', [1.03, 1.09, 1.17, 1.25])
def test_a_clock_that_counts_is_as_good_as_a_fine_one(tick, part):
    """The speed by such stamps is up to 25 % wrong from sample to sample."""
    t = np.arange(6000) * part * tick
    coarse = np.floor(t / tick) * tick
    error, velocity, joint = estimates('kalman', t, coarse)
    best, _, _ = estimates('kalman', t, t)
    assert abs(np.sum(error * velocity) / np.sum(velocity**2)) < 0.02
    assert np.sqrt(np.mean(error**2)) < 3.0 * np.sqrt(np.mean(best**2)) + 0.01
    assert 'stamps are off' in joint.why()


@pytest.mark.parametrize('name', angle_observers())
def test_stamps_of_receipt_cost_little(name):
    random = np.random.default_rng(4)
    t = np.arange(5000) / 500.0
    stamped = t + np.minimum(random.exponential(0.3e-3, len(t)), 1.5e-3)
    error, _, _ = estimates(name, t, stamped)
    best, _, _ = estimates(name, t, t)
    assert np.sqrt(np.mean(error**2)) < 3.0 * np.sqrt(np.mean(best**2)) + 0.02


@pytest.mark.parametrize('name', angle_observers())
def test_uneven_samples_with_true_stamps_stay_as_they_are(name):
    random = np.random.default_rng(5)
    t = np.cumsum(random.uniform(1e-3, 3e-3, 4000))
    _, _, joint = estimates(name, t, t)
    clock = joint.view.track.sample_time
    assert not clock.even and abs(clock.late) < 1e-6
    assert 'stamps' not in joint.why()


def test_even_times_are_taken_as_they_are():
    passed = np.full(1000, 2e-3)
    taken, clock = times_of(passed)
    assert np.array_equal(taken, passed) and clock.late == 0.0


@pytest.mark.parametrize('seed', range(3))
def test_times_add_up_to_the_stamps(seed):
    random = np.random.default_rng(seed)
    t = np.arange(3001) * 1.1e-3
    stamped = np.floor(t / 1e-3) * 1e-3 + (random.random(len(t)) < 0.01) * 2e-3
    stamped[1500:] += 0.5e-3  # the sensor pauses
    for k in range(1, len(t)):  # the guard lets no others pass
        stamped[k] = max(stamped[k], stamped[k - 1] + 1e-5)
    taken, clock = times_of(np.diff(stamped))
    assert np.min(taken) > 0.0
    assert np.sum(taken) == pytest.approx(stamped[-1] - stamped[0] - clock.late, abs=1e-9)
    apart = np.cumsum(taken) - (stamped[1:] - stamped[0])
    assert np.max(np.abs(apart[128:] - apart[:-128])) < 2.0 * 1.1e-3


@pytest.mark.parametrize('periods', [(5e-3, 1e-3), (1e-3, 5e-3)])
def test_another_period_is_learnt(periods):
    random = np.random.default_rng(6)
    passed = np.repeat(periods, 600)
    late = np.append(0.0, random.uniform(0.0, 2e-4, len(passed)))
    _, clock = times_of(passed + np.diff(late))
    assert clock.period == pytest.approx(periods[1], rel=0.02)


def test_what_was_taken_too_much_is_given_back():
    """A clock of whole milliseconds, and then true stamps of uneven samples."""
    random = np.random.default_rng(7)
    even = np.arange(1500) * 1.17e-3
    t = np.append(even, even[-1] + np.cumsum(random.uniform(0.8e-3, 2.4e-3, 1500)))
    stamped = np.append(np.floor(even / 1e-3) * 1e-3, t[1500:])
    position, _ = motion(t)
    clock, late = SampleTime(), []
    begin_sample_time(clock)
    for passed, change in zip(np.diff(stamped), np.diff(position)):
        sample_time(clock, passed, change)
        late.append(abs(clock.late))
    assert max(late[200:1400]) > 0.2e-3 and max(late[-500:]) < 1e-6
