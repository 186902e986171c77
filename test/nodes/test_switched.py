# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node switched_observer: acceleration, events that are not used, and its status."""

import math

import numpy as np
import pytest
from own_node import BEGIN, OwnNode
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from estimator_pkg.estimate import TRACKING
from estimator_pkg.models import gripper as model

QUANTUM = 2.0 * math.pi / 65536
MS = 10**6


def test_events_and_status(probe, monkeypatch, capfd):
    own = OwnNode(monkeypatch, 'switched', quantum=QUANTUM)
    stream, encode, statuses = own.node.stream, own.encode, own.node.health.watch.statuses
    acceleration = [output.name for output in stream.outputs].index('acceleration')
    x, last = np.array([0.3, 0.0]), None
    try:
        stream.wanted[acceleration] = True
        for i in range(2000):
            u = model.torque((i - 0.5) * 1e-3) if i else (0.0,)
            if i:
                middle = x + 5e-4 * np.array(model.dynamics(x, model.UNLOADED, u))
                x = x + 1e-3 * np.array(model.dynamics(middle, model.UNLOADED, u))
            reading = round(float(x[0]) / QUANTUM) * QUANTUM
            raw = encode(BEGIN + i * MS, 'base', ('joint',), (reading,), (), u)
            for answer in stream.feed(0, raw, 0):
                last = answer.get(acceleration, last)
        own.pass_time(0.1)
        assert statuses['joint'][0] == TRACKING
        found = deserialize_message(last, JointTrajectory)
        (point,) = found.points
        assert found.joint_names == ['joint'] and found.header.frame_id == 'base'
        assert found.header.stamp.nanosec == (BEGIN + 1999 * MS) % 10**9
        acting = model.torque(1.9985)
        true = model.dynamics((point.positions[0], point.velocities[0]), model.UNLOADED, acting)[1]
        assert list(point.accelerations) == pytest.approx([true], abs=0.1)
        for at, mode in ((1000, 'close'), (1999, 'close'), (1990, 'open')):
            stream.feed(1, encode(BEGIN + at * MS, '', (mode,)), 0)
            own.pass_time(0.1)
        for i in range(2000, 2100):
            stream.feed(0, encode(BEGIN + i * MS, '', ('joint',), (0.1,), (), (0.0,)), 0)
        own.pass_time(0.1)
        said = capfd.readouterr().err
        assert "the event 'close' is not used: past" in said
        assert "the event 'open' is not used: out of order" in said
        assert 'not converged' in statuses['joint'][1]
    finally:
        own.close()
