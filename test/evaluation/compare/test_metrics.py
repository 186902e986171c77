# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Metrics on signals whose answers are known."""

import math

import numpy as np
import pytest

from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.delay import delay, measured
from estimator_pkg.evaluation.matching import match, pieces
from estimator_pkg.evaluation.reference import reference
from estimator_pkg.evaluation.reference.white_noise import noise
from estimator_pkg.evaluation.signals import cubic
from estimator_pkg.evaluation.text import error, fixed, interval

TURN = 2.0 * np.pi


def jittered(seconds=5.0, rate=1000.0, jitter=0.3, seed=1):
    random = np.random.default_rng(seed)
    count = int(seconds * rate)
    return (np.arange(count) + jitter * random.uniform(-1.0, 1.0, count)) / rate


def sine(time, frequency=2.0, amplitude=5.0):
    return amplitude * np.sin(TURN * frequency * time + 0.4)


# ---------------------------------------------------------------- errors


def test_summary_of_known_errors():
    numbers = metrics.summary(np.array([3.0, -1.0, np.nan, -4.0]))
    assert numbers == {
        'rms': pytest.approx(np.sqrt(26.0 / 3.0)),
        'mean_abs': pytest.approx(8.0 / 3.0),
        'max_abs': 4.0,
        'bias': pytest.approx(-2.0 / 3.0),
    }
    assert all(np.isnan(value) for value in metrics.summary(np.full(3, np.nan)).values())


def test_position_error_takes_the_shorter_way_round():
    time = np.arange(0.0, 3.0, 1e-3)
    truth = 4.0 * time
    estimate = (truth + 0.1 + np.pi) % TURN - np.pi
    numbers = metrics.position(time, estimate, truth, TURN)
    assert numbers['max_abs'] == pytest.approx(0.1, abs=1e-9)
    assert numbers['bias'] == pytest.approx(0.1, abs=1e-9)
    assert metrics.position(time, estimate, truth, 0.0)['max_abs'] > 2.0


@pytest.mark.parametrize(('moves', 'late'), [(1.0, 0.004), (1.0, -0.002), (0.0, math.nan)])
def test_position_delay_across_wraps_and_at_rest(moves, late):
    def angle(time):
        return 0.7 + moves * (30.0 * time + 2.0 * np.sin(9.0 * time))

    time = jittered()
    estimate = angle(time - late) if moves else angle(time) + 0.01
    found = metrics.position(time, estimate % TURN, angle(time) % TURN, TURN)['delay_s']
    assert found == pytest.approx(late, abs=1e-6, nan_ok=True)


# ---------------------------------------------------------------- delay


def after_hole(time):
    return np.where(time > 2.0, time + 7.0, time)


@pytest.mark.parametrize(
    ('time', 'frequency', 'late'),
    [
        *((jittered(rate=1000.0), 2.0, late) for late in (0.0, 0.00312, -0.0041)),
        *((jittered(rate=100.0), 2.0, late) for late in (0.0, 0.00312, -0.0041)),
        (jittered(rate=100.0), 5.0, 0.0637),
        (jittered(), 0.5, 0.02),
        (jittered(), 10.0, 0.03),  # of many periods, the one nearest to zero
        (after_hole(jittered()), 2.0, 0.005),
    ],
)
def test_delay_of_a_shifted_sine(time, frequency, late):
    found = delay(time, sine(time - late, frequency), sine(time, frequency))
    assert found == pytest.approx(late, abs=1e-5)


def test_delay_of_a_first_order_low_pass():
    """At one frequency its delay is atan(w tau) / w."""
    time, tau, pulsation = jittered(20.0), 0.02, TURN * 2.0
    gain = 1.0 / np.hypot(1.0, pulsation * tau)
    late = np.arctan(pulsation * tau) / pulsation
    found = delay(time, gain * sine(time - late), sine(time))
    # what is smaller fits best a little earlier or later where the record is cut off
    assert found == pytest.approx(late, abs=3e-5)


def test_delay_is_as_sharp_as_the_noise_lets_it_be():
    time = np.arange(0.0, 5.0, 1e-3)
    random = np.random.default_rng(13)
    found = [
        delay(
            time,
            sine(time - 0.003, 0.5) + 0.05 * random.standard_normal(len(time)),
            sine(time, 0.5) + 0.1 * random.standard_normal(len(time)),
        )
        for _ in range(20)
    ]
    # the least that is possible: 0.112 / (sqrt(5000) rms slope of 11.1 rad/s^2) = 0.143 ms
    assert np.std(found) < 1.5 * 0.143e-3
    assert np.mean(found) == pytest.approx(0.003, abs=3.0 * 0.143e-3 / np.sqrt(20))


