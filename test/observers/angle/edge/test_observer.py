# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The edge-aware adaptive observer: what the issue asks of it, and what it stands on."""

import math

import numpy as np
import pytest
from observer_cases import make, stamps, wrapped

from benchmarks import accuracy as bench_accuracy
from benchmarks.signals import FURTHER, SIGNALS
from benchmarks.streams import streams
from estimator_pkg.driver.guard import REPEATED
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.observers.contract import COASTING, INITIALISING, TRACKING
from sim_pkg.joints import profiles

QUANTUM = 2.0 * math.pi / 4096
DT = 1e-3
BOUNDS = {
    'slow': 1e-4,
    'sine': 0.053,
    'trapezoid': 0.070,
    'fast': 0.005,
    'jitter': 0.055,
    'drops': 0.055,
}
REVERSAL = 0.0046  # the best of all other observers, each tuned for this column
TIMES_KALMAN = 1.05
BY_NAME = {signal.name: signal for signal in SIGNALS + FURTHER}
ENTRY = Entry('edge_adaptive', 'edge_adaptive')


def read(angle, quantum=QUANTUM):
    """What a counting encoder shows."""
    return wrapped(np.floor(np.asarray(angle) / quantum) * quantum)


def joint(**gains):
    return make('edge_adaptive', {'quantum': QUANTUM, **gains})


def run(angle, at=None, **gains):
    """Velocity, standard deviation and status for what an encoder reads of `angle` at 1 kHz."""
    return joint(**gains).run(stamps(len(angle)) if at is None else at, read(angle))


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def check(rows):
    """The issue's numbers, for every column that has one."""
    ours = {row['signal']: row for row in rows if row['observer'] == 'edge_adaptive'}
    for name, bound in BOUNDS.items():
        assert ours[name]['pooled'] <= bound, name
    assert ours['reversal']['pooled'] <= REVERSAL
    for name, row in ours.items():
        assert row['worst_ratio'] <= TIMES_KALMAN, name
    assert ours['noise']['worst_ratio'] > 0.5  # the yardstick was there
    if rows[0]['draws'] == bench_accuracy.DRAWS:
        for name in MOVING:  # a shaft at rest is known better than by a variance
            most = 0.985 if name in ('trapezoid', 'steps', 'reversal') else 0.98
            assert 0.93 <= ours[name]['coverage'] <= most, name


# ---------------------------------------------------------------- one setting for all columns


@pytest.mark.long
def test_one_setting_serves_every_column():
    check(bench_accuracy.drawn(draws=3, duration=5.0, fast=True)['rows'])


@pytest.mark.slow
def test_one_setting_serves_every_column_at_a_hundred_phases_and_speeds():
    check(bench_accuracy.drawn(draws=100, fast=True)['rows'])


def test_delay_on_the_sine_is_at_most_half_a_millisecond():
    found = bench_accuracy.measure(ENTRY, BY_NAME['sine'].samples(duration=5.0))
    assert 0.0 < found['delay_s'] <= 0.5e-3
    assert found['published'] == 1.0


@pytest.mark.parametrize('counts', [1.01, 0.99, 0.51, 0.335, 1.49, 100.02, 130.67, 20.26])
def test_a_beat_of_speed_and_sampling_is_not_taken_for_motion(counts):
    speed = counts * QUANTUM / DT
    out = run(speed * np.arange(5000) * DT + 0.4e-3)
    assert rms(out.velocity[2000:] - speed) < 2e-3  # a limit cycle has 0.05 to 0.09


MOVING = (
    'sine',
    'trapezoid',
    'jitter',
    'drops',
    'reversal',
    'steps',
    'noise',
    '100 Hz',
    '200 Hz',
    '10 kHz',
)


@pytest.mark.long
def test_standard_deviation_covers_in_motion():
    rows = bench_accuracy.drawn(
        [ENTRY],
        [BY_NAME[name] for name in MOVING if name != '10 kHz'],
        draws=4,
        duration=5.0,
        fast=True,
    )['rows']
    for row in rows:
        assert 0.915 <= row['coverage'] <= 0.99, row['signal']  # of four draws


def test_readings_that_repeat_a_pattern_do_not_make_it_too_sure():
    """At so many counts per sample the innovations soon are far smaller than foreseen, but they are
    the same ones again and again, and no news: no error is 5 sigma.
    """
    ratios = []
    for counts in (0.3, 7.3):
        for phase in (0.05, 0.3, 0.55, 0.8):
            speed = counts * QUANTUM / DT
            out = run(speed * DT * np.arange(5000) + phase * QUANTUM)
            ratios.append(((out.velocity - speed) / out.velocity_stddev)[1500:])
    assert np.max(np.abs(ratios)) < 5.0
    assert rms(ratios) < 1.4


def test_calm_innovations_are_believed_in_part():
    """A slow sine: not all of the intervals may cover, they are 95 % ones."""
    w = math.pi
    t = DT * np.arange(8000)
    out = run(-5.0 / w * np.cos(w * t))
    covered = np.abs(out.velocity - 5.0 * np.sin(w * t)) < 1.96 * out.velocity_stddev
    assert 0.93 < np.mean(covered[1500:]) < 0.985


VIBRATIONS = [(200.0, 7.0, 4.0), (300.0, 5.5, 12.0), (1000.0, 14.0, 10.0)]


def shaking(rate, period, quanta, quantum=2.9e-3):
    """A slow swing that shakes for half of the time: (stamps, reading, velocity)."""
    t = (np.arange(int(6.0 * rate)) + 1.0) / rate
    on = t >= 3.0
    w = 2.0 * math.pi * rate / period
    angle = np.sin(2.0 * t) + np.where(on, quanta * quantum * np.sin(w * (t - 3.0)), 0.0)
    velocity = 2.0 * np.cos(2.0 * t) + np.where(
        on, quanta * quantum * w * np.cos(w * (t - 3.0)), 0.0
    )
    return stamps(len(t), 1.0 / rate), np.floor(angle / quantum) * quantum, velocity


@pytest.mark.parametrize('rate, period, quanta', VIBRATIONS)
def test_a_vibration_of_a_few_samples_is_followed_and_not_taken_for_noise(rate, period, quanta):
    at, measured, velocity = shaking(rate, period, quanta)
    half = len(at) // 2
    error = {}
    for name, gains in (('edge_adaptive', {}), ('kalman', {'low_speed_bound': False})):
        out = make(name, {'quantum': 2.9e-3, **gains}).run(at, wrapped(measured))
        error[name] = np.abs(out.velocity - velocity)
        if name == 'edge_adaptive':
            inside = np.mean((error[name] < 1.96 * out.velocity_stddev)[half + 100 :])
    shaken = rms(
        velocity[half + 100 :] - 2.0 * np.cos(2.0 * np.arange(len(at)) / rate)[half + 100 :]
    )
    assert rms(error['edge_adaptive'][half + 100 :]) < 0.6 * shaken
    assert rms(error['edge_adaptive'][half + 100 :]) < 0.7 * rms(error['kalman'][half + 100 :])
    assert rms(error['edge_adaptive'][100:half]) < rms(error['kalman'][100:half])
    assert inside > 0.8


