# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Odometry of simulated bases: its intervals, its pose, slip, and gyros that are wrong."""

import math
from statistics import NormalDist

import numpy as np
import pytest
import wheel_runs as runs

from estimator_pkg.driver.wheels import arc
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.joint_state import Encoder
from sim_pkg.mechanisms import base

GROUND = {'travel_noise': 0.003}
EXACT = {'travel_noise': 0.0}
GYRO = {'gyro_topic': 'imu'}
SMALL = {'radius': 0.03, 'track': 0.2, 'turn': 1.5}
SKID = {'base': 'skid', 'slip_factor': 1.5}
ACKERMANN = {'base': 'ackermann'}
ZERO = {'steering_stddev': 0.0}  # of the simulated steering


def counts(number):
    return {'counts_per_revolution': number}, {'quantum': 2.0 * np.pi / number}


BASES = {  # the base, and the parameters of the node that differ from the defaults
    'differential': ({}, {}),
    'on noisy ground': (GROUND, GROUND),
    'of 512 counts': counts(512),
    'of 65536 counts': counts(65536),
    'of noisy encoders': ({'noise': 0.002}, {}),
    'at 50 Hz': ({'rate': 50.0}, {}),
    'small': (SMALL, {'radius': [0.03], 'track': 0.2}),
    'skid': (SKID, {'slip_factor': 1.5}),
    'ackermann': ({**ACKERMANN, 'noise': 0.001}, ZERO),
    'gyro': ({}, GYRO),
    'gyro, on noisy ground': (GROUND, {**GYRO, **GROUND}),
    'gyro of little noise': ({'gyro_noise': 0.001}, GYRO),
    'gyro of much noise': ({'gyro_noise': 0.02}, GYRO),
    'gyro that is late': ({'gyro_delay': 0.015}, GYRO),
    'gyro, 512 counts': tuple({**a, **b} for a, b in zip(counts(512), ({}, GYRO))),
    'gyro, track wrong by 5 %': ({'track': 0.525}, GYRO),
    'gyro, radii that differ by 1 %': ({'radius_difference': 0.01}, GYRO),
    'gyro, slip factor wrong': (SKID, {**GYRO, 'slip_factor': 1.4}),
    'gyro, ackermann': (ACKERMANN, {**GYRO, **ZERO}),
}


SIMILAR = {  # to another one, and slow
    *('of 512 counts', 'of noisy encoders', 'small', 'gyro of little noise', 'gyro of much noise'),
    *('gyro that is late', 'gyro, 512 counts', 'gyro, radii that differ by 1 %'),
}


@pytest.mark.long
@pytest.mark.parametrize(
    'case',
    [pytest.param(case, marks=pytest.mark.slow if case in SIMILAR else ()) for case in BASES],
)
def test_the_interval_of_the_yaw_rate_is_right(case):
    plant, values = BASES[case]
    result = runs.run(plant, 20.0, 1, runs.made(plant, **{**EXACT, **values}))
    assert len(result.time) > 950
    assert 0.9 < runs.covered(result) < 0.98
    assert not result.notices


def test_a_steering_joint_that_is_only_quantised_is_covered():
    """The position's deviation contains that encoders round or truncate: the interval is wide."""
    plant = ACKERMANN
    assert runs.covered(runs.run(plant, 20.0, 1, runs.made(plant, **EXACT, **ZERO))) > 0.98


@pytest.mark.long
def test_a_gyro_makes_it_better_and_is_learnt():
    plant = {**GROUND, 'track': 0.525, 'gyro_delay': 0.01}
    alone, both = (
        runs.run(plant, 20.0, 1, runs.made(plant, **GROUND, **values)) for values in ({}, GYRO)
    )
    wrong = [np.abs(each.twist - each.true_twist)[300:, 2].mean() for each in (alone, both)]
    assert wrong[1] < 0.3 * wrong[0]
    text = both.stream.base.text()
    known = [float(text.split(name)[1].split()[0]) for name in ('bias ', 'delay ', 'track ')]
    assert known == pytest.approx([0.02, 0.01, 0.525], abs=0.015)
    assert known[0] == pytest.approx(0.02, abs=0.003)