@pytest.mark.parametrize(('noise', 'truth_noise'), [(0.0, 0.0), (0.5, 0.0), (0.05, 0.1)])
def test_delay_at_constant_speed_is_not_reported(truth_noise, noise):
    random = np.random.default_rng(4)
    time = np.arange(0.0, 3.0, 1e-3)
    truth = 5.0 + truth_noise * random.standard_normal(len(time))
    assert np.isnan(delay(time, 5.0 + noise * random.standard_normal(len(time)), truth))


def wander(random, count, hz):
    """A random motion up to about `hz` at 200 Hz, of size 1."""
    spectrum = np.fft.rfft(random.standard_normal(count + 2000))
    spectrum /= (1.0 + (np.fft.rfftfreq(count + 2000, 5e-3) / hz) ** 2) ** 1.5
    values = np.fft.irfft(spectrum)[:count]
    return (values - np.mean(values)) / np.std(values)


@pytest.mark.parametrize('noise, seconds', [(0.05, 3.0), (0.05, 20.0), (0.5, 20.0)])
def test_the_interval_of_a_delay_contains_it(noise, seconds):
    random, late = np.random.default_rng(1), 2
    time = 5e-3 * np.arange(int(seconds / 5e-3))
    found = []
    for _ in range(40):
        truth = wander(random, len(time) + late, 1.0)
        estimate = truth[:-late] + noise * random.standard_normal(len(time))
        found.append(measured(time, estimate, truth[late:]))
    assert all(each.known.half < 8e-3 for each in found)
    inside = [abs(each.late - 5e-3 * late) <= each.half for each in found]
    assert np.mean(inside) >= 0.85
    wide = np.median([each.half for each in found]) / np.std([each.late for each in found])
    assert 1.4 < wide < 3.0  # and is no wider than it must be


def test_a_delay_that_the_motion_does_not_determine_has_no_interval():
    """Noise as large as the motion, correlated over 0.1 s: the smallest error says nothing."""
    random, time = np.random.default_rng(2), 5e-3 * np.arange(600)
    found = []
    for _ in range(20):
        truth, other = wander(random, 600, 0.3), wander(random, 600, 1.5)
        found.append(measured(time, truth + other, truth))
    assert np.mean([math.isnan(each.known.late) for each in found]) > 0.8
    vague = [each.known for each in found if math.isfinite(each.known.late)]
    assert all(each.half <= max(abs(each.late), 0.01) for each in vague)


# ---------------------------------------------------------------- noise at constant speed


def at_constant_speed():
    """While it moves the estimate is far off, while it is constant it is biased and noisy."""
    time = np.arange(0.0, 8.0, 1e-3)
    constant = (time > 3.0) & (time < 6.0)
    truth = np.where(constant, 5.0, sine(time))
    estimate = np.where(constant, 5.5, 3.0 * truth)
    return time, estimate + 0.2 * np.random.default_rng(5).standard_normal(len(time)), truth, 0.0


def settling():
    time = np.arange(0.0, 4.0, 1e-3)
    settled = 10.0 * (1.0 - np.exp(-(time - 1.0) / 0.02))
    return time, np.where(time < 1.0, 0.0, settled), np.where(time < 1.0, 0.0, 10.0), 0.0


def a_noisy_truth():
    random = np.random.default_rng(6)
    time = np.arange(0.0, 8.0, 1e-3)
    motion = np.where(time < 4.0, 0.0, 0.3 * np.sin(TURN * 0.4 * (time - 4.0)))
    noise = random.standard_normal((2, len(time)))
    return time, motion + 0.01 * noise[1], motion + 0.1 * noise[0], 0.1


def only_motion():
    time = np.arange(0.0, 4.0, 1e-3)
    return time, sine(time), sine(time), 0.0


@pytest.mark.parametrize(
    ('signals', 'least', 'most'),
    [
        (at_constant_speed, 0.19, 0.21),
        (settling, 0.0, 1e-3),
        (a_noisy_truth, 0.0095, 0.0105),
        (only_motion, math.nan, math.nan),
    ],
)
def test_noise_is_that_at_constant_speed_after_settling(signals, least, most):
    found = metrics.noise_at_constant_speed(*signals())
    assert least <= found <= most or (math.isnan(least) and math.isnan(found))


# ---------------------------------------------------------------- matching


