# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a plugin of ros2_control that reads a topic needs of us; see docs/ros2_control.md."""

import math
import time
from pathlib import Path
from xml.etree import ElementTree

import dds
import pytest
import yaml
from ament_index_python.packages import get_package_share_directory

MODULE = 'estimator_pkg.nodes.executables joint_observer'
FILES = Path(get_package_share_directory('velocity_estimator'), 'config', 'ros2_control')
TURN = 2.0 * math.pi
FRAGMENT = ElementTree.parse(FILES / 'joint_state_topic.ros2_control.xacro').getroot()
LOST = 'elbow_joint'
NAMES = [
    'shoulder_pan_joint',
    'shoulder_lift_joint',
    'elbow_joint',
    'wrist_1_joint',
    'wrist_2_joint',
    'wrist_3_joint',
]


def parameters(name):
    return yaml.safe_load((FILES / name).read_text())


def hardware(name):
    return FRAGMENT.find(f"ros2_control/hardware/param[@name='{name}']").text


def declared():
    """The state interfaces of the fragment, as the plugin names them."""
    return {
        f'{joint.get("name")}/{each.get("name")}'
        for joint in FRAGMENT.findall('ros2_control/joint')
        for each in joint.findall('state_interface')
    }


class Plugin:
    """The states of JointStateTopicSystem: `read` copies the newest message into them.

    Parameters
    ----------
    finite_only : as from version 1.0.0 on; False: as up to 0.2.1.
    """

    def __init__(self, finite_only):
        self.states = dict.fromkeys(declared(), math.nan)
        self.finite_only = finite_only

    def read(self, message):
        for i, name in enumerate(message.name):
            if f'{name}/position' not in self.states:
                continue  # not a joint of the URDF
            for kind in ('position', 'velocity', 'effort'):
                values = getattr(message, kind)
                if not len(values):
                    continue
                value = values[i]  # throws where the array is too short
                if self.finite_only and not math.isfinite(value):
                    continue
                if f'{name}/{kind}' not in self.states:
                    raise KeyError(f'{name}/{kind}')  # the plugin throws, and is deactivated
                self.states[f'{name}/{kind}'] = value


def test_the_files_fit_each_other_and_the_node():
    names = [joint.get('name') for joint in FRAGMENT.findall('ros2_control/joint')]
    assert names == NAMES
    assert FRAGMENT.find('ros2_control/hardware/plugin').text == (
        'joint_state_topic_hardware_interface/JointStateTopicSystem'
    )
    node = parameters('joint_observer.yaml')['/**']['ros__parameters']
    assert node['joints'] == names and node['no_estimate'] == 'skip'
    controllers = parameters('controllers.yaml')
    following = controllers['joint_trajectory_controller']['ros__parameters']
    assert following['joints'] == names
    interfaces = {f'{name}/{kind}' for name in names for kind in following['state_interfaces']}
    assert interfaces <= declared()
    assert declared() == {
        f'{name}/{kind}' for name in names for kind in ('position', 'velocity', 'effort')
    }
    assert hardware('joint_states_topic') == '/joint_observer/estimate'
    for names in (hardware('joint_states_topic'), hardware('joint_commands_topic')):
        assert names != '/joint_states'  # of joint_state_broadcaster


def test_the_plugin_gets_states_of_one_instant_and_nothing_while_a_joint_is_lost(probe):
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import JointState

    remap = ('joint_states:=/driver/joint_states',)
    words = dds.ros_args(remap=remap, file=FILES / 'joint_observer.yaml')
    plugins, came = [Plugin(finite_only) for finite_only in (False, True)], []
    driver = probe.node.create_publisher(JointState, '/driver/joint_states', 50)
    sent = {}  # (positions, velocities) by stamp

    def receive(message):
        came.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
        for plugin in plugins:
            plugin.read(message)
        assert all(map(math.isfinite, plugins[0].states.values()))
        assert plugins[0].states == plugins[1].states
        assert list(message.name) == NAMES  # the gripper holds nothing back
        assert len(message.position) == len(message.velocity) == len(message.effort) == 6

    def drive(seconds, lost=False):
        """A driver at 250 Hz with a gripper that never moves; `lost` loses the elbow's angle."""
        first = len(sent)
        while len(sent) < first + 250 * seconds:
            begun, angles = time.time_ns(), [0.3 * time.time() % TURN + k for k in range(6)]
            positions = [0.3 * math.sin(angle) for angle in angles]
            sent[begun] = positions, [0.09 * math.cos(angle) for angle in angles]
            message = JointState(name=[*NAMES, 'gripper'], effort=[float(len(sent))] * 7)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(begun, 10**9)
            message.position = [*positions, math.nan]
            if lost:
                message.position[NAMES.index(LOST)] = math.nan
            driver.publish(message)
            probe.executor.spin_once(timeout_sec=0.003)

    # rclcpp::SensorDataQoS, as the plugin has it: best effort, volatile, depth 5
    assert qos_profile_sensor_data.depth == 5
    probe.node.create_subscription(
        JointState, hardware('joint_states_topic'), receive, qos_profile_sensor_data
    )
    with dds.NodeProcess(MODULE, *words) as node:
        probe.until(driver.get_subscription_count)
        drive(1.2)
        states, stamp, before = dict(plugins[0].states), came[-1], len(sent)
        drive(0.2, lost=True)
        during = len(came)
        drive(0.8, lost=True)  # it is lost, not only coasting
        assert len(came) == during
        after = len(sent)
        drive(0.5)
        assert len(came) > during + 50
        assert 'incompatible QoS' not in node.output and 'Traceback' not in node.output
    assert not set([*sent][before:after]) & set(came)
    assert came == sorted(set(came))
    for joint, position, velocity in zip(NAMES, *sent[stamp]):
        assert states[f'{joint}/position'] == pytest.approx(position, abs=5e-3)
        assert states[f'{joint}/velocity'] == pytest.approx(velocity, abs=0.05)
