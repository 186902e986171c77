# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The off-line reference, held to the table of spec 3.6 and to motions whose truth is known."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import positions
from estimator_pkg.engine import calls
from estimator_pkg.engine.calls import available
from estimator_pkg.evaluation.reference.motion import motion
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.reference.smoother.noise import Cells, ReadingNoise
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, cut, start
from estimator_pkg.evaluation.reference.smoother.smoother import smooth
from sim_pkg.reproduce.mechanical import lab

BAGS = Path(__file__).resolve().parents[3] / 'bags'
TURN = 2.0 * math.pi
HPM, LPM = lab.QUANTA.values()


def ns(seconds):
    return np.rint((np.asarray(seconds) + 1.0) * 1e9).astype(np.int64)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def encoder(axis, quanta, every):
    """(stamps, readings, true velocity, sample time) of an encoder whose zero lies anywhere."""
    offset = np.random.default_rng(0).uniform(-0.5, 0.5, 2)[axis] * quanta[axis]
    position, velocity = (each[::every, axis] for each in lab.truth('nominal')[:2])
    readings = np.floor((position + offset) / quanta[axis] + 0.5) * quanta[axis] - offset
    step = every / 224.0
    return ns(np.arange(len(position)) * step), readings, velocity, step


def inner(step):
    return slice(round(0.25 / step), -round(0.25 / step))


# spec 3.6: central difference, and white jerk by maximum likelihood
@pytest.mark.long
@pytest.mark.parametrize(
    'axis, quanta, every, central, error',
    [
        (0, HPM, 1, 0.0365451, 0.0144115),
        (1, HPM, 1, 0.00288079, 0.0017717),
        (0, LPM, 2, 0.277079, 0.0772808),
        (1, LPM, 2, 0.0240732, 0.0138253),
    ],
)
def test_the_specs_table(axis, quanta, every, central, error):
    stamps, readings, truth, step = encoder(axis, quanta, every)
    cut = inner(step)
    difference = np.gradient(readings, step) - truth
    assert rms(difference[cut]) == pytest.approx(central, rel=0.05)
    found = smooth(stamps, readings, 0.0)
    assert found.noise.quantum == pytest.approx(quanta[axis], rel=1e-3)
    assert found.noise.reading >= 0.999 * quanta[axis] / math.sqrt(12.0)
    actual = rms((found.velocity - truth)[cut])
    # where the cart's dry friction makes its acceleration jump, part of that is taken for noise
    assert actual <= (1.75 if axis and quanta is HPM else 1.1) * error
    assert 0.8 <= found.uncertainty / actual <= 1.8


@pytest.mark.long
def test_jittered_stamps_are_found_to_be_noise():
    """Rows H5: +-1 ms of jitter."""
    position, velocity = (each[:, 0] for each in lab.truth('nominal')[:2])
    time = np.arange(len(position)) / 224.0
    stamps = ns(time + np.random.default_rng(0).uniform(-1e-3, 1e-3, len(time)))
    readings = np.floor(position / HPM[0] + 0.5) * HPM[0]
    cut = inner(1.0 / 224.0)
    found = smooth(stamps, readings, 0.0)
    assert rms((found.velocity - velocity)[cut]) == pytest.approx(0.0307318, rel=0.15)
    assert found.noise.reading == pytest.approx(1.17e-3, rel=0.05)
    assert not found.noise.at_floor


def dense(stamps, readings, noise):
    """The smoothed states by one large least-squares problem, and their deviations."""
    h = np.diff(stamps) * 1e-9
    n, r = len(readings), noise.reading**2
    information, vector = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
    part = Piece(np.arange(n), np.append(0.0, h), readings)
    first = start(readings[0], r, part.speed, part.step)
    prior = np.diag([1.0 / first.p00, 1.0 / first.p11, 1.0 / first.p22])
    information[:3, :3] += prior
    vector[:3] += prior @ (readings[0], 0.0, 0.0)
    for k in range(n):
        information[3 * k, 3 * k] += 1.0 / r
        vector[3 * k] += readings[k] / r
    for k, t in enumerate(h):
        q = noise.jerk * np.array(
            [
                [t**5 / 20, t**4 / 8, t**3 / 6],
                [t**4 / 8, t**3 / 3, t**2 / 2],
                [t**3 / 6, t**2 / 2, t],
            ]
        )
        both = np.hstack([np.array([[-1, -t, -t * t / 2], [0, -1, -t], [0, 0, -1]]), np.eye(3)])
        part = slice(3 * k, 3 * k + 6)
        information[part, part] += both.T @ np.linalg.inv(q) @ both
    covariance = np.linalg.inv(information)
    return np.linalg.solve(information, vector)[1::3], np.sqrt(np.diag(covariance))[1::3]


def test_it_is_the_fixed_interval_smoother():
    random = np.random.default_rng(5)
    time = np.cumsum(random.uniform(0.01, 0.05, 30))
    readings = np.sin(3.0 * time) + 0.01 * random.standard_normal(30)
    noise = ReadingNoise(0.01, 50.0, 0.0, False)
    ours = smooth(ns(time), readings, 0.0, noise=noise)
    velocity, deviation = dense(ns(time), readings, noise)
    assert ours.velocity == pytest.approx(velocity, abs=1e-7)
    assert ours.velocity_stddev == pytest.approx(deviation, rel=1e-6)