def test_cubic_is_exact_at_samples_and_for_parabolas():
    time = jittered(0.1)
    values = 3.0 * time * time - time + 2.0
    between = np.linspace(time[0], time[-1], 777)
    assert np.allclose(cubic(time, values, time), values, atol=1e-12)
    assert np.allclose(cubic(time, values, between), 3.0 * between**2 - between + 2.0, atol=1e-12)


def test_equal_stamps_take_the_truth_as_it_is():
    stamps = np.arange(10, dtype=np.int64) * 1_000_000 + 1
    truth = np.random.default_rng(7).standard_normal(10)
    found = match(stamps[[2, 5]], stamps, truth, truth, 0.0)
    assert found.exact == 2 and found.unmatched == 0
    assert found.velocity.tolist() == truth[[2, 5]].tolist()


def test_a_looping_stream_is_matched_turn_by_turn():
    once = np.arange(1, 1001, dtype=np.int64) * 1_000_000
    stamps = np.concatenate([once, once])
    truth = np.concatenate([np.zeros(1000), np.ones(1000)])
    found = match(stamps, stamps, truth, truth, 0.0)
    assert len(pieces(stamps)) == 2
    assert found.velocity.tolist() == truth.tolist()
    assert np.all(np.diff(found.time) > 0.0)


def test_repeated_late_and_stray_stamps_are_matched_once_or_never():
    stamps = np.array([1, 2, 2, 4, 3, 10**9, 5], np.int64) * 1_000_000
    assert len(pieces(stamps)) == 1  # one stamp far ahead is no clock jump
    truth = np.arange(1.0, 6.0)
    found = match(stamps, np.arange(1, 6, dtype=np.int64) * 1_000_000, truth, truth, 0.0)
    assert found.velocity.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


# ---------------------------------------------------------------- the reference


@pytest.mark.parametrize('speed', [0.0, 400.0])
@pytest.mark.parametrize('late', [0.0, 0.0015])
def test_reference_lag_bias_and_noise(speed, late):
    """Found from a quantised, wrapped position, at speeds beyond half a turn per sample too."""
    random = np.random.default_rng(8)
    time = jittered(20.0, rate=100.0 if speed else 500.0, jitter=0.1)
    position = speed * time + 1.5 * np.sin(5.0 * time)
    velocity = speed + 7.5 * np.cos(5.0 * (time - late)) + 0.02
    velocity += 0.08 * random.standard_normal(len(time))
    measured = np.floor((position % TURN) / 4e-4) * 4e-4
    found = reference.fit(time, velocity, measured, TURN)
    assert found.lag_s == pytest.approx(late, abs=4.0 * found.lag_stddev)
    assert found.lag_stddev < 0.3e-3
    assert found.bias == pytest.approx(0.02, abs=4.0 * found.bias_stddev)
    if not speed:
        assert found.noise == pytest.approx(0.08, rel=0.2)
        assert found.slope == pytest.approx(1.0, abs=4.0 * found.slope_stddev)


def test_reference_noise_does_not_draw_its_lag_to_zero():
    """Slow motion under much noise: a plain least-squares fit would give 1.2 ms."""
    time = np.arange(0.0, 60.0, 2e-3)
    position = 0.1 * np.sin(5.0 * time)
    found = []
    for seed in range(10):
        noise = 0.1 * np.random.default_rng(seed).standard_normal(len(time))
        found.append(
            reference.fit(time, 0.5 * np.cos(5.0 * (time - 0.002)) + noise, position, TURN)
        )
    stddev = np.mean([one.lag_stddev for one in found])
    assert np.mean([one.lag_s for one in found]) == pytest.approx(0.002, abs=stddev)
    assert np.std([one.lag_s for one in found]) < 2.0 * stddev
    assert stddev < 0.5e-3


def test_reference_at_rest_has_a_bias_and_no_lag():
    random = np.random.default_rng(10)
    time = np.arange(0.0, 5.0, 2e-3)
    velocity = 0.05 + 0.06 * random.standard_normal(len(time))
    found = reference.fit(time, velocity, np.full(len(time), 0.3), TURN)
    assert np.isnan(found.lag_s) and np.isnan(found.slope)
    assert found.bias == pytest.approx(0.05, abs=4.0 * found.bias_stddev)


def test_outliers_of_the_position_do_not_reach_the_reference():
    time = np.arange(0.0, 20.0, 2e-3)
    position = 1.5 * np.sin(5.0 * time)
    position[::701] += 2.0
    found = reference.fit(time, 7.5 * np.cos(5.0 * (time - 0.001)) + 0.02, position, TURN)
    assert found.lag_s == pytest.approx(0.001, abs=2e-5)
    assert found.bias == pytest.approx(0.02, abs=1e-3)