@pytest.mark.parametrize('rate, period, quanta', [(200.0, 7.0, 1.3), (1000.0, 6.5, 1.5)])
def test_a_vibration_of_hardly_more_than_a_count_is_noticed(rate, period, quanta):
    """Its third differences are quantisation; that its speed goes from sample to sample is not."""
    at, measured, velocity = shaking(rate, period, quanta)
    half = len(at) // 2
    out = make('edge_adaptive', {'quantum': 2.9e-3}).run(at, wrapped(measured))
    swing = 2.0 * np.cos(2.0 * np.arange(len(at)) / rate)
    error = np.abs(out.velocity - velocity)
    assert rms(error[half + 100 :]) < 0.8 * rms((velocity - swing)[half + 100 :])
    assert np.mean((error < 1.96 * out.velocity_stddev)[half + 100 :]) > 0.9


@pytest.mark.parametrize('noise', [2e-5, 2e-4])
def test_a_blow_is_not_overshot(noise):
    """A speed that jumps, at 300 Hz, read without a quantum to speak of."""
    t = np.arange(900) / 300.0
    for phase in np.linspace(0.0, 0.9, 10):
        blow = 2.0 + phase / 300.0
        angle = -2.0 * t + np.where(t > blow, 5.0 * (t - blow), 0.0)
        angle = angle + np.random.default_rng(3).normal(0.0, noise, len(t))
        v = make('edge_adaptive').run(stamps(len(t), 1.0 / 300.0), wrapped(angle)).velocity
        assert np.max(v[600:]) < 3.0 + 0.6 * 5.0
        assert np.max(np.abs(v[612:] - 3.0)) < 1.5


def test_a_rare_blow_leaves_no_noise():
    """Speed steps 2 s apart, at 1 kHz, in noise: how fast it listens 50 to 250 ms after each."""
    t = np.arange(1, 6001) / 1000.0
    true = 5.0 + 20.0 * (t % 4.0 >= 2.0)
    angle = np.cumsum(true) / 1000.0 + np.random.default_rng(1).normal(0.0, 1e-3, len(t))
    error = make('edge_adaptive').run(stamps(len(t)), wrapped(angle)).velocity - true
    since = np.where(t > 2.0, t % 2.0, math.inf)
    assert rms(error[since < 0.02]) < 6.0
    after = error[(since >= 0.05) & (since < 0.25)]
    assert rms(after) < 0.6  # 1.15 where one blow makes the next as likely at once


@pytest.mark.long
@pytest.mark.parametrize('noise', [0.1, 0.2, 0.4, 0.65])
def test_flicker_between_counts_is_no_motion(noise):
    """Noise before the counter at 10 kHz: at rest by an edge, at creep and when a motion starts."""
    t = np.arange(30_000) * 1e-4
    start = np.clip(t - 1.5, 0.0, 0.2)
    for angle, speed, most in (
        (0.4 * QUANTUM + 0.0 * t, 0.0 * t, 0.05),
        (0.02 * t, 0.02 + 0.0 * t, 0.05),
        (2.5 * start**2 + np.clip(t - 1.7, 0.0, None), 5.0 * start, 0.3),
    ):
        read_so = angle + noise * QUANTUM * np.random.default_rng(7).normal(size=len(t))
        out = run(read_so, stamps(len(t), 1e-4))
        error = np.abs(out.velocity - speed)[5000:]
        assert np.max(error) < most
        assert rms(error) < 0.2 * most


@pytest.mark.long
@pytest.mark.parametrize('noise', [0.1, 0.2, 0.4])
def test_the_noise_is_learnt_from_flicker(noise):
    """At creep edges agree with each other however large it is; what flickers tells it."""
    way = 0.02 * np.arange(30_000) * 1e-4
    one = joint()
    flicker = noise * QUANTUM * np.random.default_rng(3).normal(size=len(way))
    one.run(stamps(len(way), 1e-4), read(way + flicker))
    assert math.sqrt(one._track[6][3][1]) == pytest.approx(noise * QUANTUM, rel=0.35)


# ---------------------------------------------------------------- faults


@pytest.mark.parametrize('size', [0.5, 0.02])
@pytest.mark.parametrize('speed', [0.0, 0.02, 2.0, 200.0])
def test_a_glitch_leaves_no_trace(speed, size):
    angle = speed * np.arange(5000) * DT + 0.4e-3
    measured = read(angle)
    measured[3000] = wrapped(measured[3000] + size)
    out = joint().run(stamps(5000), measured)
    error = np.abs(out.velocity - speed)
    assert np.max(error[3010:]) * 0.01 < QUANTUM
    assert np.max(error[3000:]) < 1.0
    assert out.status[3000] == COASTING and out.status[3010] == TRACKING


@pytest.mark.parametrize('seed', range(4))
def test_glitches_are_not_taken_for_noise(seed):
    """7 to 9 times the error without them before: the filter listened less and less."""
    random = np.random.default_rng(seed)
    time = np.arange(4000) * 2e-3
    clean = 1.5 * np.sin(2.0 * time) + 1e-3 * random.standard_normal(4000)
    wrong = clean.copy()
    at = np.arange(900, 4000, 60)
    at += random.integers(0, 20, len(at))
    wrong[at] += random.uniform(0.05, 2.5, len(at)) * random.choice([-1.0, 1.0], len(at))
    errors = []
    for angle in (clean, wrong):
        out = make('edge_adaptive').run(stamps(4000, 2e-3), wrapped(angle))
        errors.append(rms((out.velocity - 3.0 * np.cos(2.0 * time))[600:]))
    assert errors[1] < 1.25 * errors[0]


@pytest.mark.parametrize('quanta', [1.0, 2.0, 3.0])
def test_a_glitch_of_a_few_counts_is_no_motion(quanta):
    for speed in (0.0, 0.02):
        angle = speed * np.arange(5000) * DT + 0.4e-3
        angle[3000] += quanta * QUANTUM
        error = np.abs(run(angle).velocity - speed)
        assert np.max(error[3000:]) < 0.05
        assert np.max(error[3010:]) * 0.01 < 0.1 * QUANTUM


