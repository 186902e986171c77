# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The library, `VelocityEstimator`: the driver's estimates by name, bit for bit, without ROS."""

import copy
import math
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import estimator_pkg
from estimator_pkg import (
    Estimate,
    EstimateArrays,
    UsageError,
    VelocityEstimator,
    differentiate,
    observers,
)
from estimator_pkg.driver import joint as driver
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import STATUS_NAMES

PAGE = Path(__file__).resolve().parent.parent / 'docs/library.md'
QUANTUM = 2.0 * math.pi / 4096.0
ANGLE_OBSERVERS = observers.of_kind('angle')
KNOWN = ', '.join(ANGLE_OBSERVERS)
TIME = np.arange(600) * 2e-3  # [s]


def samples(count=600, rate=500.0, period=2.0 * math.pi):
    """Stamps [ns] and a wrapped, quantised angle [rad] of a swing, with every kind of fault."""
    time = np.arange(count) / rate
    stamps = 10**9 + np.round(time * 1e9).astype(np.int64)
    angle = 4.0 * np.sin(5.0 * time)
    angle = np.floor(angle / QUANTUM) * QUANTUM
    if period:
        angle = (angle + 0.5 * period) % period - 0.5 * period
    stamps[50] = stamps[49]  # duplicate
    stamps[80] = stamps[70]  # late
    angle[100] = math.nan  # not finite
    stamps[120] = 0  # no stamp
    stamps[300:] += 10**9  # an outage
    stamps[450:] -= 3 * 10**9  # a clock that jumps back
    return stamps, angle


def same(found, wanted):
    """Equal to the last bit, NaN included."""
    return np.array_equal(np.asarray(found, float), np.asarray(wanted, float), equal_nan=True)


def stack(estimates):
    """Estimates as arrays."""
    return EstimateArrays(*(np.array(column) for column in zip(*estimates)))


def assert_same_arrays(found, wanted):
    for name, one, other in zip(EstimateArrays._fields, found, wanted):
        if one.dtype.kind == 'U' or one.dtype.kind == 'b':
            assert one.tolist() == other.tolist(), name
        else:
            assert np.array_equal(one, other, equal_nan=one.dtype.kind == 'f'), name


@pytest.mark.parametrize('name', ANGLE_OBSERVERS)
def test_the_estimates_are_those_of_the_driver(name):
    stamps, angle = samples()
    observer = observers.find(name)
    joint = Joint(observer, *Configuration(observer, {'gap_max': 0.1}).for_joint(''))
    estimator = VelocityEstimator(name, gap_max=0.1)
    for stamp, reading in zip(stamps.tolist(), angle.tolist()):
        used = joint.update(stamp, reading)
        found = estimator.update(stamp, reading)
        assert isinstance(found, Estimate) and found.used is used
        if used:
            position, velocity, acceleration, status = joint.estimate()
            assert same(found[:6], (stamp, position, velocity, acceleration, *joint.stddev()))
            assert found.status == STATUS_NAMES[status] and found.dropped == ''
    assert (estimator.received, estimator.used) == (joint.received, joint.used)
    assert estimator.dropped == joint.dropped()
    assert {'duplicate', 'late', 'non_finite', 'zero_stamp'} <= set(estimator.dropped)
    assert estimator.why == joint.why()


@pytest.mark.parametrize('name', ANGLE_OBSERVERS)
def test_arrays_are_the_single_estimates(name):
    stamps, angle = samples()
    one_by_one, at_once = VelocityEstimator(name), VelocityEstimator(name)
    wanted = stack([one_by_one.update(stamp, reading) for stamp, reading in zip(stamps, angle)])
    # in two parts, the second of which begins with a dropped sample
    parts = [at_once.run(stamps[part], angle[part]) for part in (slice(0, 50), slice(50, None))]
    found = EstimateArrays(*(np.concatenate(pair) for pair in zip(*parts)))
    assert_same_arrays(found, wanted)
    assert at_once.dropped == one_by_one.dropped and at_once.used == int(found.used.sum())
    assert found.valid.tolist() == [each in ('tracking', 'coasting') for each in found.status]
    stamp, reading = int(stamps[-1]) + 2_000_000, float(angle[-1])
    assert repr(at_once.update(stamp, reading)) == repr(one_by_one.update(stamp, reading))