def rich(count=100, rate=100.0, seed=3):
    """(time, position, velocity) of a motion with kinks, of about 300 rad/s, coarsely sampled.

    Integrated in closed form between the kinks, which come a few samples apart.
    """
    random = np.random.default_rng(seed)
    time = np.sort((np.arange(count) + 0.2 * random.random(count)) / rate)
    bend = np.linspace(0.0, time[-1], count // 8)
    size = 4e4 * random.standard_normal(len(bend))
    after = np.maximum(time[:, None] - bend, 0.0)
    wave = TURN * 7.0
    velocity = 300.0 + 90.0 * np.sin(wave * time) + (after**2 * size).sum(1)
    position = 300.0 * time - 90.0 / wave * np.cos(wave * time) + (after**3 * size).sum(1) / 3.0
    return time, position, velocity


@pytest.mark.parametrize('seed', range(5))
def test_a_rich_motion_is_no_noise_and_noise_is(seed):
    """At 300 rad/s and 100 samples a second the angle turns by half a turn between two samples."""
    random = np.random.default_rng(seed)
    time, position, velocity = rich(seed=seed)
    wrapped = position % TURN
    third = math.sqrt(np.mean(np.diff(velocity, 3) ** 2) / 20.0)
    exact = noise(time, velocity, wrapped, TURN)
    assert exact < 0.02 * third and third > 2.0
    for size, least, most in ((0.3, 0.65, 1.35), (5.0, 0.65, 2.0)):  # the motion looks like the 5
        shaken = velocity + size * random.standard_normal(len(time))
        assert least < noise(time, shaken, wrapped, TURN) / size < most


def test_a_fast_sine_without_positions_is_no_noise_and_noise_is():
    time = np.arange(0.0, 4.0, 0.01)
    velocity = 100.0 * np.sin(TURN * 8.0 * time)
    third = math.sqrt(np.mean(np.diff(velocity, 3) ** 2) / 20.0)
    assert noise(time, velocity) < 1e-3 * third
    shaken = velocity + 0.5 * np.random.default_rng(1).standard_normal(len(time))
    assert noise(time, shaken) == pytest.approx(0.5, rel=0.25) and third > 1.0


def test_positions_that_follow_the_noise_do_not_hide_it():
    """A reference that integrates its own noisy velocity, or differentiates a noisy position."""
    random = np.random.default_rng(2)
    time = np.arange(0.0, 10.0, 0.01)
    velocity = np.cos(time) + 0.1 * random.standard_normal(len(time))
    position = np.concatenate([[0.0], np.cumsum(0.005 * (velocity[1:] + velocity[:-1]))])
    assert noise(time, velocity, position) == pytest.approx(0.1, rel=0.2)
    position = np.sin(time) + 1e-3 * random.standard_normal(len(time))
    velocity = np.gradient(position, time)
    assert 0.5 < noise(time, velocity, position) / np.std(velocity - np.cos(time)) < 2.0


@pytest.mark.parametrize(
    ('shown', 'text'),
    [
        *((error(value, 4), text) for value, text in ((0.25, '0.2500'), (0.00072, '0.00072'))),
        *((error(value, 4), text) for value, text in ((-3e-9, '-3e-09'), (math.nan, '-'))),
        *((fixed(value, 2), text) for value, text in ((-1e-6, '0.00'), (-0.006, '-0.01'))),
        (interval(13.04, 7.21, 'ms'), '13.0 +- 7.2 ms'),
        (interval(12.94, 13.3, 'ms'), '13 +- 13 ms'),
        (interval(0.1736, 0.0612, 'ms'), '0.17 +- 0.06 ms'),
        (interval(-0.004, 0.0, 'ms'), '0.00 +- 0.01 ms'),
        (interval(math.nan, math.nan, 'ms'), '-'),
    ],
)
def test_numbers_of_tables(shown, text):
    assert shown == text


@pytest.mark.long
@pytest.mark.parametrize('burst', [1e-9, 1e-7])
def test_stamps_that_hardly_differ_take_no_memory(burst):
    """A clock that stood: half of the samples are a nanosecond apart."""
    time = np.cumsum(np.where(np.arange(400) % 100 < 60, burst, 0.4))
    assert not abs(delay(time, sine(time - 0.01), sine(time))) > 0.25
    k = np.arange(400)
    lag = delay(burst * k, np.sin(0.05 * (k - 3)), np.sin(0.05 * k))
    assert lag == pytest.approx(3.0 * burst, rel=5e-3)
