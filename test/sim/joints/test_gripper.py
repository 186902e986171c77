# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator gripper: events and masses."""

import numpy as np
import pytest

from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.models import gripper as model
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
    for first, last, z in ((100, 1999, model.UNLOADED), (2001, 2490, model.CLOSED)):
        part = slice(first, last)
        wanted = (
            z[0] * np.array(efforts)[1:][part] - z[1] * w[:-1][part] - z[2] * np.sin(q[:-1][part])
        )
        assert np.abs(acceleration[part] - wanted).max() < 0.2
