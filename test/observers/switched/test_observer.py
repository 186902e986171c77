# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid observer: events, convergence, the checks of models."""

import dataclasses
import math

import numpy as np
import pytest

from estimator_pkg import observers
from estimator_pkg.circle import Circle
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.efforts import DrivenSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.driver.switched import SwitchedBank, SwitchedJoint
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import INITIALISING, TRACKING
from estimator_pkg.models import gripper
from estimator_pkg.models.switched import check, load, trajectory
from estimator_pkg.observers.switched.observer import Gains, Switched
from estimator_pkg.observers.switched.state import OutputDeviations
from estimator_pkg.parameters import build
from sim_pkg.reproduce.hybrid_discrete.runs import Observed

QUANTUM = 2.0 * math.pi / 65536
RESTING = dataclasses.replace(gripper.MODEL, probe=lambda t: (0.0,), start=((0.0, 0.0), (2.0,) * 3))
SHIFTED = dataclasses.replace(gripper.MODEL, lam=lambda zeta, u: ((u[0], zeta[1], 0.0),))
MODES = {'close': None, 'same': gripper.IDENTITY_JUMP}


@pytest.mark.long
def test_a_model_that_knows_its_own_modes_alone_names_a_typical_event():
    """The checks simulate events, whose mode and v mean something to the user's code."""
    strict = dataclasses.replace(
        gripper.MODEL,
        transition=lambda mode: MODES[mode],
        offset=lambda mode, v, y: (0.0 * v[0], 0.0, 0.0),
    )
    with pytest.raises(UsageError, match=r"its code fails in '<lambda>', line \d+: KeyError: ''"):
        check(strict)
    assert check(dataclasses.replace(strict, event=('same', (1.0,)))) > 0.0


def gripped(count=4000, loads=((2000, gripper.CLOSED),), drag=0.0):
    """(angles, velocities, torques) at 1 kHz with the load changing at these samples, and an
    acceleration by drag [1/rad] that the model does not have.
    """
    x, z, states, torques = np.array(gripper.MODEL.start[0]), gripper.UNLOADED, [], []
    changes = dict(loads)
    for i in range(count + 1):
        z = changes.get(i, z)
        states.append(x)
        u = gripper.torque((i + 0.5) * 1e-3)
        torques.append(u)

        def slope(at, z=z, u=u):
            return np.array(gripper.dynamics(at, z, u)) - (0.0, drag * abs(at[1]) * at[1])

        middle = x + 5e-4 * slope(x)
        middle = x + 5e-4 * slope(middle)
        x = x + 1e-3 * slope(middle)
    angle, velocity = np.array(states).T
    return angle, velocity, torques


def made(**gains):
    return SwitchedJoint(Switched, build(Gains, gains), JointSettings())


def run(joint, angles, torques, events=(), offset=0.0):
    """Feed a wrapped, quantised angle; (Z, converged, velocity, acceleration, status) after each
    sample.
    """
    events = dict(events)
    rows = []
    for i, angle in enumerate(angles.tolist()):
        reading = math.remainder(round((angle + offset) / QUANTUM) * QUANTUM, 2.0 * math.pi)
        joint.update(10**18 + i * 10**6, (reading,), torques[i - 1] if i else (0.0,))
        z, _, converged = joint.discrete()
        rows.append((z, converged, *joint.estimates()[0][1:]))
        if i in events:
            assert joint.event(joint.stamp_ns, events[i]) == 'applied'
    return rows


