# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A joint that other sensors inform: the errors, what is learnt, what is withheld."""

import itertools

import numpy as np
import pytest

from estimator_pkg import observers
from estimator_pkg.driver import joint as driver
from estimator_pkg.driver.configuration import JointSettings, SourceSettings
from estimator_pkg.driver.fused import FusedJoint
from estimator_pkg.parameters import build

QUANTUM = 2.0 * np.pi / 4096
BEGIN = 10**18


class Run:
    """One joint at 1 kHz, and a source of it at its own rate."""

    def __init__(self, angle, speed, seconds=10.0, rate=1000, phase=0.3):
        self.time = np.arange(round(seconds * rate)) / rate
        turned = np.floor(angle(self.time) / QUANTUM + phase) * QUANTUM
        self.readings = (turned + np.pi) % (2.0 * np.pi) - np.pi
        self.speed, self._of = speed(self.time), speed

    def gyro(self, noise, rate=1000, bias=0.03, ratio=1.0, delay=0.0, seed=0):
        time = np.arange(round(self.time[-1] * rate)) / rate
        noises = noise * np.random.default_rng(seed).standard_normal(len(time))
        return time, (self._of(time - delay) - bias) / ratio + noises

    def __call__(self, time, values, observer='edge_adaptive', arrival=None, **source):
        """Return (informed joint, estimates by row: speed, deviation, alone, used), and notices."""
        found = observers.find(observer)
        gains, settings = build(found.gains, {'quantum': QUANTUM}), build(JointSettings, {})
        joint = FusedJoint(found, gains, settings, [(0, 'gyro', SourceSettings(**source))])
        sensor, rows, notices, at = joint.sensors[0], [], [], 0
        arrival = time if arrival is None else arrival
        for now, reading in zip(self.time, self.readings):
            while at < len(time) and arrival[at] <= now:
                joint.receive(0, BEGIN + round(time[at] * 1e9), float(values[at]))
                at += 1
            joint.update(BEGIN + round(now * 1e9), float(reading))
            alone = joint.alone.estimate()[1]
            rows.append((joint.estimate()[1], joint.stddev()[1], alone, sensor.used))
            notices += [(now, notice) for notice in sensor.notices]
            sensor.notices.clear()
        self.rows = np.array(rows).T
        return sensor, notices

    def error(self, start=2.0, end=np.inf):
        """Return the rms error of the informed speed over that from the angle alone."""
        chosen = (self.time >= start) & (self.time < end)
        return rms((self.rows[0] - self.speed)[chosen]) / rms((self.rows[2] - self.speed)[chosen])


def rms(values):
    return float(np.sqrt(np.nanmean(values**2)))


def sine(seconds=10.0, **kwargs):
    swing = 4.0 * np.pi
    return Run(
        lambda t: 5.0 / swing * np.sin(swing * t),
        lambda t: 5.0 * np.cos(swing * t),
        seconds,
        **kwargs,
    )


@pytest.mark.long
@pytest.mark.parametrize(('noise', 'bound'), [(0.005, 0.15), (0.02, 0.45), (0.3, 1.02)])
def test_a_gyro_is_worth_its_noise(noise, bound):
    run = sine()
    sensor, _ = run(*run.gyro(noise))
    assert run.error() <= bound
    assert sensor.text().startswith('used' if noise < 0.1 else 'not used: standard deviation 0.')
    covered = np.abs(run.rows[0] - run.speed)[2000:] < 1.96 * run.rows[1][2000:]
    assert 0.9 < covered.mean() <= 1.0


def test_values_that_arrive_late_do_not_take_back_what_earlier_ones_gave():
    run = sine(6.0)
    time, values = run.gyro(0.005)
    late = np.where(np.arange(len(time)) % 10 < 5, 0.005, 0.0)  # half of them
    sensor, notices = run(time, values, arrival=np.maximum.accumulate(time + late))
    assert sensor.used and not notices and run.error() <= 0.55


def test_a_kalman_filter_is_informed_as_well():
    run = sine()
    run(*run.gyro(0.005), 'kalman')
    assert run.error() < 0.5


def test_plain_and_compiled_are_equal(monkeypatch):
    speeds = []
    for _ in range(2):
        run = sine(3.0)
        run(*run.gyro(0.005))
        speeds.append(run.rows)
        monkeypatch.setattr(driver, 'functions_of', lambda module: None)
    assert run.rows[3].any()
    np.testing.assert_array_equal(*speeds)


@pytest.mark.parametrize('rate', [100, 1000])
def test_bias_ratio_and_delay_are_learnt_with_deviations(rate):
    run = sine()
    sensor, _ = run(*run.gyro(0.005, rate, bias=0.05, ratio=-0.25, delay=0.004))
    learnt = sensor.learnt()
    for name, true in (('bias', 0.05), ('ratio', -0.25), ('delay', 0.004)):
        value, sigma, _ = learnt[name]
        assert abs(value - true) < 4.0 * sigma + 0.02 * abs(true), (name, learnt)
        assert sigma < 0.1 * abs(true)