@pytest.mark.parametrize('counts', [64, 256, 65536])
def test_a_glitch_of_half_a_radian_leaves_less_than_a_count_with_any_encoder(counts):
    quantum = 2.0 * math.pi / counts
    angle = 2.0 * np.arange(4000) * DT + 0.4e-3
    measured = read(angle, quantum)
    measured[3000] = read(angle[3000] + 0.5, quantum)
    out = joint(quantum=quantum).run(stamps(4000), measured)
    assert np.max(np.abs(out.velocity - 2.0)[3010:]) * 0.01 < 0.1 * quantum


@pytest.mark.parametrize('hole', [0.45, 1.0])
def test_a_hole_at_200_rad_per_s_is_harmless(hole):
    t = np.arange(5000) * DT
    kept = (t < 2.0) | (t > 2.0 + hole)
    out = run((200.0 * t)[kept], stamps(5000)[kept])
    told = np.flatnonzero(np.isin(out.status, (TRACKING, COASTING)))
    begin = told[(told > 2000) & (told < 2100)] if hole > 0.5 else told[:0]
    assert np.max(np.abs(out.velocity[begin] - 200.0), initial=0.0) < 1.0  # as at any start
    told = np.setdiff1d(told[told > 1000], begin)
    assert np.max(np.abs(out.velocity[told] - 200.0)) < 0.01
    assert np.all(out.status[2010:] == TRACKING)
    assert np.count_nonzero(out.status[1000:] == INITIALISING) <= (0 if hole < 0.5 else 5)


def test_wrong_stamps_cost_little():
    random = np.random.default_rng(2)
    t = np.arange(6000) * DT
    at = stamps(6000) + np.rint(random.uniform(-2e5, 2e5, 6000)).astype(np.int64)
    out = run(200.0 * t, at)
    assert rms(out.velocity[1000:] - 200.0) <= 0.01


def test_an_eccentric_encoder_makes_no_spike():
    phase = 20.0 * np.arange(6000) * DT
    out = run(phase + 2e-3 * np.sin(phase))
    assert np.max(np.abs(out.velocity[1000:] - 20.0)) <= 0.15


def test_misplaced_edges_keep_the_gain_at_creep():
    """Edges off by up to a quarter count: fifty times better than the Kalman filter."""
    random = np.random.default_rng(5)
    edges = random.uniform(-0.25, 0.25, 4096) * QUANTUM
    angle = 0.3 + 0.02 * np.arange(8000) * DT
    count = np.floor(angle / QUANTUM).astype(int)
    count -= angle - count * QUANTUM < edges[count % 4096]
    count += angle - (count + 1) * QUANTUM >= edges[(count + 1) % 4096]
    error = {}
    for name in ('edge_adaptive', 'kalman'):
        out = make(name, {'quantum': QUANTUM}).run(stamps(8000), count * QUANTUM)
        error[name] = rms(out.velocity[1000:] - 0.02)
    assert error['edge_adaptive'] * 50.0 < error['kalman']


# ---------------------------------------------------------------- the quantum


def test_a_quantum_four_times_too_large_is_reported_and_mended_within_a_second():
    t = np.arange(3000) * DT
    w = 4.0 * math.pi
    measured = read(5.0 / w * np.sin(w * t))
    one = joint(quantum=4.0 * QUANTUM)
    one.run(stamps(3000)[:1000], measured[:1000])
    assert 'too large' in one.why() and f'{QUANTUM:.4g}' in one.why()
    out = one.run(stamps(3000)[1000:], measured[1000:])
    right = joint().run(stamps(3000), measured)
    assert np.allclose(out.velocity, right.velocity[1000:], atol=0.05)


@pytest.mark.parametrize('speed', [0.05, 1.0, 200.0])
def test_a_quantum_too_small_is_reported_and_mended(speed):
    one = joint(quantum=QUANTUM / 16.0)
    out = one.run(stamps(4000), read(speed * np.arange(4000) * DT))
    assert 'too small' in one.why()
    assert rms(out.velocity[2500:] - speed) < 5e-3


@pytest.mark.long
@pytest.mark.parametrize('given', [1.0 / 1.6, 0.5])
def test_a_quantum_of_half_the_step_is_reported_and_mended(given):
    """Twice the counts, as where the lines of an encoder are taken for a quarter of its edges."""
    ratios = []
    for speed in (0.05, 0.3, 2.0, 10.0, 50.0, 200.0, 201.0):
        reading = read(speed * np.arange(4000) * DT)
        one = joint(quantum=given * QUANTUM)
        out = one.run(stamps(4000), reading)
        assert 'too small' in one.why() and f'{QUANTUM:.4g}' in one.why(), speed
        assert one._track[6][3][0] == pytest.approx(QUANTUM, rel=1e-6)
        right = joint().run(stamps(4000), reading)
        ratios.append(np.median(out.velocity_stddev[3000:] / right.velocity_stddev[3000:]))
    # where the density was raised by the wrong quantum it falls again in many seconds
    assert 0.95 < min(ratios) < 1.05 and max(ratios) < 1.5


STRAY = {
    'a reading off by 0.3': lambda reading: np.where(np.arange(len(reading)) == 500, 0.3, 0.0),
    'a reading off by 0.01': lambda reading: np.where(np.arange(len(reading)) == 500, 0.01, 0.0),
    'zero off by 0.3': lambda reading: np.where(np.arange(len(reading)) > 500, 0.3, 0.0),
    'zero off by 0.003': lambda reading: np.where(np.arange(len(reading)) > 500, 0.003, 0.0),
    'five readings': lambda reading: np.where(
        np.isin(np.arange(len(reading)), (500, 700, 701, 1100, 1500)), 0.27, 0.0
    ),
}


@pytest.mark.long
@pytest.mark.parametrize('given', [0.0, 1.0, 0.5, 1.3, 4.0])
@pytest.mark.parametrize('stray', STRAY)
def test_a_step_that_nothing_repeats_is_forgotten(stray, given):
    """One reading, or one change of zero, by a part of a count: +5 to 8 % for good."""
    t = np.arange(8000) * DT
    w = 4.0 * math.pi
    clean = np.floor(5.0 / w * np.sin(w * t) / QUANTUM) * QUANTUM
    one = joint(quantum=given * QUANTUM)
    out = one.run(stamps(len(t)), wrapped(clean + QUANTUM * STRAY[stray](t)))
    twin = joint().run(stamps(len(t)), wrapped(clean))
    later = t > 3.0
    assert one._track[6][3][0] == pytest.approx(QUANTUM, rel=1e-6)
    assert ('too' in one.why()) == (given not in (0.0, 1.0))
    assert rms((out.velocity - 5.0 * np.cos(w * t))[later]) == pytest.approx(
        rms((twin.velocity - 5.0 * np.cos(w * t))[later]), rel=1e-3
    )