@pytest.mark.long
def test_a_new_load_is_known_within_half_a_second():
    angles, velocities, torques = gripped()
    joint = made(quantum=QUANTUM)
    rows = run(joint, angles, torques, [(2000, 'close')])
    assert rows[1999][0] == pytest.approx(gripper.UNLOADED, rel=0.01) and rows[1999][1]
    assert not any(row[1] for row in rows[2001:2290])
    assert rows[2100][0] == pytest.approx(rows[2000][0])  # the prediction
    for z, converged, *_ in rows[2500:]:
        assert converged and z == pytest.approx(gripper.CLOSED, rel=0.02)
    errors = np.array([row[2] for row in rows]) - velocities
    before, after = (
        np.sqrt(np.mean(np.square(errors[part]))) for part in (slice(1500, 2000), slice(2000, 2500))
    )
    assert after < 2.0 * before
    assert joint.estimate()[3] == TRACKING
    unsaid = run(made(quantum=QUANTUM), angles, torques)  # without the event
    assert abs(unsaid[2500][0][0] / gripper.CLOSED[0] - 1.0) > 0.1


@pytest.mark.long
@pytest.mark.parametrize('drag', [0.0, 0.3])
def test_another_plant_is_reported_and_the_interval_covers(drag):
    angles, velocities, torques = gripped(5000, loads=((3000, gripper.CLOSED),), drag=drag)
    joint, within = made(quantum=QUANTUM), []
    for i, angle in enumerate(angles.tolist()):
        reading = math.remainder(round(angle / QUANTUM) * QUANTUM, 2.0 * math.pi)
        joint.update(10**18 + i * 10**6, (reading,), torques[i - 1] if i else (0.0,))
        if i == 3000:
            joint.event(joint.stamp_ns, 'close')
        if i > 800:
            error = abs(joint.estimates()[0][1] - velocities[i])
            within.append(error < 1.96 * joint.deviations()[0][1])
        if i in (2900, 4900):
            assert joint.why().startswith('the model does not fit') == (drag > 0.0)
            assert drag > 0.0 or joint.why() == ''
    assert np.mean(within) > 0.9


@pytest.mark.long
def test_after_an_encoder_was_stuck_the_observer_starts_again():
    """Neither the jump nor the Z that was learnt while it was stuck enters the velocity."""
    angles, velocities, torques = gripped(
        4200, loads=((1500, gripper.CLOSED), (2900, gripper.UNLOADED))
    )
    angles = angles.copy()
    angles[1200:3000] = angles[1200]
    assert abs(angles[3000] - angles[2999]) > 0.8
    rows = run(made(quantum=QUANTUM), angles, torques)[3000:]
    assert rows[0][4] == INITIALISING
    wrong = [abs(row[2] - v) for row, v in zip(rows, velocities[3000:]) if row[4] == TRACKING]
    assert len(wrong) > 1000 and max(wrong) < 0.2


@pytest.mark.long
def test_two_events_closer_than_the_settling_time_leave_the_prediction():
    angles, _, torques = gripped(3200)
    rows = run(made(quantum=QUANTUM), angles, torques, [(2000, 'close'), (2250, 'same')])
    assert not any(row[1] for row in rows[2001:2540])
    assert rows[2400][0] == pytest.approx(rows[1999][0], rel=1e-3)
    assert rows[2600][1] and rows[2600][0] == pytest.approx(gripper.CLOSED, rel=0.03)


@pytest.mark.long
def test_an_event_that_changes_nothing_loses_nothing():
    angles, _, torques = gripped(3000, loads=())
    rows = run(made(quantum=QUANTUM), angles, torques, [(2000, 'same')])
    for z, *_ in rows[1990:]:
        assert z == pytest.approx(gripper.UNLOADED, rel=0.01)


@pytest.mark.long
def test_the_angle_may_wrap():
    angles, _, torques = gripped(2000, loads=())
    plain = run(made(quantum=QUANTUM), angles, torques)
    wrapped = run(made(quantum=QUANTUM), angles, torques, offset=2.0 * math.pi)
    assert [row[2] for row in wrapped] == pytest.approx([row[2] for row in plain], abs=1e-6)


@pytest.mark.long
def test_a_gap_keeps_what_was_learnt():
    angles, velocities, torques = gripped(3000, loads=())
    joint = made(quantum=QUANTUM)
    run(joint, angles[:2001], torques)
    for i in range(2400, 3000):
        joint.update(10**18 + i * 10**6, (float(angles[i]),), torques[i - 1])
    assert joint.discrete()[0] == pytest.approx(gripper.UNLOADED, rel=0.02)
    assert joint.estimates()[0][1] == pytest.approx(velocities[2999], abs=0.2)


