# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A joint that another sensor informs: errors and intervals, and what is withheld."""

import numpy as np
import pytest

from estimator_pkg import observers
from estimator_pkg.driver import joint as driver
from estimator_pkg.driver.configuration import JointSettings, SourceSettings
from estimator_pkg.driver.fused import FusedJoint
from estimator_pkg.parameters import build

QUANTUM, BEGIN, BIAS = 2.0 * np.pi / 4096, 10**18, 0.03
ORDERS = {  # (stamps after those of the angle, arrival after the stamp), both of a sample time
    'before its angle': lambda dt: (0.0, -1e-4),
    'after its angle': lambda dt: (0.0, 1e-4),
    'half a sample off': lambda dt: (0.5 * dt, 1e-5),
    'late': lambda dt: (0.0, 1.5 * dt),
}


def sine(time, hz=0.7):
    swing = 2.0 * np.pi * hz
    return 5.0 / swing * np.sin(swing * time), 5.0 * np.cos(swing * time)


def at_rest(time):
    return 0.4 + 0.0 * time, 0.0 * time


def gyro(rate, order, motion=sine, seconds=8.0, noise=0.003, every=1, dropped=0.0):
    """Stamps, times of arrival and values."""
    rng, (off, later) = np.random.default_rng(0), ORDERS[order](1.0 / rate)
    time = np.arange(0, round(seconds * rate), every) / rate + off
    values = motion(time)[1] - BIAS + noise * rng.standard_normal(len(time))
    kept = rng.random(len(time)) >= dropped
    return time[kept], time[kept] + later, values[kept]


class Run:
    """A joint with a source.

    Attributes
    ----------
    rows : speed and its deviation, and speed from the angle alone, shape (3, n).
    notices : (time, text).
    """

    def __init__(self, rate, messages, motion=sine, jitter=0.0, observer='edge_adaptive', **source):
        found = observers.find(observer)
        gains = {'quantum': QUANTUM} if observer == 'edge_adaptive' else {}
        settings = [(0, 'gyro', SourceSettings(**source))]
        joint = FusedJoint(found, build(found.gains, gains), build(JointSettings, {}), settings)
        self.source, rows, self.notices, at = joint.sources[0], [], [], 0
        stamps, arrivals, values = messages
        self.time = np.arange(round(arrivals[-1] * rate)) / rate
        self.speed = motion(self.time)[1]
        read_at = self.time + jitter * np.random.default_rng(1).standard_normal(len(self.time))
        readings = np.floor(motion(read_at)[0] / QUANTUM + 0.3) * QUANTUM
        readings = (readings + np.pi) % (2.0 * np.pi) - np.pi
        for now, reading in zip(self.time, readings):
            while at < len(stamps) and arrivals[at] <= now:
                joint.receive(0, BEGIN + round(stamps[at] * 1e9), float(values[at]))
                at += 1
            joint.update(BEGIN + round(now * 1e9), float(reading))
            rows.append((joint.estimate()[1], joint.stddev()[1], joint.alone.estimate()[1]))
            self.notices += [(now, text) for text in self.source.notices]
            self.source.notices.clear()
        self.rows = np.array(rows).T

    def error(self, begin=2.0, end=np.inf):
        """Return the rms error of the speed over that from the angle alone."""
        rows = (self.time >= begin) & (self.time < end)
        informed, alone = (np.sqrt(np.mean((self.rows[k] - self.speed)[rows] ** 2)) for k in (0, 2))
        return informed / alone

    def covered(self):
        """Return the part of the samples whose 95 % interval has the true speed."""
        inside = np.abs(self.rows[0] - self.speed) <= 1.96 * self.rows[1]
        return np.mean(inside[self.time >= 2.0])


@pytest.mark.parametrize('order', ORDERS)
@pytest.mark.parametrize('rate', [250, 1000])
def test_neither_error_nor_interval_depends_on_the_order_of_arrival(rate, order):
    run = Run(rate, gyro(rate, order))
    assert run.error() <= 0.35 and 0.9 <= run.covered() <= 0.98
    assert run.source.text().startswith('used, informs in 100 of 100 samples, bias 0.0')
    assert abs(run.source.filter.z[1] - BIAS) < 1e-3 and not run.notices


@pytest.mark.parametrize(
    ('values', 'run', 'bound'),
    [
        ({'every': 4}, {}, 0.3),
        ({'dropped': 0.3}, {}, 0.25),
        ({'noise': 0.02}, {}, 0.75),
        ({'noise': 0.3}, {}, 1.02),
        ({}, {'jitter': 4e-4}, 0.1),
        ({}, {'observer': 'finite_difference'}, 0.1),
    ],
    ids=['quarter rate', 'lost values', 'noisy', 'very noisy', 'jitter', 'another observer'],
)
def test_a_source_is_worth_its_noise(values, run, bound):
    run = Run(250, gyro(250, 'before its angle', **values), **run)
    assert run.error() <= bound and not run.notices
    assert 0.9 <= run.covered() <= 0.98


