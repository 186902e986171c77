# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node switched_observer over real DDS: events and status."""

import math

import dds
import numpy as np
import pytest

from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.models import gripper as model

MODULE = 'estimator_pkg.nodes.executables switched_observer'
QUANTUM = 2.0 * math.pi / 65536
MS = 10**6


def test_events_and_status(probe):
    from sensor_msgs.msg import JointState
    from trajectory_msgs.msg import JointTrajectory

    encode = Encoder().encode
    events = probe.node.create_publisher(JointState, '/switch_event', 10)
    accelerations = []
    subscription = probe.node.create_subscription(
        JointTrajectory, '/switched_observer/acceleration', accelerations.append, 3000
    )
    x, stamp, raws = np.array([0.3, 0.0]), 10**18, []
    for i in range(2500):
        u = model.torque((i - 0.5) * 1e-3) if i else (0.0,)
        if i:
            middle = x + 5e-4 * np.array(model.dynamics(x, model.UNLOADED, u))
            x = x + 1e-3 * np.array(model.dynamics(middle, model.UNLOADED, u))
        reading = round(float(x[0]) / QUANTUM) * QUANTUM
        raws.append(encode(stamp + i * MS, 'base', ('joint',), (reading,), (), u))
    with (
        dds.NodeProcess(MODULE, '--ros-args', '-p', f'quantum:={QUANTUM}') as node,
        dds.Observer(probe, '/switched_observer') as watched,
    ):
        watched.connect()
        probe.until(lambda: events.get_subscription_count() > 0)
        watched.feed(raws[:1990])
        probe.until(lambda: watched.status('joint') == 'tracking')
        probe.until(lambda: subscription.get_publisher_count() > 0)
        probe.spin(0.3)  # the node looks ten times a second who listens
        accelerations.clear()
        answer = watched.feed(raws[1990:2000])[-1]
        probe.until(lambda: len(accelerations) >= 10)
        found, point = accelerations[-1], accelerations[-1].points[0]
        assert found.joint_names == ['joint'] and found.header.frame_id == 'base'
        assert found.header.stamp.nanosec == 1999 * MS % 10**9
        assert list(point.positions) == list(answer.positions)
        assert list(point.velocities) == list(answer.velocities)
        acting = model.torque(1.9985)
        true = model.dynamics((point.positions[0], point.velocities[0]), model.UNLOADED, acting)[1]
        assert list(point.accelerations) == pytest.approx([true], abs=0.1)
        for at, mode in ((1000, 'close'), (1999, 'close'), (1990, 'open')):
            events.publish(event_message(stamp + at * MS, mode))
            probe.spin(0.2)
        node.prints("the event 'close' is not used: past")
        node.prints("the event 'open' is not used: out of order")
        watched.feed(raws[2000:2100])
        probe.until(lambda: 'not converged' in dds.value(watched.statuses['joint'], 'why'))
        watched.feed(
            [
                encode(stamp + 2100 * MS, '', ('joint',), (0.1,)),
                encode(stamp + 2101 * MS, '', ('other',), (0.1,), (), (0.0,)),
            ],
            unanswered={0, 1},
        )
        report = watched.next_report()['/switched_observer']
        assert report['messages_dropped.mismatched'] == '2'
        node.prints('a joint or an effort that the observer needs is missing')
    probe.node.destroy_subscription(subscription)
    probe.node.destroy_publisher(events)


def event_message(stamp_ns, mode):
    return Encoder().encode(stamp_ns, '', (mode,))