def test_a_dropped_sample_gives_the_estimate_before_it_and_the_reason():
    estimator = VelocityEstimator(quantum=QUANTUM)
    first = estimator.update(0, 0.1)
    assert first.dropped == 'zero_stamp' and first.status == 'initialising' and not first.valid
    assert math.isnan(first.velocity) and not first.used
    for i in range(1, 200):
        before = estimator.update(i * 2_000_000, 0.004 * i)
    assert before.valid and before.used and before.velocity == pytest.approx(2.0, abs=0.05)
    for stamp, reading, reason in (
        (199 * 2_000_000, 0.8, 'duplicate'),
        (198 * 2_000_000, 0.8, 'late'),
        (200 * 2_000_000, math.inf, 'non_finite'),
    ):
        again = estimator.update(stamp, reading)
        assert again == before._replace(used=False, dropped=reason)
        assert again == estimator.estimate
        assert again.stamp_ns == 199 * 2_000_000
    after = estimator.update(200 * 2_000_000, 0.8)
    assert after.used and after.velocity == pytest.approx(2.0, abs=0.05)
    assert estimator.dropped == {'zero_stamp': 1, 'duplicate': 1, 'late': 1, 'non_finite': 1}
    assert estimator.received == 204 and estimator.used == 200


def test_gains_change_live_and_the_estimate_continues():
    estimator = VelocityEstimator('hybrid_angle', bandwidth_hz=20.0, quantum=QUANTUM)
    for i in range(1, 300):
        before = estimator.update(i * 2_000_000, 0.004 * i)
    estimator.set(bandwidth_hz=5.0, gap_max=0.05)
    assert estimator.parameters['bandwidth_hz'] == 5.0 and estimator.parameters['gap_max'] == 0.05
    assert estimator.parameters['quantum'] == QUANTUM
    after = estimator.update(300 * 2_000_000, 1.2)
    assert after.status == 'tracking'
    assert after.velocity == pytest.approx(before.velocity, abs=0.05)
    assert after.velocity_stddev < before.velocity_stddev


def test_what_cannot_be_set_changes_nothing():
    estimator = VelocityEstimator('hybrid_angle', form='paper', bandwidth_hz=1.0)
    for i in range(1, 300):
        estimator.update(i * 20_000_000, 0.0)
    before = estimator.parameters
    for change, said in (
        ({'bandwith_hz': 5.0}, "did you mean 'bandwidth_hz'"),
        ({'bandwidth_hz': -5.0}, 'outside'),
        ({'unwrap': True}, "'unwrap' is structural"),
        ({'wrap_period': 0.0}, "'wrap_period' is structural"),
        ({'gap_max': 0.1, 'bandwidth_hz': 1000.0}, 'Hz'),
    ):
        with pytest.raises(UsageError, match=said):
            estimator.set(**change)
        assert estimator.parameters == before
    assert estimator.update(300 * 20_000_000, 0.0).valid


@pytest.mark.parametrize(
    ('words', 'parameters', 'said'),
    [
        (('hybrid_angel',), {}, "did you mean 'hybrid_angle'"),
        (('hybrid_angle',), {'bandwidth_hz': math.nan}, 'must be finite'),
        ((), {'bandwidth_hz': 20.0}, "does not: use observer='hybrid_angle'"),
        ((), {'observer': 'hybrid_angel'}, "did you mean 'hybrid_angle'"),
        (('pmsm',), {}, f'needs more inputs than an angle: use its node or one of {KNOWN}'),
        (('pmsn',), {}, f"unknown observer 'pmsn': known: {KNOWN}"),
        ((3,), {}, f"unknown observer '3': known: {KNOWN}"),
    ],
)
def test_errors_when_it_is_made(words, parameters, said):
    with pytest.raises(UsageError, match=re.escape(said)):
        VelocityEstimator(*words, **parameters)


@pytest.mark.parametrize(
    ('stamp', 'reading'),
    [
        (1.5, 0.0),
        (None, 0.0),
        ('1', 0.0),
        (2**63, 0.0),
        (-(2**63), 0.0),
        (1, None),
        (1, 'a'),
        (1, (0.0,)),
        (1, 1j),
        (1, 10**400),
    ],
)
def test_a_sample_that_is_no_sample_is_refused(stamp, reading):
    estimator = VelocityEstimator()
    with pytest.raises(UsageError, match='integer stamp') as found:
        estimator.update(stamp, reading)
    assert estimator.received == 0
    [remedy] = re.findall(r'\w+\(1e9 \* seconds\)', str(found.value))
    assert f'`{remedy}`' in PAGE.read_text()  # the page and the message give one formula