@pytest.mark.long
@pytest.mark.parametrize(
    'name, words',
    [
        ('grippr', "unknown switched model 'grippr'"),
        ('nowhere.at:ALL', "cannot import 'nowhere.at'"),
        ('estimator_pkg.models.gripper:UNLOADED', 'is not a SwitchedModel'),
        (f'{__name__}:RESTING', 'is deficient'),
        (f'{__name__}:SHIFTED', 'the derivative of zeta[1]'),
    ],
)
def test_wrong_models_are_refused_before_running(name, words):
    with pytest.raises(UsageError) as caught:
        Switched.bound(Gains(model=name))
    assert words in str(caught.value) and '\n' not in str(caught.value)


EXAMPLE = load('example')


@pytest.mark.parametrize(
    'model, change, words',
    [
        (gripper.MODEL, {'names': ('a',)}, "'names'"),
        (gripper.MODEL, {'bounds': ((1.0,),)}, "'bounds'"),
        (gripper.MODEL, {'start': ((0.0,), (1.0, 1.0, 1.0))}, 'start needs 2 and 3'),
        (gripper.MODEL, {'gamma': lambda zeta, u: (0.0, 0.0)}, "'gamma'"),
        (gripper.MODEL, {'phi': lambda x, z: (x[0], 2.0 * x[1])}, 'does not invert'),
        (gripper.MODEL, {'transition': lambda mode: ((1.0, 0.0), (0.0, 1.0))}, "'transition' has"),
        (
            EXAMPLE,  # as printed in the paper
            {'gamma': lambda zeta, u: (EXAMPLE.gamma(zeta, u)[0], EXAMPLE.gamma(zeta, u)[1] - 1.0)},
            r'zeta\[3\]',
        ),
    ],
)
def test_models_that_contradict_themselves(model, change, words):
    with pytest.raises(UsageError, match=words):
        check(dataclasses.replace(model, **change))


def example_run(events=12, **gains):
    """The paper's example at 1 ms: ((Z as shown, converged, true Z) after each event, observer,
    last true state).
    """
    times, states, true = trajectory(load('example'), events)
    measured = [(float(x[0]), float(x[2])) for x in states]
    gains = Gains(model='example', **{'discrete': 'inversion', 'settle': 0.0, **gains})
    observed = Observed(gains, Circle(0.0), 1e-3, measured[0])
    rows = []
    for i in range(1, len(times)):
        observed.step(measured[i])
        if i % 500 == 0:
            observed.jump()
            rows.append((*observed.discrete()[::2], true[i]))
    return rows, observed, states[-1]


@pytest.mark.long
@pytest.mark.parametrize('velocity', ['filtered', 'cascade'])
def test_two_outputs_and_the_second_joint(velocity):
    rows, observed, state = example_run(6, velocity=velocity)
    shown, converged, z = rows[-1]
    out, zeta = observed.estimate(), load('example').zeta(state, z)
    assert out.position == pytest.approx(state[[0, 2]], abs=1e-5)
    assert out.velocity == pytest.approx((zeta[1], zeta[3]), abs=0.005)
    assert observed.states() == pytest.approx(state, abs=0.03)
    assert shown == pytest.approx(z, abs=0.02) and converged


@pytest.mark.long
@pytest.mark.parametrize('steps', [1, 2, 3])
def test_the_fifo_of_n_intervals_and_the_prediction_of_n_plus_1_steps(steps):
    """Z(k+1) is right at event k+1, from the outputs of the intervals k-N .. k: not an event
    earlier, as the prediction of N steps in print would be late by one.
    """
    rows, observed, _ = example_run(steps=steps)
    assert [converged for _, converged, _ in rows[:steps]] == [False] * steps
    assert len(observed.state.history) == steps + 1
    for shown, converged, true in rows[steps:]:
        assert converged and shown == pytest.approx(true, abs=0.05)