@pytest.mark.long
@pytest.mark.parametrize('gyro', [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_pose_is_in_its_covariance(gyro):
    """NEES of drives whose constants are spread as the parameters say: its mean would be 3."""
    found, spread = [], [NormalDist().inv_cdf((k + 0.5) / 12.0) for k in range(12)]
    for seed in range(12):
        plant = {
            **GROUND,
            'turn_mean': 0.2 * (seed % 3 - 1),
            'track': 0.5 * (1.0 + 0.02 * spread[seed]),
            'radius_difference': math.sqrt(2.0) * 0.002 * spread[5 * seed % 12],
        }
        values = {**GROUND, 'track_stddev': 0.02, 'radius_stddev': 0.002}
        values |= GYRO if gyro else {}
        found.append(runs.nees(runs.run(plant, 15.0, seed, runs.made(**values))))
    low, high = (0.7 if gyro else 1.8), 4.5  # chi-square of 36 over 12: 95 % in 1.8 to 4.5
    assert low < np.mean(found) < high, found
    assert max(found) < 17.0  # chi-square of 3: one in 1400


@pytest.mark.long
@pytest.mark.parametrize(
    'plant',
    [{}, pytest.param(SKID, marks=pytest.mark.slow), ACKERMANN],
    ids=['differential', 'skid', 'ackermann'],
)
def test_slip_is_named_and_covered(plant):
    plant, steps = {**plant, 'slip': 0.5}, []
    alone, both = (
        runs.run(
            plant, 20.0, 1, runs.made(plant, slip_factor=plant.get('slip_factor', 1.0), **each)
        )
        for each in ({}, GYRO)
    )
    steps = [np.abs(each.twist - each.true_twist)[300:, 2].max() for each in (alone, both)]
    assert steps[1] < 0.25 * steps[0]
    assert both.stream.base.slipped == 2 and runs.covered(both) > 0.9
    (said,) = both.notices
    assert said.startswith('slip: the wheels turn the base at ') and ', the gyro at ' in said
    slipping = (both.time % 8.0 > 6.4) & (both.time % 8.0 < 6.6)  # in the middle of a slip
    variances = both.twist_covariance[:, 0, 0]
    assert variances[slipping].min() > 100.0 * np.median(variances)
    assert runs.nees(both) < 17.0
    if plant.get('base') == base.ACKERMANN:
        assert alone.stream.base.slipped == 2 and runs.covered(alone) > 0.9
        assert 'the steering at' in alone.notices[0]


def test_wheels_of_a_side_that_differ_are_slip():
    """The rear left wheel turns 10 % faster for a second."""
    stream = runs.made({'base': 'skid'})
    for row in range(500):
        t, encoder = 0.01 * row, Encoder()
        extra = 0.1 * 8.0 * min(max(t - 2.0, 0.0), 1.0)
        angles = [8.0 * t, 8.0 * t + extra, 8.0 * t, 8.0 * t]
        names = [name for side in runs.SKID.values() for name in side]
        list(stream.feed(0, encoder.encode(runs.START + round(t * 1e9), '', names, angles), 0))
        if row == 250:
            assert 'wheels of one side differ by 0.08' in stream.about(names[0])['slip']
            assert stream.base.twist_covariance[0, 0] > 0.01**2
    assert stream.base.slips == '' and stream.base.slipped == 1


class Wrong(base.Plant):
    """A base that brakes from 9.9 s on, and stands from 10 to 15 s."""

    def twist(self, t):
        part = min(max((abs(t - 12.5) - 2.5) / 0.1, 0.0), 1.0)
        return tuple(part * value for value in super().twist(t))


WRONG = {
    'silent': (lambda t, value: math.nan, 'silent'),
    'stuck': (lambda t, value: 0.4, 'stuck at 0.4'),
    'biased': (lambda t, value: value + 0.1, 'and the wheels stand'),
}


@pytest.mark.long
@pytest.mark.parametrize('case', WRONG)
def test_a_wrong_gyro_is_not_used_and_learnt_again(case, monkeypatch):
    """It is wrong from 8 s on; the biased one is right with its new bias."""
    value_of, said = WRONG[case]
    stream, notices, errors = runs.made(**EXACT, **GYRO), [], []
    monkeypatch.setattr(base, 'Plant', Wrong)
    receive = stream.base.gyro.receive

    def changed(stamp_ns, value):
        t = (stamp_ns - runs.START) * 1e-9
        receive(stamp_ns, value if t < 8.0 else value_of(t, value))

    stream.base.gyro.receive = changed
    result = runs.run({}, 25.0, 1, stream)
    notices = [text for text in result.notices if not text.startswith('slip: ')]
    assert notices[0].startswith('the gyro is not used: ') and len(notices) < 3
    assert said in notices[0]
    rows = result.time > 16.0
    errors = np.abs(result.twist - result.true_twist)[rows, 2]
    assert errors.mean() < 0.005
    assert stream.base.used == (case == 'biased')


def test_a_reversed_gyro_is_never_used_and_named():
    result = runs.run({}, 15.0, 1, runs.made(**EXACT, **GYRO, gyro_ratio=-1.0))
    assert result.notices[0].endswith('do not agree: check its sign') and len(result.notices) == 1
    assert not result.stream.base.used
    assert np.abs(result.twist - result.true_twist)[300:, 2].mean() < 0.01


def test_a_clock_that_is_set_back_is_survived():
    """A bag that loops: the pose goes on, and the gyro is used again."""
    stream, ends = runs.made(**EXACT, **GYRO), []
    for seconds in (8.0, 12.0):
        result = runs.run({}, seconds, 1, stream)
        ends.append(result.pose[-1] - result.true_pose[-1])
        assert np.abs(result.twist - result.true_twist)[300:, 2].mean() < 0.01
        assert stream.base.used
    assert np.isfinite(ends[1]).all() and np.linalg.norm(ends[1][:2]) > 1.0


def test_an_arc_and_its_derivatives():
    whole, h = np.array([0.7, 0.3]), 1e-6
    for turn in (0.0, 1e-5, -2e-4, 0.3, -2.0):
        step, by = arc(0.7, turn, 0.4)
        assert arc(0.7, turn, 0.4 + 0.5)[0][2] == turn
        parts = np.linspace(0.4, 0.4 + turn, 20001)  # midpoints of the arc
        middle = 0.5 * (parts[1:] + parts[:-1])
        whole = 0.7 * np.array([np.cos(middle).mean(), np.sin(middle).mean()])
        assert step[:2] == pytest.approx(whole, abs=1e-8)
        for k, (distance, angle) in enumerate(((0.7 + h, turn), (0.7, turn + h))):
            assert by[:, k] == pytest.approx((arc(distance, angle, 0.4)[0] - step) / h, abs=1e-5)


def test_the_estimates_leave_before_the_base_is_moved():
    stream, encoder = runs.made(), Encoder()
    for row in range(20):
        stamp, angle = runs.START + 10_000_000 * row, 0.08 * row
        raw = encoder.encode(stamp, '', base.WHEELS['differential'], [angle, angle])
        before, answers = stream.base.pose[0], iter(stream.feed(0, raw, 0))
        assert set(next(answers)) == {0, 1} and stream.base.pose[0] == before
        last = list(answers)
    assert [set(answer) for answer in last] == [{2}] and stream.base.pose[0] > before


def test_a_pause_of_the_wheels_is_in_the_covariance_and_named():
    """Wrapped wheels may have turned any number of times."""
    stream, notices = runs.made(), []
    before = 0.0
    for row in [*range(300), *range(400, 500)]:
        t = 0.01 * row
        raw = Encoder().encode(
            runs.START + round(t * 1e9), '', base.WHEELS['differential'], [8.0 * t, 8.0 * t]
        )
        list(stream.feed(0, raw, 0))
        notices += stream.notices()
        if row == 299:
            before = stream.base.covariance[0, 0]
    assert stream.base.covariance[0, 0] > before + 0.1
    assert 'turns in it are not in the pose' in ' '.join(notices)


def test_reset_begins_at_zero_and_keeps_the_gyro():
    result = runs.run({}, 10.0, 1, runs.made(**GYRO))
    stream = result.stream
    assert np.abs(stream.base.pose).max() > 1.0
    assert stream.reset().endswith('the pose is zero')
    assert not stream.base.pose.any() and not stream.base.covariance.any()
    assert stream.base.used


@pytest.mark.parametrize(
    ('values', 'said'),
    [
        ({'radius': None}, "'radius' is not set"),
        ({'track': None}, "'track' is not set"),
        ({'steering': 'steer'}, "'wheelbase' is not set, and 'steering' needs it"),
        ({'wheels_left': ['a', 'b']}, "has 2 names and 'wheels_right' 1"),
        ({'wheels_left': ['a'], 'wheels_right': ['a']}, "'a', 'a'.* each another joint"),
        ({'wheels_left': ['']}, 'each another joint'),
        ({'radius': [0.1, 0.1, 0.1]}, "'radius' has 3 numbers"),
        ({'radius': [-0.1]}, 'radius'),
        ({'gyro_topic': 'imu', 'gyro_ratio': 0.0}, "'gyro_ratio' is 0"),
    ],
)
def test_a_base_that_is_none_is_refused(values, said):
    from estimator_pkg.streams.wheels import WheelStream

    given = {'radius': [0.1], 'track': 0.5, **values}
    with pytest.raises(UsageError, match=said) as reported:
        WheelStream.of({name: value for name, value in given.items() if value is not None})
    assert '\n' not in str(reported.value)


def test_a_loop_needs_a_speed():
    with pytest.raises(UsageError, match="'loop' needs a speed"):
        base.BaseParameters(loop=3.0, speed=0.0)