@pytest.mark.parametrize(
    ('stamps', 'angles', 'said'),
    [
        ([2**63], [0.0], '64 bits'),
        ([1e10], [0.0], '64 bits'),
        (np.array(['9999-01-01'], 'datetime64[D]'), [0.0], '64 bits'),
        ([1, 2], [0.0], 'the shape'),
        (1, 0.0, 'the shape'),
        ([1], [[[0.0]]], 'the shape'),
        ([1], [[]], 'the shape'),
        (['1'], [0.0], 'times must be numbers or datetime64'),
        ([1], ['a'], 'numbers'),
        ([1, 2], [[1], [1, 2]], 'numbers'),
        (np.float32(1.7e9 + TIME), TIME, 'a resolution of 1.3e.02 s as float32'),
        (np.float32(3e3 + TIME), TIME, 'a resolution of 0.00024 s as float32'),
        (np.round(TIME, 1), TIME, '587 of 600 times equal the one before'),
    ],
)
def test_arrays_that_are_no_samples_are_refused(stamps, angles, said):
    estimator = VelocityEstimator()
    with pytest.raises(UsageError, match=said):
        estimator.run(stamps, angles)
    assert estimator.received == 0


@pytest.mark.parametrize(
    'times',
    [
        7.0 + TIME,
        np.float32(7.0 + TIME),
        np.timedelta64(7, 's') + (TIME * 1e6).round().astype('timedelta64[us]'),
    ],
    ids=['seconds', 'float32', 'timedelta'],
)
def test_times_in_other_units_give_the_same_estimates(times):
    stamps = 7 * 10**9 + (TIME * 1e9).round().astype(np.int64)
    found, wanted = (VelocityEstimator().run(each, np.sin(TIME)) for each in (times, stamps))
    assert np.abs(found.stamp_ns - stamps).max() <= (480 if times.dtype == np.float32 else 0)
    assert np.allclose(found.velocity, wanted.velocity, atol=1e-2, equal_nan=True)


def test_missing_times_and_angles_are_dropped_and_counted():
    missing, angle = np.arange(600) % 100 == 50, np.sin(TIME)
    where = np.flatnonzero(missing)
    for times, angles, reason in (
        (np.where(missing, np.nan, 1.0 + TIME), angle, 'zero_stamp'),
        (
            np.where(missing, np.datetime64('NaT'), np.arange(1, 601).astype('M8[ms]')),
            angle,
            'zero_stamp',
        ),
        (np.ma.array(1.0 + TIME, mask=missing), angle, 'zero_stamp'),
        (np.ma.array(np.arange(1, 601) * 10**6, mask=missing), angle, 'zero_stamp'),
        (1.0 + TIME, np.ma.array(angle, mask=missing), 'non_finite'),
        (1.0 + TIME, np.ma.array(np.zeros(600, int), mask=missing), 'non_finite'),
    ):
        found = VelocityEstimator().run(times, angles)
        assert np.flatnonzero(found.dropped == reason).tolist() == where.tolist()


def test_each_joint_has_an_estimator_of_its_own():
    angles = np.stack([np.sin(5.0 * TIME), np.cos(3.0 * TIME), np.full(600, np.nan)], axis=1)
    estimator = VelocityEstimator('kalman', quantum=QUANTUM)
    found = estimator.run(1.0 + TIME, angles)
    assert found.velocity.shape == found.valid.shape == found.stamp_ns.shape == (600, 3)
    assert estimator.received == 0
    for column, angle in enumerate(angles.T):
        alone = VelocityEstimator('kalman', quantum=QUANTUM).run(1.0 + TIME, angle)
        assert_same_arrays([each[:, column] for each in found], alone)