@pytest.mark.parametrize('given', [0.8, 1.3])
@pytest.mark.parametrize('speed', [0.05, 2.0, 200.0])
def test_a_quantum_off_by_a_third_is_reported_and_mended(speed, given):
    one = joint(quantum=given * QUANTUM)
    one.run(stamps(4000), read(speed * np.arange(4000) * DT))
    assert ('too large' if given > 1.0 else 'too small') in one.why()
    assert one._track[6][3][0] == pytest.approx(QUANTUM, rel=1e-6)


@pytest.mark.parametrize('given', [0.0, 1e-6])
def test_readings_without_a_step_are_not_taken_for_counts(given):
    """Noise and a smooth motion: what is found stays far below their size."""
    t = np.arange(6000) * DT
    for noise in (0.0, 1e-5, 1e-3):
        angle = np.sin(3.0 * t) + noise * np.random.default_rng(2).normal(size=len(t))
        one = joint(quantum=given)
        one.run(stamps(len(t)), wrapped(angle))
        assert one._track[6][3][0] < max(0.05 * noise, 2e-6), noise


@pytest.mark.parametrize('speed', [0.02, 2.0, 200.0, 1000.0])
def test_a_right_quantum_is_not_doubted(speed):
    one = joint()
    one.run(stamps(3000), read(speed * np.arange(3000) * DT))
    assert one.why() == ''


@pytest.mark.parametrize('narrow', [False, True], ids=['float64', 'float32'])
@pytest.mark.parametrize('speed', [0.05, 3.0, 201.0])
def test_the_quantum_is_found_where_it_is_not_given(speed, narrow):
    measured = read(speed * np.arange(6000) * DT + 0.1)
    if narrow:
        measured = measured.astype(np.float32).astype(float)
    one = joint(quantum=0.0)
    out = one.run(stamps(6000), measured)
    found = one._track[6][3][0]
    assert found == pytest.approx(QUANTUM, rel=1e-3)
    assert rms(out.velocity[3000:] - speed) < 2e-3


def test_the_first_edge_of_a_shaft_that_stood_is_no_motion():
    """With no quantum given, the first change of the reading shows it: no full step of way."""
    for flicker in ((1.0, 0.0, 1.0), (1.0, 1.0, 1.0), (0.0, 1.0, 0.0)):
        counts = np.concatenate([np.zeros(2000), flicker, np.ones(500)])
        out = run((counts + 0.5) * QUANTUM, quantum=0.0)
        shown = out.velocity[out.status == TRACKING]
        assert np.abs(shown).max() <= 0.3 * QUANTUM / DT
        assert abs(shown[-1]) <= 0.01


def test_a_start_after_a_rest_is_followed_at_once():
    """A shaft that has stood and then moves by counts in every sample is no flicker."""
    way = 20.0 * np.clip((np.arange(2100) - 2000) * DT, 0.0, None)
    out = run(way, quantum=0.0)
    assert abs(out.velocity[2002] - 20.0) <= QUANTUM / DT
    assert np.abs(out.velocity[2010:] - 20.0).max() <= 0.2


# ---------------------------------------------------------------- start, status, gaps


@pytest.mark.parametrize('speed', [0.0, 1.0, -100.0, 1000.0, -2000.0, 3000.0, 3100.0])
def test_a_cold_start_locks(speed):
    out = run(speed * np.arange(400) * DT)
    assert abs(out.velocity[50] - speed) < 0.05
    assert np.all(out.status[20:] == TRACKING)


def test_readings_far_off_are_held_against_and_a_lasting_jump_starts_again():
    angle = 3.0 * np.arange(4000) * DT
    angle[2000:2100] += 2.0
    out = run(angle)
    assert np.all(out.status[2000:2100] == COASTING)
    assert np.all(np.abs(out.velocity[2000:] - 3.0) < 0.05)
    angle[2000:] = 3.0 * np.arange(2000) * DT + 2.5
    out = run(angle)
    assert INITIALISING in out.status[2400:2600]
    assert out.status[-1] == TRACKING and abs(out.velocity[-1] - 3.0) < 0.01


@pytest.mark.parametrize('speed', [2.0, 20.0, 200.0])
def test_a_stream_that_repeats_every_second_reading_is_followed(speed):
    measured = read(speed * np.arange(4000) * DT)
    measured[1::2] = measured[::2]
    out = joint().run(stamps(4000), measured)
    assert np.all(out.verdict[1501::2] == REPEATED)
    assert np.all(np.abs(out.velocity[1500::2] - speed) < 0.01 * speed)


def test_a_sudden_stop_is_seen():
    angle = 5.0 * np.minimum(np.arange(4000) * DT, 2.0)
    out = run(angle)
    assert abs(out.velocity[2010]) < 0.3
    assert np.max(np.abs(out.velocity[2030:])) < 0.1
    assert np.all(out.velocity[3900:] < 1e-3)


def test_prismatic_and_multi_turn_readings_are_followed_without_wrapping():
    angle = 40.0 * np.arange(3000) * DT
    for period in (0.0, 2.0 * math.pi):
        one = make('edge_adaptive', {'quantum': QUANTUM}, wrap_period=period)
        out = one.run(stamps(3000), np.floor(angle / QUANTUM) * QUANTUM)
        assert np.all(np.abs(out.velocity[500:] - 40.0) < 0.05)
        assert np.all(np.abs(out.position - angle)[500:] < 1.01 * QUANTUM)


@pytest.mark.parametrize('scale', [1.0, 1e-3, 1e3])
def test_nothing_depends_on_the_unit_of_the_angle(scale):
    """A reading in other units, the quantum with it, gives the same in those units."""
    t = np.arange(3000) * DT
    motion = np.floor((3.0 * t * t + np.sin(8.0 * t)) / QUANTUM) * QUANTUM
    of = [
        make('edge_adaptive', {'quantum': factor * QUANTUM}, wrap_period=0.0).run(
            stamps(3000), factor * motion
        )
        for factor in (1.0, scale)
    ]
    assert np.allclose(of[1].velocity / scale, of[0].velocity, rtol=1e-6, atol=1e-6)


# ---------------------------------------------------------------- tables and pictures


def test_drawn_columns_differ_in_phase_and_speed_and_are_repeatable():
    for signal in SIGNALS + FURTHER:
        one, again, other = signal.drawn(1, 2.0), signal.drawn(1, 2.0), signal.drawn(2, 2.0)
        assert np.array_equal(one.angle, again.angle)
        assert not np.array_equal(one.angle[:100], other.angle[:100])
        steps = np.abs(np.diff(np.sort(one.angle)))
        assert np.allclose(steps / signal.quantum, np.rint(steps / signal.quantum), atol=1e-6)
    beats = [BY_NAME['beat'].drawn(k, 0.1).velocity[0] * DT / QUANTUM for k in range(40)]
    nearest = [min(abs(x - p / q) for q in range(1, 7) for p in range(1, q + 1)) for x in beats]
    assert max(nearest) < 0.041 and len({round(x, 6) for x in beats}) == 40


