# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node mechanical_observer: several mechanisms, and the loop closed with it over real DDS."""

import math

import dds
import numpy as np
import pytest
from answers import estimated
from own_node import BEGIN

from estimator_pkg.estimate import TRACKING
from estimator_pkg.messages.joint_state import Decoder

MODULE = 'estimator_pkg.nodes.executables mechanical_observer'
MS = 1_000_000


def test_several_mechanisms_separate_messages_and_commands(own):
    """Two mechanisms; one's joints come in separate messages; the input is a topic of its own."""
    values = {
        'mechanisms': ('arm', 'lab'),
        'bandwidth_hz': 20.0,
        'per_joint.arm.joints': ('elbow',),
        'per_joint.lab.model': 'cart_pendulum',
        'per_joint.lab.joints': ('p', 'c'),
    }
    node = own('mechanical', input='effort_command', **values)
    encode, decode, stream, answers = node.encode, Decoder().decode, node.node.stream, []

    def about(key):
        return str(stream.about('lab')[key])

    def first(key):
        return float(about(key).split(', ')[0])

    for k in range(300):
        stamp = BEGIN + k * 2 * MS
        stream.feed(1, encode(stamp, '', ('elbow', 'c'), (), (), (0.0, 0.0)), 0)
        for names, positions in ((('p', 'elbow'), (0.1, 2e-3 * k)), (('c',), (0.0,))):
            raw = encode(stamp + MS, '', names, positions)
            answers += [decode(answer[0]) for answer in stream.feed(0, raw, 0) if answer]
    last = answers[-2:]
    assert [answer.names for answer in last] == [('elbow',), ('c', 'p')]  # as it came
    assert [estimated(answer) for answer in last] == [('elbow',), ('c', 'p')]
    assert last[0].velocities[0] == pytest.approx(1.0, abs=0.01)
    node.pass_time(0.1)
    assert node.status_of('lab')[0] == TRACKING
    assert about('input') == 'effort_command' and about('incomplete') == '0'
    K, L = first('K'), first('L')
    assert first('noise_figure') == pytest.approx(K * K / (2.0 * L), rel=1e-3)
    assert first('dt_K') == pytest.approx(2e-3 * K, rel=1e-3)
    for key in ('poles', 'slowest_pole_over_range', 'guaranteed_rate', 'dt_K_below_L'):
        assert about(key)
    assert node.set(bandwidth_hz=-3.0)
    assert "mechanism 'leg'" in node.set(per_joint__leg__bandwidth_hz=3.0)
    scales = node.set(per_joint__arm__input_scale=[1.0, 2.0])
    assert "'arm': 'input_scale' has 2 numbers" in scales
    assert not node.set(disturbance_hz=3.0) and not node.set(disturbance_hz=0.0)
    assert not node.set(bandwidth_hz=25.0)
    stream.feed(0, encode(stamp + 3 * MS, '', ('p', 'c'), (0.1, 0.0)), 0)
    assert first('K') > 1.5 * K


@pytest.mark.slow
def test_the_pendulum_stays_up_with_the_observer_in_the_loop(probe):
    """The controller's velocities come from the observer node's topic, over DDS."""
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import JointState

    positions = []

    def came(message):
        positions.append(
            (message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec, *message.position)
        )

    subscription = probe.node.create_subscription(
        JointState, '/loop/joint_states', came, qos_profile_sensor_data
    )
    numbers = '[force_constant=9.27, friction_forward=3.98, friction_backward=2.87]'
    observer = [
        'model:=cart_pendulum',
        f'model_parameters:={numbers}',
        'L:=[50.0, 80.0]',
        'Gamma:=[80.0, 150.0]',
    ]
    plant = ['control:=observer', 'wait_for_subscribers:=2', 'duration:=9.0']
    there = '__ns:=/loop'
    with (
        dds.NodeProcess(MODULE, *dds.ros_args(*observer, remap=[there])),
        dds.NodeProcess(
            'sim_pkg.nodes.executables cart_pendulum_sim',
            *dds.ros_args(*plant, remap=[there, 'estimate:=mechanical_observer/estimate']),
        ) as simulator,
    ):
        probe.until(lambda: not simulator.alive)
        assert simulator.ends() == 0
    probe.node.destroy_subscription(subscription)
    assert positions[-1][0] - positions[0][0] > 5.0
    angles, cart = np.array(positions)[:, 1], np.array(positions)[:, 2]
    assert np.max(np.abs(angles)) < 0.5 * math.pi / 2.0
    assert np.max(np.abs(angles[-400:])) < 0.1
    assert np.ptp(cart) > 0.1  # it follows the triangle, so it was let go