def turning(rotation, rate, noise, quantum, seed=0, count=6000):
    """(stamps, readings, true velocity) of a shaft that turns and swings, at 200 Hz with 0.2 Hz."""
    time, swing = np.arange(count) / rate, TURN * 1e-3 * rate
    angle = rotation * time + 0.5 * np.sin(swing * time)
    angle += noise * np.random.default_rng(seed).standard_normal(count)
    if quantum:
        angle = np.round(angle / quantum) * quantum
    velocity = rotation + 0.5 * swing * np.cos(swing * time)
    return ns(time), np.mod(angle + math.pi, TURN) - math.pi, velocity


@pytest.mark.long
@settings(max_examples=20, deadline=None, derandomize=True)
@given(
    rotation=st.floats(-20.0, 20.0),
    rate=st.floats(50.0, 2000.0),
    noise=st.floats(-4.0, -2.0).map(lambda power: 10.0**power),
    quantum=st.sampled_from((0.0, *(TURN / 2**bits for bits in (8, 12, 16)))),
    seed=st.integers(0, 1000),
)
@example(1.5, 200.0, 2e-3, 0.0, 0)  # it took 0.33 rad for noise, and reported a 30th of its error
@example(10.0, 200.0, 2e-4, 0.0, 0)
def test_its_error_and_the_noise_are_those_that_it_reports(rotation, rate, noise, quantum, seed):
    stamps, readings, velocity = turning(rotation, rate, noise, quantum, seed)
    found = motion(stamps, readings, TURN)
    firm = found.firm
    true = velocity[np.searchsorted(stamps, found.stamps)]
    assert rms((found.velocity - true)[firm]) <= 1.5 * found.uncertainty
    noise = math.hypot(noise, quantum / math.sqrt(12.0))
    assert found.smoothed.noise.reading == pytest.approx(noise, rel=0.1)
    assert not found.smoothed.contradicted


@pytest.mark.long
@pytest.mark.parametrize('noise, quantum', [(2e-3, 0.0), (1e-4, TURN / 4096)])
@pytest.mark.parametrize('unit, tick', [(2.0**20, 1), (2.0**-20, 1), (1.0, 10)])
def test_every_unit_gives_the_same(noise, quantum, unit, tick):
    """Counts, micrometres and ten times the sample time: the same motion in these units."""
    stamps, readings, _ = turning(1.5, 200.0, noise, quantum)
    one = smooth(stamps, readings, TURN)
    other = smooth(tick * stamps, unit * readings, unit * TURN)
    assert other.noise.reading == pytest.approx(unit * one.noise.reading, rel=1e-6)
    assert other.noise.quantum == pytest.approx(unit * one.noise.quantum, rel=1e-6)
    assert other.velocity == pytest.approx(unit / tick * one.velocity, rel=1e-6)
    assert other.uncertainty == pytest.approx(unit / tick * one.uncertainty, rel=1e-5)


def test_wraps_and_short_holes():
    """200 rad/s, 10 % of the samples lost and a hole of 30 ms, in which it turns once."""
    random = np.random.default_rng(2)
    time = np.arange(4000) * 1e-3
    kept = (random.random(4000) > 0.1) & ~((time > 2.0) & (time < 2.03))
    angle = 200.0 * time + 3.0 * np.sin(5.0 * time)
    count = np.floor(angle / TURN * 4096.0)
    readings = ((count + 2048) % 4096 - 2048) * TURN / 4096.0
    found = smooth(ns(time[kept]), readings[kept], TURN)
    truth = (200.0 + 15.0 * np.cos(5.0 * time))[kept]
    assert rms((found.velocity - truth)[50:-50]) < 0.01
    assert rms((found.velocity - truth)[50:-50] / found.velocity_stddev[50:-50]) < 1.5


def test_outliers_and_bad_samples_are_left_out():
    time = np.arange(2000) * 2e-3
    readings = np.sin(4.0 * time)
    readings = np.round(readings / 1e-3) * 1e-3
    readings[[300, 700, 1500]] += (3.0, -2.0, 0.5)
    readings[[900, 901, 902]] = np.nan, np.inf, 4.9e259  # a bit that tipped over
    stamps = ns(time)
    stamps[1000] = stamps[999]  # repeated
    stamps[[1200, 1201]] = stamps[[1201, 1200]]  # late
    found = smooth(stamps, readings, 0.0)
    truth = 4.0 * np.cos(4.0 * ((found.stamps - 10**9) * 1e-9))
    assert found.outliers == 3
    assert np.all(np.diff(found.stamps) > 0)
    assert np.max(np.abs(found.velocity - truth)[20:-20]) < 0.08