def test_the_table_of_draws_says_how_often_the_yardstick_is_better():
    found = bench_accuracy.drawn(
        [bench_accuracy.YARDSTICK, Entry('slow', 'pll')], (BY_NAME['sine'],), draws=2, duration=2.0
    )
    rows = {row['observer']: row for row in found['rows']}
    assert rows['kalman acceleration']['worst_ratio'] == 1.0
    assert rows['slow']['worse'] == 2 and rows['slow']['worst_ratio'] > 1.05
    assert '2 random phases' in bench_accuracy.describe_drawn(found)
    assert rows['slow']['score'] >= rows['slow']['width'] > 0.0


def test_the_interval_score_is_least_for_the_right_width():
    error = np.random.default_rng(1).normal(0.0, 0.2, 20_000)
    covered, width, score = bench_accuracy.interval_score(error, np.full(len(error), 0.2))
    assert covered == pytest.approx(0.95, abs=0.005) and width == pytest.approx(2.0 * 1.96 * 0.2)
    assert score == pytest.approx(4.67 * 0.2, rel=0.02)  # of a normal distribution
    for wrong in (0.1, 0.4):
        worse = bench_accuracy.interval_score(error, np.full(len(error), wrong))
        assert worse[2] > 1.1 * score


@pytest.mark.long
def test_pictures_are_drawn_and_leave_the_constants_alone(tmp_path):
    pytest.importorskip('matplotlib')
    from docs.tools import edge_adaptive_figures as figures
    from estimator_pkg.observers.angle.edge import constants, observer

    def values():
        found = {name: getattr(constants, name) for name in figures.CONSTANTS}
        return found, observer.interval

    before = values()
    for path in figures.draw(tmp_path, ('edge', 'beat')):
        assert path.stat().st_size > 10_000
    assert values() == before


@pytest.mark.parametrize('seed', range(30))
def test_no_stream_breaks_it(seed):
    """Any quantum, noise, speed, sample times and outliers: finite numbers, a valid covariance."""
    random = np.random.default_rng(seed)
    count = 400
    quantum = 10.0 ** random.uniform(-6.0, -1.0)
    t = np.cumsum(np.where(random.random(count) < 0.1, 10.0 ** random.uniform(-5.0, -1.0), DT))
    angle = 10.0 ** random.uniform(-4.0, 3.0) * t + random.normal(
        size=count
    ) * 10.0 ** random.uniform(-6.0, -1.0)
    angle = np.floor(angle / quantum) * quantum
    struck = random.random(count) < 0.03
    angle[struck] += random.normal(size=struck.sum()) * 10.0 ** random.uniform(-3.0, 1.0)
    angle[200:240] = angle[200]
    given = float(random.choice([0.0, quantum, 4.0 * quantum, quantum / 8.0]))
    one = make('edge_adaptive', {'quantum': given})
    for stamp, value in zip(
        (np.rint(t * 1e9).astype(np.int64) + 10**18).tolist(), wrapped(angle).tolist()
    ):
        one.update(stamp, value)
        assert all(math.isfinite(number) for number in one.estimate())
        sigma = one.stddev()
        assert min(sigma) > 0.0
        if given > 0.0 or one._track[6][5][1] < one._track[6][5][2]:  # a step was seen
            assert max(sigma) < math.inf
        variances = one._track[6][1]
        assert min(variances[0], variances[3], variances[5]) >= 0.0


# ---------------------------------------------------------------- anything at all


def wild(seed):
    """(stamps, readings, gains, wrap period) of a stream that nobody would record."""
    r = np.random.default_rng(seed)
    count = 200
    period = float(r.choice([2.0 * math.pi, 0.0, 1e6, 1.0]))
    unit = period if 0.0 < period < 1e5 else 1.0
    quantum = unit * 10.0 ** r.uniform(-8.0, -1.0)
    steps = [
        10.0 ** r.uniform(-6.0, 0.0, count),
        np.full(count, 10.0 ** r.uniform(-4.0, 0.0)),
        10.0 ** r.uniform(-4.0, -1.0) * (1.0 + r.uniform(-0.4, 0.4, count)),
    ][r.integers(3)]
    at = 10**18 + np.cumsum(np.maximum(np.rint(steps * 1e9), 1.0)).astype(np.int64)
    t = (at - at[0]) * 1e-9
    speed = unit * 10.0 ** r.uniform(-6.0, 4.0)
    angle = speed * t * r.choice([-1.0, 0.0, 1.0]) + speed * np.sin(10.0 ** r.uniform(-2, 3) * t)
    angle = np.floor(angle / quantum) * quantum
    if period > 0.0:
        angle = (angle + 0.5 * period) % period - 0.5 * period
    given = {'quantum': min(10.0, quantum * 10.0 ** r.uniform(-2.0, 2.0))} if r.integers(2) else {}
    return at, angle, given, period


def test_no_stream_makes_it_fail_or_say_what_is_no_number():
    """After a start the speed may be 10^10 times as uncertain as the angle: nothing may cancel."""
    for seed in range(60):
        at, angle, given, period = wild(seed)
        out = make('edge_adaptive', given, wrap_period=period).run(at, angle)
        used = out.verdict == 0
        assert np.count_nonzero(used) > 100
        assert np.all(np.isfinite(out.velocity[used])), seed
        assert np.all(out.velocity_stddev[used] >= 0.0), seed


# ---------------------------------------------------------------- faults that strangers found


def half_turns(count=4000):
    """(time [s], angle [rad], velocity [rad/s]) of a joint that rests for 1 s and then swings."""
    t = np.arange(count) * DT
    moving = t >= 1.0
    return (
        t,
        np.where(moving, 1.5 * (1.0 - np.cos(np.pi * (t - 1.0))), 0.0),
        np.where(moving, 1.5 * np.pi * np.sin(np.pi * (t - 1.0)), 0.0),
    )


def error_of(reading, velocity, at=None, **settings):
    """(rms, largest) error of the velocity [rad/s]."""
    gains = settings.pop('gains')
    out = make('edge_adaptive', gains, **settings).run(
        stamps(len(reading)) if at is None else at, reading
    )
    error = out.velocity - velocity
    return rms(error), float(np.max(np.abs(error)))