def test_velocities_in_one_line():
    angles = np.stack([np.sin(5.0 * TIME), np.mod(3.0 * TIME, 2.0 * math.pi)], axis=1)
    angles = np.floor(angles / QUANTUM) * QUANTUM
    true = np.stack([5.0 * np.cos(5.0 * TIME), np.full(600, 3.0)], axis=1)
    errors = []
    for smooth in (False, True):
        found = differentiate(TIME, angles, smooth=smooth)
        shifted = differentiate(TIME - 0.6, angles[:, 0], smooth=smooth)
        assert np.allclose(shifted, found[:, 0], atol=1e-5, equal_nan=True)
        assert found.shape == angles.shape and np.isnan(found).sum() < 20
        errors.append(np.nanstd(found - true, axis=0))
    live = VelocityEstimator().run(1.0 + TIME, angles[:, 0])
    found = differentiate(TIME, angles[:, 0])
    assert same(found[live.valid], live.velocity[live.valid]) and np.isnan(found[~live.valid]).all()
    assert np.all(errors[1] < 0.5 * errors[0]) and np.all(errors[0] < 0.2)
    assert same(differentiate(TIME, np.full(600, np.nan), smooth=True), np.full(600, np.nan))
    metres = differentiate(TIME, 8.0 * TIME, 'kalman', wrap_period=0.0)
    assert metres[-1] == pytest.approx(8.0)
    for words in ({'observer': 'kalman'}, {'prefer': 'fast'}):
        with pytest.raises(UsageError, match='only parameter is wrap_period'):
            differentiate(TIME, TIME, smooth=True, **words)


@pytest.mark.parametrize('name', ANGLE_OBSERVERS)
@pytest.mark.parametrize('engines', [(True, False), (False, True)])
def test_copies_continue_on_their_own(name, engines, monkeypatch):
    """deepcopy and pickle, also between a machine with the engine and one without."""
    compiled = driver.functions_of
    use = {True: compiled, False: lambda module: None}
    stamps, angle = samples(250)
    monkeypatch.setattr(driver, 'functions_of', use[engines[0]])
    estimator = VelocityEstimator(name, gap_max=0.1)
    estimator.run(stamps[:200], angle[:200])
    estimator.set(gap_max=0.15)
    monkeypatch.setattr(driver, 'functions_of', use[engines[1]])
    copies = copy.deepcopy(estimator), pickle.loads(pickle.dumps(estimator))
    wanted = estimator.run(stamps[200:], angle[200:])
    for each in copies:
        assert each.estimate != estimator.estimate and each.received == 200
        assert repr(each) == repr(estimator) and each.parameters == estimator.parameters
        assert_same_arrays(each.run(stamps[200:], angle[200:]), wanted)
        assert (each.dropped, each.why) == (estimator.dropped, estimator.why)


def test_it_needs_no_ros_and_the_package_alone_no_numpy():
    code = (
        'import sys, estimator_pkg\n'
        'assert "numpy" not in sys.modules\n'
        'from estimator_pkg import VelocityEstimator\n'
        'estimator = VelocityEstimator()\n'
        'estimator.update(1, 0.0)\n'
        'estimator.run([2, 3], [0.0, 0.0])\n'
        'found = {name.partition(".")[0] for name in sys.modules}\n'
        'print(*found & {"rclpy", "sensor_msgs", "rosbags", "mcap", "scipy"})\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ''


def test_what_is_exported():
    for name in estimator_pkg.__all__:
        assert getattr(estimator_pkg, name).__doc__
        assert name in dir(estimator_pkg)
    with pytest.raises(AttributeError, match='no attribute'):
        estimator_pkg.Velocity  # noqa: B018  reading it is the test
    assert (Path(estimator_pkg.__file__).parent / 'py.typed').is_file()
    assert Estimate._fields == EstimateArrays._fields
    assert VelocityEstimator().observer == observers.DEFAULT
    assert repr(VelocityEstimator('hybrid_angle', bandwidth_hz=20.0)) == (
        "VelocityEstimator('hybrid_angle', bandwidth_hz=20.0)"
    )


def test_the_pages_example_prints_what_the_page_says(capsys):
    blocks = re.findall(r'```(python|text)\n(.*?)```', PAGE.read_text(), re.DOTALL)
    names = {}
    assert [kind for kind, _ in blocks] == ['python', 'text'] * (len(blocks) // 2) and blocks
    for (_, code), (_, printed) in zip(blocks[::2], blocks[1::2]):
        exec(compile(code, str(PAGE), 'exec'), names)
        assert capsys.readouterr().out == printed