@pytest.mark.long
def test_the_acceleration_is_right_at_once_after_a_known_event():
    """Z jumps, and with it what ends the chains: in the example by 6 of their 10 units. With
    `reset: all` the published acceleration jumps along before the stages could have settled.
    """
    model = load('example')
    times, states, z = trajectory(model, 10)
    worst = {}
    for reset in ('all', 'states'):
        gains = Gains(model='example', settle=0.2, velocity='cascade', reset=reset)
        observed = Observed(gains, Circle(0.0), 1e-3, (float(states[0, 0]), float(states[0, 2])))
        off = []
        for i in range(1, len(times)):
            observed.step((float(states[i, 0]), float(states[i, 2])))
            if i % 500 == 0:
                observed.jump()
            if i > 3000 and 3 <= i % 500 < 10:
                at = model.zeta(states[i], z[i])
                true = model.gamma(at, ())[0] + np.dot(model.lam(at, ())[0], z[i])
                off.append(abs(observed.estimate().acceleration[0] - true))
        worst[reset] = max(off)
    assert worst['all'] < 2.0 < 5.0 < worst['states']


def test_the_inversion_is_not_used_below_its_singular_value():
    model = load('example')
    times, states, true = trajectory(model, 4)
    gains = Gains(model='example', discrete='inversion', settle=0.0, singular_value=20.0)
    observed = Observed(gains, Circle(0.0), 1e-3, (1.0, 0.5))
    shown, beta = (0.0, 0.0, 0.0), (1.0, 0.5)
    for i in range(1, len(times)):
        observed.step((float(states[i, 0]), float(states[i, 2])))
        if i % 500 == 0:
            shown = np.array(model.transition('')) @ shown + model.offset('', (), beta)
            beta = tuple(states[i, [0, 2]])
            observed.jump()
            # A_d Z + beta_d alone, and said to be so
            assert not observed.discrete()[2]
            assert observed.discrete()[0] == pytest.approx(shown, abs=1e-9)


def test_every_output_has_a_standard_deviation_of_its_own():
    gains, out = Gains(model='example', noise=1e-4, velocity='cascade'), OutputDeviations()
    observed = Observed(gains, Circle(0.0), 1e-3, (1.0, 0.5))
    observed.step((1.0, 0.5))
    module = observed.module
    module.deviation(module, out, observed.state, observed.coefficients, observed.design, 2.0)
    assert out.position == pytest.approx([1e-4, 1e-4])
    assert out.velocity == pytest.approx([2.0 * math.sqrt(120e-4), 2.0 * math.sqrt(60e-4)])


@pytest.mark.long
@pytest.mark.parametrize('counts, bandwidth, rms', [(65536, 48.0, 0.0031), (4096, 30.0, 0.024)])
def test_the_velocity_belongs_to_the_stamp_and_is_quiet(counts, bandwidth, rms):
    """At most the error of `hybrid_angle`, the loads' two changes included, without delay; the
    stages of the paper lag by half an interval and step with the encoder.
    """
    angles, velocities, torques = gripped(
        5000, loads=((2000, gripper.CLOSED), (4000, gripper.UNLOADED))
    )
    quantum = 2.0 * math.pi / counts
    readings = np.remainder(np.round(angles / quantum) * quantum + math.pi, 2.0 * math.pi) - math.pi
    switched = SwitchedJoint(
        Switched, build(Gains, {'quantum': quantum, 'bandwidth_hz': bandwidth}), JointSettings()
    )
    other = observers.find('hybrid_angle')
    angle_only = Joint(other, build(other.gains, {'quantum': quantum}), JointSettings())
    found = []
    for i, reading in enumerate(readings.tolist()):
        stamp = 10**18 + i * 10**6
        switched.update(stamp, (reading,), torques[i - 1] if i else (0.0,))
        angle_only.update(stamp, reading)
        speed, stddev = switched.estimates()[0][1], switched.deviations()[0][1]
        found.append((speed, stddev, angle_only.estimate()[1]))
        if i in (2000, 4000):
            assert switched.event(stamp, 'close') == 'applied'
    speed, stddev, peer = np.array(found)[500:].T
    true, acceleration = velocities[500:], np.gradient(velocities, 1e-3)[500:]
    error = speed - true
    assert 0.5 * rms < np.sqrt(np.mean(error**2)) < rms
    assert np.sqrt(np.mean(error**2)) < np.sqrt(np.mean((peer - true) ** 2))
    delay = -np.dot(error, acceleration) / np.dot(acceleration, acceleration)
    assert abs(delay) < 1e-4
    assert 0.93 < np.mean(np.abs(error) < 1.96 * stddev) < 0.995


