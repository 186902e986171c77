# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The edge-aware adaptive observer: motion, noise, glitches, starts and what it is sure of."""

import math

import numpy as np
import pytest
from edge_encoder import DT, QUANTUM, joint, read, rms, run
from observer_cases import make, stamps, wrapped

from estimator_pkg.estimate import COASTING, TRACKING
from estimator_pkg.sensor.guard import REPEATED_READING


@pytest.mark.parametrize('counts', [1.01, 0.99, 0.51, 0.335, 1.49, 100.02, 130.67, 20.26])
def test_a_beat_of_speed_and_sampling_is_not_taken_for_motion(counts):
    speed = counts * QUANTUM / DT
    out = run(speed * np.arange(5000) * DT + 0.4e-3)
    assert rms(out.velocity[2000:] - speed) < 2e-3  # a limit cycle has 0.05 to 0.09


def test_readings_that_repeat_a_pattern_do_not_make_it_too_sure():
    """At these counts per sample the innovations soon are far smaller than foreseen, but they are
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
    """A slow sine long after a manoeuvre: not all intervals may cover, they are 95 % ones."""
    w = math.pi
    t = DT * np.arange(40000)
    out = run(-5.0 / w * np.cos(w * t))
    covered = np.abs(out.velocity - 5.0 * np.sin(w * t)) < 1.96 * out.velocity_stddev
    assert 0.93 < np.mean(covered[20000:]) < 0.985


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


@pytest.mark.long
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
    assert math.sqrt(one.state.sensor.noise) == pytest.approx(noise * QUANTUM, rel=0.35)


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


@pytest.mark.parametrize('speed', [0.0, 1.0, -100.0, 1000.0, -2000.0, 3000.0, 3100.0])
def test_a_cold_start_locks(speed):
    out = run(speed * np.arange(400) * DT)
    assert abs(out.velocity[50] - speed) < 0.05
    assert np.all(out.status[20:] == TRACKING)


@pytest.mark.parametrize('speed', [2.0, 20.0, 200.0])
def test_a_stream_that_repeats_every_second_reading_is_followed(speed):
    measured = read(speed * np.arange(4000) * DT)
    measured[1::2] = measured[::2]
    out = joint().run(stamps(4000), measured)
    assert np.all(out.verdict[1501::2] == REPEATED_READING)
    assert np.all(np.abs(out.velocity[1500::2] - speed) < 0.01 * speed)


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


@pytest.mark.long
def test_no_stream_makes_it_fail_or_say_what_is_no_number():
    """After a start the speed may be 10^10 times as uncertain as the angle: nothing may cancel."""
    for seed in range(60):
        at, angle, given, period = wild(seed)
        out = make('edge_adaptive', given, wrap_period=period).run(at, angle)
        used = out.verdict == 0
        assert np.count_nonzero(used) > 100
        assert np.all(np.isfinite(out.velocity[used])), seed
        assert np.all(out.velocity_stddev[used] >= 0.0), seed


def test_without_a_quantum_nothing_is_known_until_the_first_step():
    one = make('edge_adaptive')
    out = one.run(stamps(600), np.where(np.arange(600) < 500, 0.0, QUANTUM))
    assert np.all(np.isinf(out.velocity_stddev[:500])) and np.all(out.velocity[:500] == 0.0)
    assert np.all(np.isfinite(out.velocity_stddev[500:]))
    assert np.all(out.status[10:] == TRACKING)
    # four times a count, and six sigma of the edges' blur, in the time since it came
    assert out.velocity_stddev[520] <= 4.0 * 1.19 * QUANTUM / (20 * DT)


@pytest.mark.parametrize('gains', [{}, {'quantum': QUANTUM}])
def test_a_first_edge_after_lost_samples_is_no_sure_speed(gains):
    """One count after a rest, 50 samples of which were lost: sigma was a sixth of the error."""
    t = np.concatenate([np.arange(1000), np.arange(1050, 3000)]) * DT
    at = 10**9 + np.rint(t * 1e9).astype(np.int64)
    out = make('edge_adaptive', gains).run(at, np.where(t < 1.0, 0.0, QUANTUM))
    assert np.all(np.abs(out.velocity) <= 2.0 * out.velocity_stddev)


@pytest.mark.parametrize('counts_per_s', [1.37, 3.37, 10.37])
def test_an_edge_that_does_not_come_puts_the_speed_in_doubt(counts_per_s):
    at, speed = np.arange(23000) * DT, counts_per_s * QUANTUM
    out = run(speed * np.minimum(at, 20.0))
    due = 20.0 + (1.0 - (20.0 * counts_per_s) % 1.0) / counts_per_s  # until then nobody can know
    late = (at > due) & (np.abs(out.velocity) > 5.0 * out.velocity_stddev)
    assert np.count_nonzero(late) * DT < 0.45 / counts_per_s
    steady = out.velocity_stddev[(at > 18.0) & (at < 20.0)]
    assert np.median(steady) < 0.03 * speed


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


@pytest.mark.parametrize(
    'amplitude, hertz', [(0.5, 0.4), (1.0, 0.25), (1.0, 0.3), (1.0, 0.4), (2.0, 0.25), (2.0, 0.3)]
)
def test_a_joint_at_2_hz_is_tracked(amplitude, hertz):
    """The speed changes by more than an eighth of a turn in a sample: two of six never tracked."""
    angle = amplitude * np.sin(math.tau * hertz * 0.5 * np.arange(80))
    out = run(angle, stamps(80, 0.5))
    assert np.all(out.status[30:] == TRACKING)
