# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The scale of the standard deviation: right, always learnt, and no part of the estimate."""

import math

import numpy as np
import pytest
from observer_cases import make, plain, stamps, wrapped

from benchmarks.signals import Samples, encoder
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import TRACKING, Deviation
from estimator_pkg.observers.angle.hybrid.observer import HybridAngle
from estimator_pkg.sensor.calibration import (
    BROKEN,
    LARGEST_MEAN_SQUARE,
    LEAST_MEAN_SQUARE,
    averaged_square,
)

DT = 1e-3
TURN = 2.0 * math.pi
QUANTUM = TURN / 4096.0


def moving(motion, count=6000, noise=1e-3, seed=1):
    time = np.arange(count) * DT
    position, velocity = motion(time)
    noisy = position + np.random.default_rng(seed).normal(0.0, noise, count)
    return Samples(stamps(count, DT), wrapped(noisy), velocity)


def fast_sine(time):
    w = 10.0 * math.pi
    return 0.2 * np.sin(w * time), 0.2 * w * np.cos(w * time)


def constant(time):
    return 3.0 * time, np.full(len(time), 3.0)


def uncalibrated(joint, samples):
    """The estimates with the standard deviation as the observer makes it."""
    alone = Joint(joint.observer, joint.gains, joint.settings)
    with alone._changing() as channel:
        calibration = channel.track.calibration  # noise that is unknown hides every error
        calibration.fourths = calibration.seconds = math.nan
    return alone.run(samples.stamps, samples.angle)


def covered(out, sigma, velocity):
    told = out.status == TRACKING
    return np.mean(np.abs(out.velocity - velocity)[told] < 1.96 * sigma[told])


@pytest.mark.parametrize('name', ['hybrid_angle', 'kalman', 'edge_adaptive'])
def test_the_estimate_does_not_change_and_the_interval_only_grows(name):
    samples = moving(fast_sine)
    joint = make(name, {})
    out = joint.run(samples.stamps, samples.angle)
    alone = uncalibrated(joint, samples)
    for with_it, without in zip(out, alone):
        if without is not alone.velocity_stddev:
            assert np.array_equal(with_it, without, equal_nan=True)
    assert np.all(out.velocity_stddev >= alone.velocity_stddev)


@pytest.mark.parametrize('name, least', [('hybrid_angle', 0.9), ('kalman', 0.8), ('pll', 0.9)])
def test_a_lag_that_sigma_does_not_contain_is_learnt(name, least):
    samples = moving(fast_sine)
    joint = make(name, {})
    out = joint.run(samples.stamps, samples.angle)
    alone = uncalibrated(joint, samples)
    assert covered(alone, alone.velocity_stddev, samples.velocity) < 0.5
    assert covered(out, out.velocity_stddev, samples.velocity) > least


@pytest.mark.parametrize('name', ['hybrid_angle', 'kalman', 'finite_difference'])
def test_a_sigma_that_is_right_stays(name):
    samples = moving(constant, 8000)
    joint = make(name, {})
    out = joint.run(samples.stamps, samples.angle)
    alone = uncalibrated(joint, samples)
    assert np.mean(out.velocity_stddev[2000:] / alone.velocity_stddev[2000:]) < 1.05


def test_readings_without_noise_that_turn_half_a_turn_between_instants():
    """200 rad/s passes half a turn in 16 ms: the change is taken next to the published speed."""
    time = np.arange(3000) * DT
    read = wrapped(np.floor(200.3 * time / (TURN / 4096)) * (TURN / 4096))
    joint = make('edge_adaptive', {'quantum': TURN / 4096})
    samples = Samples(stamps(3000, DT), read, np.full(3000, 200.3))
    out = joint.run(samples.stamps, read)
    alone = uncalibrated(joint, samples)
    assert np.max(out.velocity_stddev[500:] / alone.velocity_stddev[500:]) < 1.2


