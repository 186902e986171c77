# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The fixed-lag smoother: errors on wide classes of streams, from both sides."""

import math
from collections import deque

import numpy as np
import pytest
from observer_cases import make

from benchmarks.signals import FURTHER, SIGNALS, Signal, encoder, sine, trapezoid
from estimator_pkg.evaluation.reference.smoother.smoother import smooth
from estimator_pkg.observers.angle.smoother import Smoother

TURN = 2.0 * math.pi
BY_NAME = {signal.name: signal for signal in SIGNALS + FURTHER}


def smoothed(stamps, readings, lag=0.05, period=TURN, fresh=(), **options):
    """(position, velocity, standard deviations) of each reading whose turn comes; shape (n, 4)."""
    smoother, waiting, results = Smoother(lag, period, **options), deque(), []
    stamps, readings = np.asarray(stamps).tolist(), np.asarray(readings).tolist()
    for k, (stamp, reading) in enumerate(zip(stamps, readings)):
        smoother.add(stamp, reading, reading, k == 0 or k in fresh)
        waiting.append(stamp)
        while stamp - waiting[0] >= round(1e9 * lag):
            waiting.popleft()
            results.append(smoother.result())
    return np.array(results)


def errors(samples, skipped=1.0, **options):
    """Velocity errors after `skipped` [s], and which of them the 95 % interval covers."""
    found = smoothed(samples.stamps, samples.angle, **options)
    off = found[:, 1] - samples.velocity[: len(found)]
    later = samples.stamps[: len(found)] - samples.stamps[0] > 1e9 * skipped
    return off[later], np.abs(off[later]) < 1.96 * found[later, 3]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.long
@pytest.mark.parametrize('name, least, most', [('sine', 1.1, 2.0), ('trapezoid', 0.9, 1.5)])
def test_nearly_as_accurate_as_the_off_line_smoother(name, least, most):
    samples = BY_NAME[name].samples(duration=5.0)
    off_line = smooth(samples.stamps, samples.angle, TURN).velocity - samples.velocity
    assert least < rms(errors(samples)[0]) / rms(off_line[1000:]) < most


# rms [rad/s] and how much the 95 % interval covers: bounds from both sides
CASES = {
    'slow': (2e-6, 2e-4, 0.9, 1.0),
    'sine': (4e-3, 0.0115, 0.93, 0.998),
    'trapezoid': (0.01, 0.035, 0.93, 0.998),
    'fast': (1e-6, 2e-4, 0.9, 1.0),
    'jitter': (4e-3, 0.0115, 0.93, 0.998),
    'drops': (4e-3, 0.0125, 0.93, 0.998),
    'creep': (1e-6, 5e-3, 0.9, 1.0),
    'reversal': (6e-4, 3e-3, 0.8, 0.99),
    '256': (1e-5, 4e-3, 0.9, 1.0),
    'steps': (0.02, 0.06, 0.93, 0.998),
    'noise': (8e-3, 0.03, 0.88, 0.99),
    'beat': (1e-5, 2e-3, 0.85, 1.0),
    '100 Hz': (8e-3, 0.03, 0.9, 1.0),
    '10 kHz': (8e-4, 4e-3, 0.9, 1.0),
}


@pytest.mark.parametrize('name', CASES)
@pytest.mark.long
def test_the_shared_signals(name):
    least, most, low, high = CASES[name]
    off, covered = errors(BY_NAME[name].samples(duration=3.0 if name == '10 kHz' else 5.0))
    assert least < rms(off) < most
    assert low <= np.mean(covered) <= high


@pytest.mark.parametrize(
    'lag, least, most', [(0.005, 0.02, 0.06), (0.02, 5e-3, 0.02), (0.2, 3e-3, 0.01)]
)
def test_a_longer_lag_is_more_accurate(lag, least, most):
    off, _ = errors(BY_NAME['sine'].samples(duration=4.0), lag=lag)
    assert least < rms(off) < most


@pytest.mark.parametrize('rate', [2.0, 5.0, 10.0, 20.0, 30.0, 50.0])
@pytest.mark.parametrize('counts', [4096, 2**40])
def test_rates_of_which_the_lag_is_a_period_or_two(rate, counts):
    samples = Signal('', '', sine(2.0, 0.2), rate=rate, counts=counts).samples(duration=40.0)
    off, covered = errors(samples, skipped=6.0)
    assert np.isfinite(off).all()
    assert rms(off) < (0.2 if rate < 5.0 else 0.02)  # the angle changes by 6 rad in a second
    assert np.mean(covered) > 0.8


def test_less_error_than_the_causal_observer_at_every_noise():
    for noise in (1e-5, 1e-3, 1e-2):
        signal = Signal('', '', sine(5.0, 2.0), counts=2**40, noise=noise)
        samples = signal.samples(duration=4.0)
        off, _ = errors(samples)
        causal = make('edge_adaptive').run(samples.stamps, samples.angle).velocity
        ratio = rms(off) / rms((causal - samples.velocity)[1000 : 1000 + len(off)])
        assert 0.05 < ratio < 0.35


