# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a plugin of ros2_control that reads a topic needs of us; see docs/ros2_control.md."""

import math
import threading
import time
from pathlib import Path
from xml.etree import ElementTree

import dds
import pytest
import yaml
from ament_index_python.packages import get_package_share_directory

MODULE = 'estimator_pkg.nodes.executables joint_observer'
FILES = Path(get_package_share_directory('velocity_estimator'), 'config', 'ros2_control')
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
DRIFT = [0.3, -0.2, 0.1, 0.0, -0.3, 0.4]  # [rad/s] at most, of a slow sine
SLOW, SWING, PACE = 2.0 * math.pi * 0.01, 0.3, 2.0 * math.pi * 0.2  # [rad/s, rad, rad/s]
TURN = 100 * 10**9  # [ns] after which both sines repeat


def motion(stamp_ns):
    """The positions and velocities of all joints at a stamp."""
    t = stamp_ns % TURN * 1e-9
    found = []
    for joint, drift in enumerate(DRIFT):
        slow, phase = SLOW * t, PACE * t + joint
        position = drift / SLOW * math.sin(slow) + SWING * math.sin(phase)
        found.append((position, drift * math.cos(slow) + SWING * PACE * math.cos(phase)))
    return [each[0] for each in found], [each[1] for each in found]


def efforts(count):
    """The efforts in the message number `count` of a driver: they carry its number."""
    return [count + 0.125 * joint for joint in range(len(NAMES))]


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


class Driver:
    """A UR's driver at 250 Hz with a gripper that never moves; `lost` loses the elbow's angle."""

    def __init__(self, node, topic):
        from sensor_msgs.msg import JointState

        self.lost = False
        self.lost_stamps = set()
        self._running = True
        self._publisher = node.create_publisher(JointState, topic, 50)
        self._message = JointState(name=[*NAMES, 'gripper'])
        self._clock = node.get_clock()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        message, count = self._message, 0
        while self._running:
            message.header.stamp = self._clock.now().to_msg()
            stamp = stamp_of(message)
            positions = [*motion(stamp)[0], math.nan]
            if self.lost:
                positions[NAMES.index(LOST)] = math.nan
                self.lost_stamps.add(stamp)
            message.position = positions
            message.effort = [*efforts(count), 0.0]
            self._publisher.publish(message)
            count += 1
            time.sleep(0.004)

    def close(self, node):
        self._running = False
        self._thread.join()
        node.destroy_publisher(self._publisher)


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_the_plugin_gets_states_of_one_instant_and_nothing_while_a_joint_is_lost(probe):
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import JointState

    words = dds.ros_args(
        remap=('joint_states:=/driver/joint_states',), file=FILES / 'joint_observer.yaml'
    )
    newest, came = {}, []

    def receive(message):
        newest['message'] = message
        came.append(stamp_of(message))
        for plugin in plugins:
            plugin.read(message)
        assert all(map(math.isfinite, plugins[0].states.values()))
        assert plugins[0].states == plugins[1].states
        assert list(message.name) == NAMES  # the gripper holds nothing back
        assert len(message.position) == len(message.velocity) == len(message.effort) == 6

    plugins = [Plugin(finite_only) for finite_only in (False, True)]
    # rclcpp::SensorDataQoS, as the plugin has it: best effort, volatile, depth 5
    assert qos_profile_sensor_data.depth == 5
    listener = probe.node.create_subscription(
        JointState, hardware('joint_states_topic'), receive, qos_profile_sensor_data
    )
    with dds.NodeProcess(MODULE, *words) as node:
        driver = Driver(probe.node, '/driver/joint_states')
        try:
            probe.until(lambda: len(came) > 300)
            states, stamp = dict(plugins[0].states), stamp_of(newest['message'])
            driver.lost = True
            probe.until(lambda: len(driver.lost_stamps) > 50)
            during = len(came)
            probe.until(lambda: len(driver.lost_stamps) > 250)  # it is lost, not only coasting
            assert len(came) == during
            driver.lost = False
            probe.until(lambda: len(came) > during + 100)
        finally:
            driver.close(probe.node)
            probe.node.destroy_subscription(listener)
        assert 'incompatible QoS' not in node.output and 'Traceback' not in node.output
    assert not driver.lost_stamps & set(came)
    assert came == sorted(set(came))
    for joint, position, velocity in zip(NAMES, *motion(stamp)):
        assert states[f'{joint}/position'] == pytest.approx(position, abs=5e-3)
        assert states[f'{joint}/velocity'] == pytest.approx(velocity, abs=0.05)
