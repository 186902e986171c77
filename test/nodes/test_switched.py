# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node switched_observer: acceleration, events that are not used, and its status."""

import math

import numpy as np
import pytest
from own_node import BEGIN
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from estimator_pkg.estimate import TRACKING
from estimator_pkg.models import gripper as model

QUANTUM = 2.0 * math.pi / 65536
MS = 10**6


def test_events_and_status(own, capfd):
    node = own('switched', quantum=QUANTUM)
    stream, encode = node.node.stream, node.encode
    acceleration = [output.name for output in stream.outputs].index('acceleration')
    x, last = np.array([0.3, 0.0]), None
    stream.wanted[acceleration] = True
    for i in range(1000):
        u = model.torque((i - 0.5) * 1e-3) if i else (0.0,)
        if i:
            middle = x + 5e-4 * np.array(model.dynamics(x, model.UNLOADED, u))
            x = x + 1e-3 * np.array(model.dynamics(middle, model.UNLOADED, u))
        reading = round(float(x[0]) / QUANTUM) * QUANTUM
        raw = encode(BEGIN + i * MS, 'base', ('joint',), (reading,), (), u)
        for answer in stream.feed(0, raw, 0):
            last = answer.get(acceleration, last)
    node.pass_time(0.1)
    assert node.status_of('joint')[0] == TRACKING
    found = deserialize_message(last, JointTrajectory)
    (point,) = found.points
    assert found.joint_names == ['joint'] and found.header.frame_id == 'base'
    assert found.header.stamp.nanosec == (BEGIN + 999 * MS) % 10**9
    acting = model.torque(0.9985)
    true = model.dynamics((point.positions[0], point.velocities[0]), model.UNLOADED, acting)[1]
    assert list(point.accelerations) == pytest.approx([true], abs=0.1)
    for at, mode in ((500, 'close'), (999, 'close'), (990, 'open')):
        stream.feed(1, encode(BEGIN + at * MS, '', (mode,)), 0)
        node.pass_time(0.1)
    for i in range(1000, 1100):
        stream.feed(0, encode(BEGIN + i * MS, '', ('joint',), (0.1,), (), (0.0,)), 0)
    node.pass_time(0.1)
    said = capfd.readouterr().err
    assert "the event 'close' is not used: past" in said
    assert "the event 'open' is not used: out of order" in said
    assert 'not converged' in node.status_of('joint')[1]
