# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Late subscribers: what they get of ~/estimate, over real DDS."""

import dds
import pytest

from estimator_pkg.messages.joint_state import Decoder, Encoder

MODULE = 'estimator_pkg.nodes.executables joint_observer'
LATCHED = 'qos_overrides./{0}/joint_states.publisher.durability:=transient_local'


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
