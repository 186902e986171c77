# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints and banks: live, in batch and compiled the same; joints that come, go, change order."""

import dataclasses
import math

import numpy as np
import pytest
from answers import valid
from observer_cases import angle_observers, label, make, stream, variants, wrapped

from estimator_pkg import observers
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.batch import Estimates
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import INITIALISING, MISCONFIGURED, STATUS_NAMES, TRACKING
from estimator_pkg.sensor.guard import USED_SAMPLE, longest_dt

MS = 1_000_000
START = 1_700_000_000_000_000_000
PAPER = {'form': 'paper', 'epsilon': 0.1}  # stable below dt = 29.666 ms


def live(joint, at, angles):
    """The joint fed sample by sample, as arrays."""
    rows = []
    for stamp, angle in zip(at.tolist(), angles.tolist()):
        if joint.update(stamp, angle):
            position, velocity, acceleration, status = joint.estimate()
            rows.append((position, velocity, acceleration, *joint.stddev(), status, joint.verdict))
        else:
            rows.append((math.nan,) * 5 + (0, joint.verdict))
    return Estimates(*(np.array(column) for column in zip(*rows)))


def assert_equal(one, other):
    for field in Estimates._fields:
        a, b = getattr(one, field), getattr(other, field)
        np.testing.assert_array_equal(a, b, err_msg=field)


@pytest.mark.parametrize('variant', variants(), ids=label)
def test_live_equals_batch(variant):
    for seed in (1, 2, 3):
        at, angles = stream(seed, 600)
        one, other = make(*variant), make(*variant)
        assert_equal(live(one, at, angles), other.run(at, angles))
        assert one.counts == other.counts and one.verdict == other.verdict
        assert one.stamp_ns == other.stamp_ns and one.mean_dt == other.mean_dt
        assert one.estimate()[:2] == other.estimate()[:2] and one.stddev() == other.stddev()
        assert one.update(one.stamp_ns + MS, 0.5) and other.update(other.stamp_ns + MS, 0.5)
        assert one.estimate()[:2] == other.estimate()[:2]  # and they go on alike


def test_before_the_first_sample():
    joint = make('kalman')
    assert joint.estimate()[3] == INITIALISING and math.isnan(joint.estimate()[1])
    assert joint.received == joint.used == 0 and joint.mean_dt == 0.0
    assert joint.dropped() == {} and joint.events() == {} and joint.why() == ''
    assert not joint.update(START, math.nan)
    assert math.isnan(joint.estimate()[1])


def test_reset_starts_again_and_counts_on():
    joint, fresh = make('kalman'), make('kalman')
    at, angles = stream(8, 400)
    joint.run(at, angles)
    joint.reset()
    assert joint.reset_count == 1 and joint.received == 400
    assert joint.estimate()[3] == INITIALISING and math.isnan(joint.estimate()[1])
    assert_equal(live(joint, at, angles), live(fresh, at, angles))
    assert joint.received == 800


def test_new_gains_act_from_the_next_sample_on():
    slow, quick = make('pll', {'bandwidth_hz': 2.0}), make('pll', {'bandwidth_hz': 50.0})
    for i in range(3000):
        for joint in (slow, quick):
            joint.update(START + i * MS, wrapped(3.0 * i * 1e-3).item())
    slow.set_gains(quick.gains)
    for i in range(3000, 3200):  # the same steps of dt, so coefficients would be kept
        for joint in (slow, quick):
            joint.update(START + i * MS, wrapped(3.0 * 3.0 + 8.0 * (i - 3000) * 1e-3).item())
    assert slow.estimate()[1] == pytest.approx(quick.estimate()[1], abs=1e-3)
    assert slow.estimate()[3] == quick.estimate()[3]


def test_a_joint_goes_on_with_new_gains_before_it_knows_its_rate():
    joint = make('kalman')
    new = make('kalman', {'bandwidth_hz': 7.0}).design
    joint.try_step(new)
    joint.update(START, 0.3)
    joint.try_step(new)
    assert joint.mean_dt == 0.0 and joint.estimate()[0] == pytest.approx(0.3)


def test_new_settings_act_from_the_next_sample_on():
    joint = make('pll')
    for i in range(500):
        joint.update(START + i * MS, 0.0)
    joint.set_settings(dataclasses.replace(joint.settings, gap_max=10.0))
    joint.update(START + 5000 * MS, 0.0)
    assert joint.verdict == USED_SAMPLE


# Gains that do not work at the measured rate


def test_longest_dt_is_where_the_limits_begin():
    assert longest_dt(lambda dt: None) == math.inf
    assert longest_dt(lambda dt: 'never') == 0.0
    assert longest_dt(lambda dt: 'too long' if dt > 0.0123 else None) == (
        pytest.approx(0.0123, rel=1e-6)
    )
    for name in angle_observers():
        if name != 'hybrid_angle':
            assert make(name).longest_dt == math.inf
    assert make('hybrid_angle').longest_dt == math.inf
    assert make('hybrid_angle', PAPER).longest_dt == pytest.approx(0.029666, rel=1e-4)