def test_stray_readings_do_no_harm():
    samples = BY_NAME['sine'].samples(duration=4.0)
    angle = samples.angle.copy()
    angle[1500::170] += 0.5
    clean, _ = errors(samples)
    off, _ = errors(samples._replace(angle=angle))
    assert np.max(np.abs(off)) < 3.0 * np.max(np.abs(clean))
    assert rms(off) < 1.3 * rms(clean)


def test_a_gap_is_not_bridged_and_both_of_its_ends_are_good():
    samples = BY_NAME['sine'].samples(duration=6.0)
    kept = np.ones(len(samples.stamps), bool)
    kept[2500:3000] = kept[4100:4900] = False
    stamps, angle, velocity = (each[kept] for each in samples)
    fresh = set((np.flatnonzero(np.diff(stamps) > 200_000_000) + 1).tolist())
    found = smoothed(stamps, angle, fresh=fresh)
    off = np.abs(found[:, 1] - velocity[: len(found)])
    for begin in fresh:
        ends = off[begin - 5 : begin + 5]
        assert np.isfinite(ends).all() and np.max(ends) < 1.0
        assert np.max(off[begin + 20 : begin + 200]) < 0.05


def test_a_clock_that_jumps_back_begins_anew():
    samples = BY_NAME['trapezoid'].samples(duration=3.0)
    stamps = np.concatenate([samples.stamps, samples.stamps])
    angle, velocity = np.tile(samples.angle, 2), np.tile(samples.velocity, 2)
    smoother, results = Smoother(0.05, TURN), []
    for k, (stamp, reading) in enumerate(zip(stamps.tolist(), angle.tolist())):
        smoother.add(stamp, reading, reading, k in (0, 3000))
        if k >= 50:
            results.append(smoother.result()[1])
    off = np.array(results) - velocity[: len(results)]
    assert rms(off[1000:2900]) < 0.05 and rms(off[3000:]) < 0.05


def test_a_start_with_single_readings_has_no_result():
    times = np.array([1, 2, 3, 4]) * 1_000_000_000
    found = smoothed(times, [0.1, 0.2, 0.3, 0.4], fresh={1, 2, 3})
    assert np.isnan(found).all()
    assert len(found) == 3


def test_rest_is_rest_and_the_interval_says_so():
    stamps = 1_000_000_000 + np.arange(3000) * 1_000_000
    still = smoothed(stamps, np.full(3000, 0.7))
    assert np.max(np.abs(still[100:, 1])) < 1e-6
    moved = np.where(np.arange(3000) < 10, 0.7, 0.7 + TURN / 4096)  # one count, then rest
    found = smoothed(stamps, moved)[500:]
    assert np.all(np.abs(found[:, 1]) < 1.96 * found[:, 3])
    assert np.all(np.abs(found[:, 0] - moved[500]) < TURN / 4096)


@pytest.mark.parametrize('shift, unwrap', [(0.0, False), (math.pi, False), (0.0, True)])
def test_the_position_keeps_the_convention(shift, unwrap):
    time = np.arange(4000) * 1e-3
    position, _ = trapezoid(20.0, 100.0, 0.3)(time)
    readings = encoder(position - shift) + shift
    shown = position if unwrap else readings
    smoother, found = Smoother(0.05, TURN, unwrap=unwrap), []
    for k in range(len(time)):
        smoother.add(1_000_000_000 + k * 1_000_000, float(readings[k]), float(shown[k]), k == 0)
        if k >= 50:
            found.append(smoother.result()[0])
    off = np.array(found) - shown[: len(found)]
    if not unwrap:
        off = np.where(np.abs(off) > 6.0, 0.0, off)  # one of them has wrapped already
        assert np.min(found) >= shift - math.pi - 1e-9 and np.max(found) < shift + math.pi + 1e-9
    assert np.nanmax(np.abs(off)) < 3 * TURN / 4096


def test_a_given_quantum_that_is_wrong_is_noticed():
    samples = BY_NAME['slow'].samples(duration=5.0)
    right, _ = errors(samples, quantum=TURN / 4096, skipped=2.0)
    large, _ = errors(samples, quantum=TURN / 1024, skipped=2.0)
    small, _ = errors(samples, quantum=TURN / 65536, skipped=2.0)
    assert rms(right) < 2e-4
    assert rms(large) < 2e-3
    assert rms(small) < 0.02


@pytest.mark.parametrize('period', [0.5, TURN])
def test_no_result_is_faster_than_half_a_turn_per_sample(period):
    readings = period * np.random.default_rng(1).uniform(-0.5, 0.5, 300)
    found = smoothed(np.arange(300) * 1_000_000, readings, period=period)[:, 1]
    assert np.isnan(found).any() and not np.nanmax(np.abs(found)) > 0.5 * period / 1e-3


def test_prismatic_joints_do_not_wrap():
    time = np.arange(4000) * 1e-3
    position, velocity = sine(2.0, 1.0)(time)
    position = 40.0 + np.floor(position / 1e-5) * 1e-5
    found = smoothed(1_000_000_000 + np.arange(4000) * 1_000_000, position, period=0.0)
    assert rms(found[500:, 1] - velocity[500 : len(found)]) < 2e-3
    assert np.max(np.abs(found[500:, 0] - position[500 : len(found)])) < 3e-5