def test_ratio_and_delay_that_are_set_are_kept():
    run = sine(5.0)
    sensor, _ = run(*run.gyro(0.005, delay=0.002), ratio=1.0, delay=0.002)
    assert set(sensor.learnt()) == {'bias'}
    assert run.error() <= 0.3  # a value is moved on by 2 ms, with the acceleration from the angle


FAULTS = {
    'dead': lambda t, g: 0.0 * g,
    'stuck': lambda t, g: np.full_like(g, g[0]),
    'biased': lambda t, g: g + 0.5,
    'reversed': lambda t, g: -g,
    'late': lambda t, g: np.interp(t - 0.02, t, g),
    'wrong joint': lambda t, g: np.cos(7.0 * t),
    'saturated': lambda t, g: np.clip(g, -3.0, 3.0),
    'glitches': lambda t, g: g + 50.0 * (np.arange(len(g)) % 500 == 250),
}


QUICK = {('reversed', 0.0), ('late', 0.0), ('glitches', 0.0)}  # nodes/test_sources.py has the rest


@pytest.mark.long
@pytest.mark.parametrize(
    'fault, ratio',
    [
        pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow)
        for case in itertools.product(FAULTS, (0.0, 1.0))
    ],
)
def test_a_source_that_contradicts_is_withheld_and_taken_again(fault, ratio):
    run = sine(16.0)
    time, values = run.gyro(0.02)
    wrong = (time >= 5.0) & (time < 7.0)
    values[wrong] = FAULTS[fault](time[wrong], values[wrong])
    sensor, notices = run(time, values, ratio=ratio)
    if fault != 'glitches':  # which are single values
        assert notices and 5.0 <= notices[0][0] <= 6.0 and 'withheld: it measures' in notices[0][1]
        assert 'agrees again' in notices[1][1]
    assert run.error(1.0) <= 1.05
    assert sensor.used and run.rows[3][-1000:].all()


def test_a_silent_source_is_named_and_used_again_at_once():
    run = sine(6.0)
    time, values = run.gyro(0.005)
    there = (time < 3.0) | (time > 4.0)
    sensor, notices = run(time[there], values[there])
    silent, again = (text for _, text in notices)
    assert silent == 'gyro is silent for 0.5 s and is not used: check its publisher'
    assert again == 'gyro agrees again and is used'
    assert sensor.used and run.error(3.0, 4.0) <= 1.05 and run.error(4.1) <= 0.2


@pytest.mark.parametrize('phase', [0.3, pytest.param(0.8, marks=pytest.mark.slow)])
@pytest.mark.parametrize(('backlash', 'bound'), [(0.0, 1.03), (0.1, 1.0), (0.5, 0.9), (2.0, 0.7)])
def test_an_encoder_behind_backlash_is_not_worse_than_the_better_one(backlash, bound, phase):
    time = np.arange(80_000) / 10_000
    motor, link = 0.5 * np.sin(3.0 * time), np.empty_like(time)
    half, at = 0.5 * np.deg2rad(backlash), 0.0
    for k, angle in enumerate(motor):
        at = min(max(at, angle - half), angle + half)
        link[k] = at
    speed = np.gradient(link, time)
    run = Run(
        lambda t: np.interp(t, time, link), lambda t: np.interp(t, time, speed), 8.0, phase=phase
    )
    turned = np.floor(100.0 * motor[::10] / QUANTUM) * QUANTUM
    turned = (turned + np.pi) % (2.0 * np.pi) - np.pi
    run(run.time, turned, kind='angle', ratio=0.01, delay=0.0)
    found = observers.find('edge_adaptive')
    joint = driver.Joint(found, build(found.gains, {'quantum': QUANTUM}), build(JointSettings, {}))
    of_motor = 0.01 * joint.run(BEGIN + np.round(run.time * 1e9).astype(np.int64), turned).velocity
    fused, alone, of_motor = (
        rms((speeds - run.speed)[2000:]) for speeds in (run.rows[0], run.rows[2], of_motor)
    )
    assert fused <= bound * min(alone, of_motor)


def accelerated(noise=1.0, wrong=lambda time: 0.0):
    run, swing = sine(12.0), 4.0 * np.pi
    noises = noise * np.random.default_rng(2).standard_normal(len(run.time))
    told = -5.0 * swing * np.sin(swing * run.time) + noises + wrong(run.time)
    return run, run(run.time, told, kind='acceleration', ratio=1.0, delay=0.0)


def test_an_acceleration_helps():
    run, (sensor, notices) = accelerated()
    assert run.error() < 0.8 and sensor.used and not notices


def test_a_wrong_acceleration_is_withheld():
    run, (_, notices) = accelerated(wrong=lambda time: np.where(time > 6.0, 200.0, 0.0))
    assert 6.0 < notices[0][0] < 7.0 and run.error() <= 1.05