def test_a_start_at_speed_locks_on_a_coarse_encoder():
    """From 200 rad/s with steps beyond the gate of the stages: published from 20 time constants on,
    and right from the first.
    """
    quantum = 2.0 * math.pi / 4096
    joint = made(quantum=quantum)
    published = []
    for i in range(600):
        reading = math.remainder(round(0.2 * i / quantum) * quantum, 2.0 * math.pi)
        joint.update(10**18 + i * 10**6, (reading,), (0.0,))
        ((_, velocity, _, status),) = joint.estimates()
        if status == TRACKING:
            published.append(i)
            assert velocity == pytest.approx(200.0, abs=0.3)
    assert published == list(range(published[0], 600)) and 90 < published[0] < 130


@pytest.mark.long
def test_a_bandwidth_is_the_one_from_true_to_estimated_velocity():
    """A sine at the bandwidth, which the model knows nothing of, comes at -3 dB."""
    observed, speeds = Observed(Gains(bandwidth_hz=5.0), Circle(0.0), 1e-4, (0.0,)), []
    for i in range(1, 10000):
        angle = 1e-5 * math.sin(2.0 * math.pi * 5.0 * i * 1e-4)
        observed.step((angle,), (0.0,))
        speeds.append(observed.state.observed[0][1] / (1e-5 * 2.0 * math.pi * 5.0))
    assert max(speeds[6000:]) == pytest.approx(math.sqrt(0.5), rel=0.01)


def test_the_bank_gives_positions_velocities_and_deviations_of_all_joints():
    settings = build(DrivenSettings, {'wrap_period': 0.0})
    system = SwitchedJoint(Switched, build(Gains, {'model': 'example', 'noise': 1e-4}), settings)
    bank = SwitchedBank(system, ('y1', 'y2'))
    _, states, _ = trajectory(load('example'), 1)
    for i, (x1, _, x3, _) in enumerate(states.tolist()):
        found = bank.take(10**18 + i * 10**6, ('y2', 'other', 'y1'), (x3, 0.0, x1), ())
    assert found.names == ['y2', 'y1']  # in the order of the message
    estimates = found.estimates
    assert [each[0] for each in estimates] == pytest.approx(states[-1, [2, 0]], abs=1e-3)
    assert all(math.isfinite(each[2]) for each in estimates)
    first, second = system.deviations()
    assert found.stddevs([0, 1]) == [second, first]
    assert [round(speed, 3) for _, speed in (first, second)] == [0.010, 0.010]


@pytest.mark.long
def test_the_acceleration_is_that_of_the_model_once_it_is_known():
    angles, velocities, torques = gripped(4000, loads=())
    found = [row[3] for row in run(made(quantum=QUANTUM), angles, torques)]
    true = [
        gripper.dynamics(x, gripper.UNLOADED, torques[i - 1])[1]
        for i, x in enumerate(zip(angles, velocities))
    ]
    error = np.array(found) - true
    assert np.sqrt(np.mean(error[2000:] ** 2)) < 0.02 * np.std(true)
    assert math.isfinite(found[100])  # from the chain, before Z is known