def test_it_is_learnt_whether_or_not_anyone_reads_it():
    samples = moving(fast_sine, 3000)
    read, unread = make('hybrid_angle', {}), make('hybrid_angle', {})
    for stamp, angle in zip(samples.stamps.tolist(), samples.angle.tolist()):
        read.update(stamp, angle)
        read.estimate()
        read.stddev()
        unread.update(stamp, angle)
    batch = make('hybrid_angle', {})
    out = batch.run(samples.stamps, samples.angle)
    assert read.stddev() == unread.stddev() == batch.stddev()
    assert out.velocity_stddev[-1] == unread.stddev()[1]
    module, track, alone = unread.module, unread.channel.track, Deviation()
    module.deviation(module, alone, track.state, track.coefficients, unread.design, 1.0)
    assert unread.stddev()[1] > 2.0 * alone.velocity


@pytest.mark.parametrize('ahead', [0.3, -1.0, 10.0])
def test_instants_before_a_gap_or_a_jump_of_the_clock_are_void(ahead):
    samples = moving(constant, 500)
    joint = make('hybrid_angle', {})
    joint.run(samples.stamps, samples.angle)
    assert joint.channel.track.calibration.due_ns > samples.stamps[-1]
    joint.update(int(samples.stamps[-1]) + round(ahead * 1e9), 0.1)
    assert joint.channel.track.calibration.due_ns == BROKEN


@pytest.mark.parametrize('error', [math.nan, math.inf, 1e200])
def test_errors_that_are_no_numbers_do_no_harm(error):
    mean = 1.0
    for noise in (0.0, 1.0, math.inf, 1e300):
        mean = averaged_square(mean, error, noise)
        assert LEAST_MEAN_SQUARE <= mean <= LARGEST_MEAN_SQUARE


def test_instants_far_apart_give_no_derivative():
    """Messages in bursts: four samples 2 ms apart, then none for 0.1 s."""
    random = np.random.default_rng(6)
    at = np.cumsum(np.tile([0.1, 2e-3, 2e-3, 2e-3], 300))
    read = wrapped(3.0 * at + 0.5 * np.sin(2.0 * at) + random.normal(0.0, 1e-3, len(at)))
    joint = make('kalman', {})
    samples = Samples(10**9 + np.rint(at * 1e9).astype(np.int64), read, np.zeros(len(at)))
    out = joint.run(samples.stamps, read)
    alone = uncalibrated(joint, samples)
    assert np.mean(out.velocity_stddev[200:] / alone.velocity_stddev[200:]) < 1.2


def test_measurements_that_are_not_one_angle_are_not_calibrated():
    joint, samples = plain('hybrid_angle'), moving(fast_sine, 2000)
    joint.module = type('Own', (HybridAngle,), {'SINGLE_ANGLE': False})
    joint.run(samples.stamps, samples.angle)
    assert joint.used == 2000 and joint.channel.track.calibration.scale == 1.0


def bursts(time):
    """0.3 rad/s, and for half of a second in two 3 rad/s at 6 Hz."""
    within = time % 2.0
    return 0.3 + np.where(within < 0.5, 3.0 * np.sin(6.0 * TURN * within), 0.0)


def steady(time):
    return np.full(len(time), 3.0)


@pytest.mark.parametrize('speed, gaps, least', [(bursts, 0.0, 0.86), (steady, 0.25, 0.9)])
def test_bursts_and_gaps_are_covered(speed, gaps, least):
    time = np.arange(1, 12_001) * DT
    time = time[(time - 2.3) % 1.7 >= gaps]
    fine = np.arange(0.0, 12.1, 1e-4)
    angle = np.interp(time, fine, np.cumsum(speed(fine)) * 1e-4) + 1.0
    read = encoder(angle, 4096)
    samples = Samples(10**9 + np.rint(time * 1e9).astype(np.int64), read, speed(time))
    joint = make('hybrid_angle', {})
    out = joint.run(samples.stamps, samples.angle)
    alone = uncalibrated(joint, samples)
    assert covered(out, out.velocity_stddev, samples.velocity) > least
    assert covered(alone, alone.velocity_stddev, samples.velocity) < least - 0.05