def test_a_joint_at_rest_is_not_moved_by_the_noise_of_its_gyro():
    run = Run(250, gyro(250, 'late', at_rest), at_rest)
    assert np.all(np.abs(run.rows[0][500:]) < 1e-4) and not run.notices
    assert run.source.text().startswith('used, informs in 0 of 100 samples')


def test_equal_stamps_and_values_that_are_no_numbers_change_nothing():
    time, arrival, values = gyro(250, 'before its angle')
    twice = np.repeat(time, 2), np.repeat(arrival, 2), np.repeat(values, 2)
    twice[2][1::2] = np.where(np.arange(len(time)) % 2, 99.0, np.nan)
    np.testing.assert_array_equal(Run(250, twice).rows, Run(250, (time, arrival, values)).rows)


def test_plain_and_compiled_are_equal(monkeypatch):
    rows = []
    for _ in range(2):
        rows.append(Run(250, gyro(250, 'late', seconds=2.0)).rows)
        monkeypatch.setattr(driver, 'functions_of', lambda module: None)
    np.testing.assert_array_equal(*rows)


def test_ratio_and_delay_are_those_that_are_set():
    time, arrival, values = gyro(250, 'before its angle')
    late = time + 0.006, arrival + 0.006, np.degrees(-values)
    run = Run(250, late, ratio=-np.pi / 180.0, delay=0.006)
    assert run.error() < 0.4 and abs(run.source.filter.z[1] - BIAS) < 1e-3 and not run.notices


def test_a_second_encoder_informs_by_its_speed():
    time, arrival, _ = gyro(250, 'before its angle')
    turned = np.floor(20.0 * sine(time)[0] / QUANTUM) * QUANTUM
    turned = (turned + np.pi) % (2.0 * np.pi) - np.pi
    run = Run(250, (time, arrival, turned), kind='angle', ratio=0.05)
    assert run.error() < 0.5 and not run.notices


FAULTS = {  # of values from a time on, and what the terminal shows of them
    'reversed': (lambda t, w: -w, 'its sign is reversed'),
    'deg/s': (lambda t, w: np.degrees(w), 'its ratio is about 0.017'),
    'another joint': (lambda t, w: np.cos(7.0 * t), 'it contradicts the angle'),
    'late by 20 ms': (lambda t, w: np.interp(t - 0.02, t, w), 'it contradicts the angle'),
    'dead': (lambda t, w: 0.0 * w, 'it contradicts the angle'),
    'saturated': (lambda t, w: np.clip(w, -3.0, 3.0), 'it contradicts the angle'),
}


@pytest.mark.parametrize('order', ['before its angle', 'late'])
@pytest.mark.parametrize('begin', [0.0, 3.0])
@pytest.mark.parametrize('fault', FAULTS)
def test_a_source_that_contradicts_is_withheld_and_named(fault, begin, order):
    wrong, said = FAULTS[fault]
    time, arrival, values = gyro(250, order)
    rows = (time >= begin) & (time < 6.0)
    values[rows] = wrong(time, values)[rows]
    run = Run(250, (time, arrival, values))
    named, (again, good) = run.notices[0], run.notices[-1]
    assert begin < named[0] <= begin + 1.0 and f'gyro is withheld: {said}' in named[1]
    assert run.error(1.0) <= 1.02
    assert 6.0 < again <= 7.6 and good == 'gyro agrees again and is used'
    assert run.source.used


def test_another_bias_is_a_contradiction_until_it_is_learnt():
    time, arrival, values = gyro(250, 'before its angle')
    run = Run(250, (time, arrival, values + 0.3 * (time > 3.0)))
    (begin, named), (end, again) = run.notices
    assert begin < 3.6 and 'withheld: it contradicts the angle' in named
    assert end < 4.6 and 'agrees again' in again and run.error(1.0) < 0.6
    assert abs(run.source.filter.z[1] - BIAS + 0.3) < 1e-3


def test_a_silent_source_is_named_and_used_again():
    time, arrival, values = gyro(250, 'before its angle')
    there = (time < 3.0) | (time > 4.0)
    run = Run(250, (time[there], arrival[there], values[there]))
    silent, again = (text for _, text in run.notices)
    assert silent == (
        'gyro is silent: no value on gyro for 0.5 s; check topic, field and publisher'
    )
    assert again == 'gyro agrees again and is used'
    assert run.error(3.1, 4.0) <= 1.05 and run.error(4.6) <= 0.2


@pytest.mark.parametrize('shift', [-100.0, 100.0])
def test_a_source_whose_clock_differs_is_named(shift):
    time, arrival, values = gyro(250, 'before its angle', seconds=4.0)
    run = Run(250, (time + shift, arrival, values))
    ((when, text),) = run.notices
    assert when < 2.1 and f'its newest stamp is {shift:+.1f} s' in text