RESIDUES = {
    'random at rest': lambda size, rest, noise: np.where(rest, size * noise, 0.0),
    'random always': lambda size, rest, noise: size * noise,
    'alternating': lambda size, rest, noise: size * (np.arange(len(noise)) % 2),
    'one reading': lambda size, rest, noise: np.where(np.arange(len(noise)) == 500, size, 0.0),
}


@pytest.mark.long
@pytest.mark.parametrize('kind', RESIDUES)
@pytest.mark.parametrize('base', [0.0, 0.7])
def test_float_residue_is_not_taken_for_the_quantum(kind, base):
    t, angle, velocity = half_turns()
    clean = wrapped(np.floor(angle / QUANTUM) * QUANTUM + np.floor(base / QUANTUM) * QUANTUM)
    noise = np.random.default_rng(5).normal(size=len(t))
    for gains in ({'quantum': QUANTUM}, {}):
        twin = error_of(clean, velocity, gains=gains)
        for size in (1e-310, 1e-17, 1e-12, 1e-9, 1e-7):
            reading = clean + RESIDUES[kind](size, t < 1.0, noise)
            found = error_of(reading, velocity, gains=gains)
            assert max(found[0] / twin[0], found[1] / twin[1]) <= 1.05, (gains, size)


def test_float32_readings_and_prismatic_residue_are_no_quantum():
    t, angle, velocity = half_turns()
    clean = np.floor(angle / QUANTUM) * QUANTUM
    noise = np.random.default_rng(5).normal(size=len(t))
    offset = np.float32(1.2345)
    for gains in ({'quantum': QUANTUM}, {}):
        twin = error_of(clean, velocity, gains=gains, wrap_period=0.0)
        for reading in (
            clean.astype(np.float32).astype(float),
            clean + 1e-12 * noise,
            ((clean.astype(np.float32) + offset) - offset).astype(float),
        ):
            found = error_of(reading, velocity, gains=gains, wrap_period=0.0)
            assert max(found[0] / twin[0], found[1] / twin[1]) <= 1.05


@pytest.mark.parametrize('turned', [1e3, 1e5])
@pytest.mark.parametrize('rate', [50, 1000])
@pytest.mark.parametrize('quantum', [QUANTUM, 1e-9])
def test_a_wheel_that_has_turned_far_is_estimated_as_a_near_one(turned, rate, quantum):
    """A millionth of 1e5 rad is 66 counts: it rested for 1 s, and read 0.27 rad/s."""
    t = np.arange(8 * rate) / rate
    velocity = np.interp(t, [1.0, 2.0, 4.0, 4.5], [0.0, 1.0, 1.0, 0.0])
    angle = np.cumsum(velocity) / rate
    at, errors = stamps(len(t), 1.0 / rate), []
    for offset in (10.0, turned):
        reading = (np.floor(angle / quantum) + np.rint(offset / quantum)) * quantum
        errors.append(make('edge_adaptive').run(at, reading).velocity - velocity)
    assert rms(errors[1]) < 1.05 * rms(errors[0])


