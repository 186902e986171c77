# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node mechanical_observer over real DDS: several mechanisms, the loop closed with it."""

import math

import dds
import numpy as np
import pytest
from answers import estimated

from estimator_pkg.messages.joint_state import Encoder

MODULE = 'estimator_pkg.nodes.executables mechanical_observer'
MS = 1_000_000


def test_several_mechanisms_separate_messages_and_commands(probe):
    """Two mechanisms; one's joints come in separate messages; the input is a topic of its own."""
    from sensor_msgs.msg import JointState

    with dds.commanded(
        probe,
        'mechanical_observer',
        'several',
        JointState,
        'mechanisms:=[arm, lab]',
        'bandwidth_hz:=20.0',
        'per_joint.arm.joints:=[elbow]',
        'per_joint.lab.model:=cart_pendulum',
        'per_joint.lab.joints:=[p, c]',
    ) as (node, command):
        encode, start = Encoder().encode, 10**15
        for k in range(300):
            stamp = start + k * 2 * MS
            command.publish(encode(stamp, '', ('elbow', 'c'), (), (), (0.0, 0.0)))
            node.feed(
                [
                    encode(stamp + MS, '', ('p', 'elbow'), (0.1, 2e-3 * k)),
                    encode(stamp + MS, '', ('c',), (0.0,)),
                ]
            )
        last = node.answers[-2:]
        assert [answer.names for answer in last] == [('elbow',), ('c', 'p')]  # as it came
        assert [estimated(answer) for answer in last] == [('elbow',), ('c', 'p')]
        assert last[0].velocities[0] == pytest.approx(1.0, abs=0.01)
        assert node.status('lab') in ('tracking', '')
        probe.until(lambda: node.status('lab') == 'tracking')
        entry = node.statuses['lab']
        assert dds.value(entry, 'input') == 'effort_command'
        assert dds.value(entry, 'incomplete') == '0'
        K, L = (float(dds.value(entry, key).split(', ')[0]) for key in ('K', 'L'))
        assert float(dds.value(entry, 'noise_figure').split(', ')[0]) == pytest.approx(
            K * K / (2.0 * L), rel=1e-3
        )
        assert float(dds.value(entry, 'dt_K').split(', ')[0]) == pytest.approx(2e-3 * K, rel=1e-3)
        for key in ('poles', 'slowest_pole_over_range', 'guaranteed_rate', 'dt_K_below_L'):
            assert dds.value(entry, key)
        assert not node.set(bandwidth_hz=-3.0).successful
        assert "mechanism 'leg'" in node.set(per_joint__leg__bandwidth_hz=3.0).reason
        assert (
            "'arm': 'input_scale' has 2 numbers"
            in node.set(per_joint__arm__input_scale=[1.0, 2.0]).reason
        )
        assert node.set(disturbance_hz=3.0).successful and node.set(disturbance_hz=0.0).successful
        assert node.set(bandwidth_hz=25.0).successful
        probe.until(lambda: float(dds.value(node.statuses['lab'], 'K').split(', ')[0]) > 1.5 * K)


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
