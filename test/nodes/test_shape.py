# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Subscribers of others: what they get of ~/estimate, in which shape, over real DDS."""

import math

import dds
import pytest

from estimator_pkg.messages.joint_state import Decoder, Encoder

MODULE = 'estimator_pkg.nodes.executables joint_observer'
LATCHED = 'qos_overrides./{0}/joint_states.publisher.durability:=transient_local'
NAMES = ['slide', 'hinge', 'tool']
BEGIN, MS = 10**18, 1_000_000


def driver(count, first=0, lacking=()):
    """(positions, efforts) of the messages of a driver; at `lacking` the hinge gives NaN."""
    return [
        ([0.1 + 1e-3 * k, math.nan if k in lacking else 0.2 - 2e-3 * k, -0.3], [1.0 + k, -2.0, 0.5])
        for k in range(first, first + count)
    ]


class Stranger:
    """Reads names, positions, velocities and efforts of plain JointStates, by number."""

    def __init__(self, probe, topic):
        from sensor_msgs.msg import JointState

        self.probe, self.found = probe, []
        self._publisher = probe.node.create_publisher(JointState, '/driver', 50)
        self._heard = probe.node.create_subscription(JointState, topic, self.found.append, 1000)
        self._encode = Encoder().encode

    def __enter__(self):
        self.probe.until(
            lambda: self._publisher.get_subscription_count() and self._heard.get_publisher_count()
        )
        self.probe.spin(0.3)
        return self

    def __exit__(self, *error):
        self.probe.node.destroy_publisher(self._publisher)
        self.probe.node.destroy_subscription(self._heard)

    def publish(self, messages, first=0):
        for k, (positions, efforts) in enumerate(messages, first):
            self._publisher.publish(
                self._encode(BEGIN + k * MS, 'base', NAMES, positions, (), efforts)
            )
            self.probe.spin(0.002)


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_every_message_has_the_shape_of_the_drivers_from_the_first_on(probe):
    """Remapped to a robot's /joint_states, the estimate replaces the driver's own topic."""
    words = dds.ros_args(
        remap=('joint_states:=/driver', '~/estimate:=/robot/joint_states', '__node:=shaped')
    )
    with dds.NodeProcess(MODULE, *words), Stranger(probe, '/robot/joint_states') as stranger:
        messages = driver(400, lacking=range(300, 310))
        stranger.publish(messages)
        stranger.publish(messages[399:], first=399)  # a duplicate is not answered
        probe.until(lambda: len(stranger.found) >= 400)
        probe.spin(0.2)
        found = stranger.found
    assert [stamp_of(each) for each in found] == [BEGIN + k * MS for k in range(400)]
    for k, (each, (positions, efforts)) in enumerate(zip(found, messages)):
        assert list(each.name) == NAMES and each.header.frame_id == 'base'
        assert len(each.position) == len(each.velocity) == len(each.effort) == 3
        assert list(each.effort) == efforts
        for place in range(3):
            if math.isnan(each.velocity[place]):
                assert each.position[place] == pytest.approx(positions[place], nan_ok=True)
        if k == 0:
            assert all(map(math.isnan, each.velocity))
        elif 300 <= k < 310:  # the others go on where one drops out
            assert math.isnan(each.velocity[1]) and math.isnan(each.position[1])
            assert each.velocity[0] == pytest.approx(1.0, rel=1e-3)
        elif k > 320:
            assert list(each.velocity) == pytest.approx([1.0, -2.0, 0.0], abs=1e-2)


@pytest.mark.parametrize(
    ('name', 'parameters', 'durability', 'old'),
    [
        ('kept', ('wait_for_subscriber:=60.0',), 'volatile', 100),
        ('latched', (LATCHED.format('latched'),), 'transient_local', 1),
    ],
)
def test_what_a_late_subscriber_gets_of_the_messages_before(
    name, parameters, durability, old, probe
):
    """The first one all that waited for it; of a latched topic each gets the last one."""
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import JointState

    encode, decode, node = Encoder().encode, Decoder().decode, probe.node
    driver = node.create_publisher(JointState, f'/{name}/joint_states_raw', 200)
    reliable = f'qos_overrides./{name}/joint_states_raw.subscription.reliability:=reliable'
    used = {}

    def diagnosed(message):
        (entry, *_) = message.status
        used[entry.name] = int(dds.value(entry, 'messages_used'))

    reports = node.create_subscription(DiagnosticArray, '/diagnostics', diagnosed, 50)
    remap = ('joint_states:=joint_states_raw', '~/estimate:=joint_states', f'__ns:=/{name}')
    qos = QoSProfile(depth=1000, durability=DurabilityPolicy[durability.upper()])

    def drive(first, count):
        for k in range(first, first + count):
            driver.publish(encode((k + 1) * 10_000_000, '', ['a'], [0.01 * k]))
            probe.spin(0.005)
        probe.until(lambda: used.get(f'/{name}/joint_observer') == first + count)

    def subscribe():
        got = []
        listener = node.create_subscription(
            JointState,
            f'/{name}/joint_states',
            lambda raw: got.append(decode(raw).stamp_ns // 10_000_000 - 1),
            qos,
            raw=True,
        )
        probe.until(listener.get_publisher_count)
        probe.spin(0.5)
        return got

    with dds.NodeProcess(MODULE, *dds.ros_args(reliable, *parameters, remap=remap)) as process:
        probe.until(driver.get_subscription_count)
        drive(0, 100)
        first = subscribe()
        assert first == list(range(100))[100 - old :], process.output
        drive(100, 20)
        probe.until(lambda: first[-1] == 119)
        assert first[old:] == list(range(100, 120))
        assert subscribe() == ([119] if durability == 'transient_local' else [])
    node.destroy_subscription(reports)
