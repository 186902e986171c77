# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator gripper: events, masses, and the hybrid observer on its stream."""

import numpy as np
import pytest

from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.switched import SwitchedJoint
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.models import gripper as model
from estimator_pkg.observers.switched.observer import OBSERVER
from estimator_pkg.parameters import build
from sim_pkg.joints.gripper import SIMULATOR, GripperParameters


def messages(duration, seed=1, **values):
    decode = Decoder().decode
    for chunk in SIMULATOR.generate(build(GripperParameters, values), duration, seed):
        for message in chunk:
            yield message.due_ns, message.topic, decode(message.encode(10**18))


@pytest.mark.long
@pytest.mark.parametrize('rate', [1000.0, 333.0])
def test_events_are_announced_when_they_happen(rate):
    found = [
        (due, message)
        for due, topic, message in messages(7.0, rate=rate)
        if topic == 'switch_event'
    ]
    assert [due for due, _ in found] == [2 * 10**9, 4 * 10**9, 6 * 10**9]
    assert [message.names for _, message in found] == [('close',), ('open',), ('close',)]
    assert [message.stamp_ns - 10**18 for _, message in found] == [due for due, _ in found]


def test_the_acceleration_changes_at_the_event():
    rows = [message for _, topic, message in messages(2.5) if topic != 'switch_event']
    efforts = [message.efforts[0] for message in rows if message.efforts]
    true = [message for message in rows if message.velocities]
    q = np.array([message.positions[0] for message in true])
    w = np.array([message.velocities[0] for message in true])
    acceleration = np.diff(w) / 1e-3
    for first, last, z in ((100, 1999, model.OPEN), (2001, 2490, model.CLOSED)):
        part = slice(first, last)
        wanted = (
            z[0] * np.array(efforts)[1:][part] - z[1] * w[:-1][part] - z[2] * np.sin(q[:-1][part])
        )
        assert np.abs(acceleration[part] - wanted).max() < 0.2


@pytest.mark.long
def test_the_observer_on_the_stream():
    """Demo of the issue: 16 bits, two events, each new load within 5 % after 0.5 s."""
    joint = SwitchedJoint(
        OBSERVER, build(OBSERVER.gains, {'quantum': 2.0 * np.pi / 65536}), JointSettings()
    )
    errors, times, last, velocity = [], [], None, {}
    for due, topic, message in messages(5.0):
        if topic == 'switch_event':
            assert joint.event(message.stamp_ns, message.names[0]) == 'waiting'
        elif topic == 'joint_states':
            joint.update(message.stamp_ns, message.positions[:1], message.efforts[:1])
            velocity[message.stamp_ns] = joint.estimate()[1]
            last = message.stamp_ns
            seconds = 1e-9 * due
            after = (seconds - 2.0) % 2.0
            if seconds > 2.0 and after >= 0.5:
                z, _, converged = joint.discrete()
                wanted = model.CLOSED if seconds < 4.0 else model.OPEN
                assert converged and z == pytest.approx(wanted, rel=0.05), seconds
        else:
            errors.append(velocity[message.stamp_ns] - message.velocities[0])
            times.append(1e-9 * due)
    assert last is not None
    errors, times = np.array(errors), np.array(times)
    for event in (2.0, 4.0):
        before = np.sqrt(np.mean(errors[(times > event - 0.5) & (times <= event)] ** 2))
        after = np.sqrt(np.mean(errors[(times > event) & (times <= event + 0.5)] ** 2))
        assert after < 2.0 * before