def test_motion_within_the_motion_is_not_passed_over():
    """Chatter of 70 Hz at 300 samples a second looks like noise; its speed is reported."""
    time = np.arange(3000) / 300.0
    chatter = 5e-3 * np.sin(TURN * 70.0 * time) * (np.sin(TURN * 0.5 * time) > 0.0)
    readings = np.round((np.sin(2.0 * time) + chatter) / 2.9e-3) * 2.9e-3
    speed = np.gradient(np.sin(2.0 * time) + chatter, time)
    found = smooth(ns(time), readings, 0.0)
    actual = rms((found.velocity - speed)[75:-75])
    assert actual > 0.7
    assert rms(found.velocity_stddev) < 0.2 * actual
    assert 0.7 * actual < found.uncertainty < 1.5 * actual


@pytest.mark.skipif(not available(), reason='no engine was built')
@pytest.mark.parametrize('quantum', [0.0, TURN / 256])
def test_plain_and_compiled_are_equal(quantum, monkeypatch):
    random = np.random.default_rng(3)
    time = np.cumsum(random.uniform(0.01, 0.02, 600))
    readings = np.sin(3.0 * time) + 1e-3 * random.standard_normal(600)
    if quantum:
        readings = np.floor(readings / quantum) * quantum
    readings.flags.writeable = False
    found = smooth(ns(time), readings, TURN)
    monkeypatch.setattr(calls, 'load', lambda: (None, ''))
    plain = smooth(ns(time), readings, TURN)
    assert found.noise.cells == bool(quantum)
    assert repr(found.noise) == repr(plain.noise)
    for ours, theirs in zip(found, plain):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize('counts', [256, 4096, 65536])
def test_the_quantum_is_seen(counts):
    step = TURN / counts
    angle = np.cumsum(np.random.default_rng(0).normal(0.0, 5.0 * step, 5000))
    assert quantum(np.floor(angle / step) * step) == pytest.approx(step, rel=1e-3)
    assert quantum(angle) == 0.0
    assert quantum(np.array([0.0] * 50 + [step] * 50)) == pytest.approx(step)
    assert quantum(np.zeros(100)) == 0.0


@pytest.mark.parametrize('speed', [1.7, 13.77, 50.0, 200.1])  # [rad/s] at 1 kHz
@pytest.mark.parametrize('kind', [np.float64, np.float32])
def test_the_count_of_a_motion_at_constant_speed(speed, kind):
    step = 2.0 * math.pi / 4096
    angle = 3.0 + speed * np.arange(2000) * 1e-3
    counted = (np.floor(angle / step) * step).astype(kind).astype(float)
    assert quantum(counted) == pytest.approx(step, rel=0.01)  # and not what a sample moves
    assert quantum(angle) == 0.0
    assert quantum(angle + np.random.default_rng(1).normal(0.0, 1e-4, len(angle))) == 0.0


def test_dense_readings_have_no_count():
    random = np.random.default_rng(1)
    assert quantum(random.uniform(-3.0, 3.0, 1_000_000)) == 0.0
    assert quantum(np.cumsum(random.normal(0.0, 1e-6, 200_000))) == 0.0


# An exhaustive search (60 points of a grid, 36 of golden sections) found these: the reference's
# uncertainty, the deviation of a reading, the jerk and the blur.
EXHAUSTIVE = {
    'dfki_double_pendulum/sys_id_500hz': (0.03537, 0.00018156, 34558, 0.00014434),
    'dfki_simple_pendulum/energy_shaping_200hz': (0.42728, 0.0029098, 856.42, 0.0027856),
    'dfki_simple_pendulum/gravity_compensation_1000hz': (0.086958, 0.0011802, 15.908, 0.00082772),
    'dfki_simple_pendulum/sac_200hz_multiturn': (0.10364, 0.0014315, 645.24, 0.0011582),
    'simulated/sine_12bit': (0.0019756, 0.00044312, 20.086, 1.6157e-05),
}


@pytest.mark.long
@pytest.mark.parametrize(
    'bag',
    [
        pytest.param(bag, marks=pytest.mark.slow if 'multiturn' in bag or 'sys_id' in bag else ())
        for bag in EXHAUSTIVE
    ],
)
def test_the_quick_search_finds_what_an_exhaustive_one_finds(bag):
    with open_bag(BAGS / bag) as opened:
        series = next(iter(positions(opened, '/joint_states').values()))
    found = smooth(series.stamps_ns, series.position, TURN)
    uncertainty, reading, jerk, blur = EXHAUSTIVE[bag]
    quantum_ = found.noise.quantum
    before = smooth(
        series.stamps_ns,
        series.position,
        TURN,
        noise=ReadingNoise(reading, jerk, quantum_, False, blur),
    )
    assert before.uncertainty == pytest.approx(uncertainty, rel=1e-3)
    assert found.uncertainty == pytest.approx(uncertainty, rel=0.1)
    # the velocity is the same within a fraction of its own deviation
    assert rms(found.velocity - before.velocity) < 0.35 * rms(before.velocity_stddev)

    def logarithm(jerk, blur):
        parts = cut(series.stamps_ns, np.unwrap(series.position))
        return sum(Cells(each, quantum_).probability(blur, jerk) for each in parts)

    assert logarithm(found.noise.jerk, found.noise.blur) > logarithm(jerk, blur) - 10.0