def delayed(t, every, delay, burst):
    """Stamps [ns], each `every`-th late by `delay` [s], those behind it pushed on (or one only)."""
    late = t.copy()
    for k in range(every // 2, len(t) - 20, every):
        late[k] += delay
        last = k + (20 if burst else 1)
        for j in range(k + 1, last + 1):
            late[j] = max(late[j], late[j - 1] + 1e-4) if burst else late[j - 1] + 1e-4
    return stamps(1)[0] + np.rint(late * 1e9).astype(np.int64)


@pytest.mark.long
@pytest.mark.parametrize('delay', [1e-3, 2e-3, 4e-3])
@pytest.mark.parametrize('burst', [True, False])
@pytest.mark.parametrize('known', [True, False])
def test_a_late_stamp_is_no_motion(delay, burst, known):
    quantum, rate = 3.8e-4, 667.0
    t = np.arange(int(8.0 * rate)) / rate
    w = 2.0 * math.pi * 0.8
    reading, velocity = read(4.0 * np.sin(w * t), quantum), 4.0 * w * np.cos(w * t)
    at = delayed(t, 500, delay, burst)
    error = {}
    for name in ('edge_adaptive', 'kalman'):
        gains = {'quantum': quantum} if known or name == 'kalman' else {}
        out = make(name, gains).run(at, reading)
        used = (t > 1.0) & (out.verdict < 5)
        error[name] = (out.velocity - velocity)[used]
    assert np.max(np.abs(error['edge_adaptive'])) < 0.2  # it was 176 rad/s
    assert rms(error['edge_adaptive']) < 1.1 * rms(error['kalman'])


def randomly_late(t, random, delay, jitter):
    """Stamps [s], one in 300 late by half of `delay` to all of it, those behind it pushed on."""
    late = t + random.uniform(-jitter, jitter, len(t))
    late[random.random(len(t)) < 1.0 / 300.0] += random.uniform(0.5, 1.0) * delay
    for k in range(1, len(t)):
        late[k] = max(late[k], late[k - 1] + 1e-4)
    return late


@pytest.mark.long
@pytest.mark.parametrize('jitter', [0.0, 0.02])
@pytest.mark.parametrize('delay', [1.5, 3.0])
@pytest.mark.parametrize(
    'rate, way, frequency, counts',
    [
        (200.0, 4.0, 0.8, 4096),
        (200.0, 10.0, 2.0, 2**17),
        (400.0, 2.0, 1.3, 10_000),
        (1000.0, 4.0, 0.8, 2**17),
        (1000.0, 10.0, 2.0, 4096),
    ],
)
def test_late_stamps_at_random_cost_little(rate, way, frequency, counts, delay, jitter):
    """Beside the same stream without them; delay and jitter in sample times."""
    random = np.random.default_rng(round(rate + counts + 10.0 * delay))
    quantum = 2.0 * math.pi / counts
    t = np.arange(int(6.0 * rate)) / rate
    w = 2.0 * math.pi * frequency
    reading = read(way * np.sin(w * t), quantum)
    seed = random.integers(1 << 30)
    error = []
    for late in (0.0, delay):
        at = randomly_late(t, np.random.default_rng(seed), late / rate, jitter / rate)
        out = make('edge_adaptive', {'quantum': quantum}).run(
            stamps(1)[0] + np.rint(at * 1e9).astype(np.int64), reading
        )
        used = (t > 1.0) & (out.verdict < 5)
        # where the joint turns round, the reading fits the time of a late stamp as well as its own
        error.append(
            np.min([np.abs(out.velocity - way * w * np.cos(w * time)) for time in (t, at)], axis=0)[
                used
            ]
        )
    assert rms(error[1]) < 1.5 * rms(error[0])
    assert np.max(error[1]) < 10.0


@pytest.mark.parametrize('first', [1, 2, 3, 5])
def test_a_late_stamp_at_the_start_sets_no_pace(first):
    """Of the first sample times one is 0.1 ms: it is not the usual one of 2.5 ms."""
    t = np.arange(2400) / 400.0
    w = 2.6 * math.pi
    at = t.copy()
    at[first] += 2.4e-3
    out = run(2.0 * np.sin(w * t + 0.4), stamps(1)[0] + np.rint(at * 1e9).astype(np.int64))
    assert rms((out.velocity - 2.0 * w * np.cos(w * t + 0.4))[400:]) < 0.2


@pytest.mark.parametrize('late', [1e-3, 2e-3])
def test_a_stamp_that_is_late_by_a_whole_sample_is_no_motion(late):
    """The next sample comes 0.1 ms later: whatever sways in it is not divided by so little."""
    t = np.arange(8000) * DT
    w = 0.4 * math.pi
    out = run(30.0 * np.sin(w * t), delayed(t, 500, late, True))
    assert np.max(np.abs(out.velocity - 30.0 * w * np.cos(w * t))[1000:]) < 0.5  # 9.6 and 18


@pytest.mark.parametrize(
    'speed, constant', [(0.3, None), (10.0, None), (100.0, None), (10.0, 0.05), (100.0, 0.02)]
)
@pytest.mark.parametrize('rate', [200.0, 1000.0])
def test_a_given_quantum_is_no_worse_where_a_joint_starts_with_a_jump(speed, constant, rate):
    """At once, or as a motor: what was found is at most 5 % better than what was given."""
    t = np.arange(int(2.0 * rate)) / rate
    since = np.clip(t - 0.5003, 0.0, None)
    if constant is None:
        angle, velocity = speed * since, np.where(since > 0.0, speed, 0.0)
    else:
        velocity = speed * (1.0 - np.exp(-since / constant))
        angle = speed * since - constant * velocity
    reading = read(angle + 0.3 * QUANTUM)
    given, found = (
        error_of(reading, velocity, stamps(len(t), 1.0 / rate), gains=gains)[0]
        for gains in ({'quantum': QUANTUM}, {})
    )
    assert given <= 1.05 * found


def jump(speed, constant, rate, counts, phase, offset):
    """(reading, velocity, quantum) of a joint that rests for 0.5 s, then turns at `speed`.

    At once, or as a motor with a time `constant` [s]; `phase` of a sample, `offset` of a count.
    """
    quantum = 2.0 * math.pi / counts
    t = np.arange(int(0.5 * rate) + 400) / rate
    since = np.clip(t - 0.5 - phase / rate, 0.0, None)
    if constant is None:
        angle, velocity = speed * since, np.where(since > 0.0, speed, 0.0)
    else:
        velocity = speed * (1.0 - np.exp(-since / constant))
        angle = speed * since - constant * velocity
    return read(angle + offset * quantum, quantum), velocity, quantum


@pytest.mark.long
@pytest.mark.parametrize('counts', [512, 4096, 65536])
@pytest.mark.parametrize('rate', [200.0, 1000.0, 4000.0])
def test_a_found_quantum_is_no_worse_where_a_joint_starts_with_a_jump(rate, counts):
    """Found and given differ by at most 5 % where the first changes of the reading show it."""
    random = np.random.default_rng(counts + round(rate))
    compared = 0
    for speed in (0.3, 3.0, 10.0, 30.0, 100.0):
        for constant in (None, None, 0.05):
            phase, offset = random.random(2)
            reading, velocity, quantum = jump(speed, constant, rate, counts, phase, offset)
            first = np.max(np.abs(np.diff(reading)[: int(0.5 * rate) + 2]))
            if speed > rate or (constant is not None and first > 1.5 * quantum):
                continue  # a motor that skips counts shows the quantum later
            given, found = (
                error_of(reading, velocity, stamps(len(reading), 1.0 / rate), gains=gains)[0]
                for gains in ({'quantum': quantum}, {})
            )
            assert 0.95 < given / found < 1.05, (speed, constant, phase, offset)
            compared += 1
    assert compared >= 8


@pytest.mark.parametrize('counts, rate, speed', [(4096, 1000.0, 10.0), (65536, 200.0, 10.0)])
def test_once_found_a_quantum_is_worth_what_a_given_one_is(counts, rate, speed):
    """A joint starts at once, and skips counts: from the third reading that moves on."""
    ratios = []
    for phase in (0.07, 0.37, 0.67, 0.97):
        reading, velocity, quantum = jump(speed, None, rate, counts, phase, 7.0 * phase % 1.0)
        first = int(np.argmax(reading != reading[0]))
        errors = [
            make('edge_adaptive', gains)
            .run(stamps(len(reading), 1.0 / rate), reading)
            .velocity[first + 2 :]
            - velocity[first + 2 :]
            for gains in ({'quantum': quantum}, {})
        ]
        ratios.append(rms(errors[0]) / rms(errors[1]))
    assert min(ratios) > 0.95 and max(ratios) < 1.05  # it was 0.68 to 1.5


def test_a_finer_step_in_noise_leaves_the_bandwidth():
    """Of floats in noise any step may be the finest yet: an error of 0.04 rad/s for 8 readings."""
    stream = next(each for each in streams(0.0) if each.name == '10 Hz, slow sine, noise')
    out = make('edge_adaptive').run(stream.samples.stamps, stream.samples.angle)
    assert np.max(np.abs(out.velocity - stream.samples.velocity)[30:]) < 0.02


def test_smooth_multiples_of_one_step_are_floats():
    """At 100 Hz a ramp of 10 rad/s^2 moves by multiples of 0.5 mrad, which is no quantum."""
    name = '100 Hz, point to point, floats'
    stream = next(each for each in streams(0.0) if each.name == name)
    one = make('edge_adaptive', {})
    one.run(stream.samples.stamps, stream.samples.angle)
    assert one.state[3][0] < 1e-5  # 5e-4 before


def test_a_motor_that_skips_counts_is_no_stream_of_floats():
    """Its first steps are no multiples of each other, and smooth; later ones show the counter."""
    reading, _, quantum = jump(30.0, 0.02, 1000.0, 65536, 0.3, 0.4)
    one = make('edge_adaptive', {})
    for stamp, value in zip(stamps(len(reading), 1e-3).tolist(), wrapped(reading).tolist()):
        one.update(stamp, value)
    assert one._track[6][3][0] == pytest.approx(quantum, rel=1e-6)  # it was 0.03 of it


@pytest.mark.parametrize('known', [True, False])
@pytest.mark.parametrize('speed, rate, counts', [(10.0, 1000.0, 4096), (30.0, 4000.0, 65536)])
def test_a_jump_is_neither_noise_nor_vibration(speed, rate, counts, known):
    """From the tenth reading on; without a start behind it this is the noise of the counts."""
    errors = []
    for phase in np.arange(10) / 10.0 + 0.03:
        reading, velocity, quantum = jump(speed, None, rate, counts, phase, 7.0 * phase % 1.0)
        first = int(np.argmax(reading != reading[0]))
        out = make('edge_adaptive', {'quantum': quantum} if known else {}).run(
            stamps(len(reading), 1.0 / rate), reading
        )
        errors.append((out.velocity - velocity)[first + 10 : first + 100])
    assert rms(errors) < 0.05 * quantum * rate  # it was 0.2 to 0.41


STARTS = {
    'steps': lambda t: profiles.steps(8.0, 40.0, 0.5)(t),
    'trapezoid': lambda t: profiles.trapezoid(10.0, 50.0, 1.0)(t),
    'trapezoid at once': lambda t: profiles.trapezoid(10.0, 0.0, 0.5)(t),
    'slow': lambda t: profiles.trapezoid(1.0, 2.0, 1.0)(t),
    'sine': lambda t: profiles.sine(5.0, 0.3)(t),
    'slow sine': lambda t: profiles.sine(0.1, 0.3)(t),
    'constant': lambda t: profiles.constant(10.0)(t),
    'chirp': lambda t: profiles.chirp(5.0, 0.3, 5.0, 20.0)(t),
    'figure 4': lambda t: profiles.figure_4()(t),
    'figure 6': lambda t: profiles.figure_6(0.15)(t),
}


@pytest.mark.long
@pytest.mark.parametrize('known', [True, False])
@pytest.mark.parametrize('name', STARTS)
def test_sigma_covers_every_start_from_the_first_changed_reading_on(name, known):
    for phase in (0.0, 0.3e-3, 0.77e-3):
        t = np.arange(5000) * DT
        angle, velocity, _ = STARTS[name](t + phase)
        reading = read(angle)
        out = make('edge_adaptive', {'quantum': QUANTUM} if known else {}).run(
            stamps(len(t)), reading
        )
        assert np.min(out.velocity_stddev[1:]) > 0.0
        changed = np.diff(reading, prepend=reading[0]) != 0.0
        moving = velocity != 0.0
        for start in np.flatnonzero(moving & ~np.roll(moving, 1) | (moving & (t == 0.0))):
            first = start + np.argmax(changed[start:])
            span = slice(first, start + 200)
            shown = (out.status[span] == TRACKING) | (out.status[span] == COASTING)
            error = np.abs(out.velocity - velocity)[span][shown]
            assert np.all(error < 5.0 * out.velocity_stddev[span][shown]), (phase, t[start])


def test_without_a_quantum_nothing_is_known_until_the_first_step():
    one = make('edge_adaptive')
    out = one.run(stamps(600), np.where(np.arange(600) < 500, 0.0, QUANTUM))
    assert np.all(np.isinf(out.velocity_stddev[:500])) and np.all(out.velocity[:500] == 0.0)
    assert np.all(np.isfinite(out.velocity_stddev[500:]))
    assert np.all(out.status[10:] == TRACKING)
    # a count, and six sigma of the edges' blur, in the time since it came
    assert out.velocity_stddev[520] <= 1.19 * QUANTUM / (20 * DT)


@pytest.mark.parametrize('gains', [{}, {'quantum': QUANTUM}])
def test_a_first_edge_after_lost_samples_is_no_sure_speed(gains):
    """One count after a rest, 50 samples of which were lost: sigma was a sixth of the error."""
    t = np.concatenate([np.arange(1000), np.arange(1050, 3000)]) * DT
    at = 10**9 + np.rint(t * 1e9).astype(np.int64)
    out = make('edge_adaptive', gains).run(at, np.where(t < 1.0, 0.0, QUANTUM))
    assert np.all(np.abs(out.velocity) <= 2.0 * out.velocity_stddev)


@pytest.mark.parametrize('quantum', [QUANTUM, 2e-5])
@pytest.mark.parametrize('gap', [0.21, 0.3, 0.45])
@pytest.mark.parametrize('after', [0.0, 8.0, -8.0])
def test_after_a_gap_sigma_covers_a_joint_that_stands(quantum, gap, after):
    t = np.concatenate([np.arange(2000) * DT, 2.0 + gap + np.arange(300) * DT])
    angle = np.where(t < 2.0, 8.0 * t, 16.0 + 0.3 * quantum + after * (t - t[2000]))
    at = stamps(1)[0] + np.rint(t * 1e9).astype(np.int64)
    for gains in ({'quantum': quantum}, {}):
        out = make('edge_adaptive', gains).run(at, read(angle, quantum))
        error = np.abs(out.velocity - after)[2000:]
        assert np.all(error < 3.0 * out.velocity_stddev[2000:])


def test_noise_at_a_start_is_no_vibration():
    """At rest in noise of three quanta, quantum given: few third differences last by chance."""
    random = np.random.default_rng(4)
    reading = np.rint(3.0 * random.standard_normal(1500)) * QUANTUM
    out = make('edge_adaptive', {'quantum': QUANTUM}).run(stamps(1500, 2e-3), reading)
    assert np.sqrt(np.mean(out.velocity[500:] ** 2)) < 0.02


def test_a_start_whose_second_stamp_comes_too_soon_begins_again():
    """0.1 ms after the first, and the next 0.9 and 2 ms later: it was 1649 rad/s at 11 rad/s."""
    quantum = 2.0 * math.pi / 4096
    time = np.arange(200) * 2e-3
    at = 10**9 + np.rint(1e9 * (time + np.where(np.arange(200) == 0, 3e-3, 0.0))).astype(np.int64)
    at[1] += 1_100_000
    read = np.floor(1.2 * np.sin(3.0 * math.pi * time) / quantum) * quantum
    joint = make('edge_adaptive', {'quantum': quantum})
    velocity = joint.run(at, read).velocity
    assert np.max(np.abs(velocity[3:])) < 20.0


@pytest.mark.parametrize('counts', [4, 6, 7])
@pytest.mark.parametrize('given', [False, True])
def test_a_turn_of_few_counts_is_followed(counts, given):
    """Each count is further than the eighth of a turn beyond which no reading is believed."""
    quantum = 2.0 * math.pi / counts
    time = np.arange(3000) * 1e-3
    for speed in (5.0, -20.0):
        read = wrapped(np.floor((speed * time + 0.1) / quantum) * quantum)
        joint = make('edge_adaptive', {'quantum': quantum} if given else {})
        out = joint.run(stamps(len(time)), read, fast=False)
        assert out.velocity[2000:] == pytest.approx(speed, rel=0.05)
        assert set(out.status[2000:]) == {TRACKING}