def test_misconfigured_when_the_rate_falls_and_back_when_it_recovers():
    joint = make('hybrid_angle', PAPER)
    stamp, said = START, []
    for dt, count in ((10, 300), (40, 300), (10, 400)):
        for _ in range(count):
            stamp += dt * MS
            joint.update(stamp, wrapped(2.0 * (stamp - START) * 1e-9).item())
            said.append(joint.estimate()[3])
        assert said[-1] == (TRACKING if dt == 10 else MISCONFIGURED)
        if dt == 40:
            assert STATUS_NAMES[said[-1]] == 'misconfigured' and math.isnan(joint.estimate()[1])
            assert 'unstable at 25' in joint.why() and 'epsilon' in joint.why()
    assert joint.estimate()[1] == pytest.approx(2.0, abs=1e-6)
    assert joint.used + joint.dropped()['misconfigured'] == joint.received == 1000
    assert joint.why() == ''


def test_gains_that_fit_the_rate_end_the_misconfiguration():
    joint = make('hybrid_angle', PAPER)
    for i in range(100):
        joint.update(START + i * 40 * MS, wrapped(0.04 * i).item())
    assert joint.estimate()[3] == MISCONFIGURED
    joint.set_gains(dataclasses.replace(joint.gains, epsilon=0.3))
    for i in range(100, 300):
        joint.update(START + i * 40 * MS, wrapped(0.04 * i).item())
    assert joint.estimate()[3] == TRACKING
    assert joint.estimate()[1] == pytest.approx(1.0, abs=1e-3)


# Banks


def bank(only=(), common=None, overrides=None, name='kalman'):
    return Bank(Configuration(observers.find(name), common, overrides), only)


def angle_of(joint, i):
    return wrapped({'a': 1.0, 'b': -2.0, 'c': 3.0}[joint] * i * 1e-3).item()


def test_joints_may_come_go_and_change_order():
    several = bank()
    random = np.random.default_rng(1)
    alone = {name: make('kalman') for name in 'abc'}
    for i in range(2000):
        names = [
            name
            for name in 'abc'
            if not (name == 'b' and 500 <= i < 700) and not (name == 'c' and i < 300)
        ]
        random.shuffle(names)
        stamp = START + i * MS
        found = several.update(stamp, names, [angle_of(name, i) for name in names])
        assert list(found.names) == names
        assert [name for name, _ in valid(found)] == [
            name
            for name in names
            if alone[name].update(stamp, angle_of(name, i)) and alone[name].estimate()[3] in (1, 2)
        ]
        for name, estimate in valid(found):
            assert estimate[:2] == alone[name].estimate()[:2]
    assert several.joints['b'].used == 1800 and several.joints['c'].used == 1700
    assert several.joints['a'].events() == {}
    assert several.mismatched == several.empty == 0


def test_messages_that_do_not_fit_are_counted():
    several = bank()
    assert several.update(START, ['a', 'b'], [1.0]) is None
    assert several.update(START, ['a'], [1.0, 2.0]) is None
    assert several.update(START, [], [1.0]) is None
    assert several.update(START, ['a'], []) is None
    assert several.update(START, [], []) is None
    assert several.mismatched == 3 and several.empty == 2 and several.joints == {}


def test_a_name_twice_in_one_message_is_a_duplicate():
    several = bank()
    several.update(START, ['a', 'a'], [0.1, 0.2])
    assert several.joints['a'].dropped() == {'duplicate': 1}


def test_overrides_are_per_joint():
    several = bank(
        common={'jerk_psd': 1e4, 'gap_max': 0.5},
        overrides={'b': {'jerk_psd': 10.0, 'wrap_period': 0.0}},
    )
    for name in 'ab':
        several.joint(name)
    a, b = several.joints['a'], several.joints['b']
    assert (a.gains.jerk_psd, b.gains.jerk_psd) == (1e4, 10.0)
    assert (a.settings.wrap_period, b.settings.wrap_period) == (2.0 * math.pi, 0.0)
    assert a.settings.gap_max == b.settings.gap_max == 0.5


@pytest.mark.parametrize(
    'common, overrides, words',
    [
        ({'jerk_pds': 1.0}, {}, ['jerk_pds', 'jerk_psd']),
        ({'jerk_psd': -1.0}, {}, ['jerk_psd', 'outside']),
        ({}, {'b': {'gap_mx': 1.0}}, ['gap_mx', 'gap_max']),
        ({}, {'b': {'gap_max': 'long'}}, ['gap_max', 'number']),
        ({'model': 'constant_jerk'}, {}, ['constant_jerk', 'constant_velocity']),
    ],
)
def test_wrong_configurations_are_refused_in_one_line(common, overrides, words):
    with pytest.raises(UsageError) as caught:
        bank(common=common, overrides=overrides)
    assert '\n' not in str(caught.value)
    assert all(word in str(caught.value) for word in words)
