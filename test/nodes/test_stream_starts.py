# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The first messages of a stream: what a relay next to the node gets, the node answers."""

import signal
import time

import dds
import pytest
from stream_roles import MESSAGES, best_effort, stamp_of
from stream_starts import ORDERS, start

from estimator_pkg.messages.joint_state import Encoder


def check(probe, order, count):
    """Start so often; fails if any start lost a message that the relay got, or did not count it."""
    starts = [start(probe, order) for _ in range(count)]
    worse = [found for found in starts if found['missed']]
    assert not worse, f'{len(worse)} of {count} starts: {worse}'
    assert all(found['received'] + found['counted'] == MESSAGES for found in starts), starts


@pytest.mark.parametrize('order', ORDERS)
def test_the_first_messages_of_a_stream_are_answered(probe, order):
    check(probe, order, 1)


@pytest.mark.slow
@pytest.mark.timeout(1200)  # 280 to 310 s on a slow machine
@pytest.mark.parametrize('order', ORDERS)
def test_of_100_starts_none_loses_a_message(probe, order):
    check(probe, order, 100)


def test_a_publisher_that_comes_back_is_subscribed_to_anew(probe):
    """The subscription ends with the last publisher, and its count of losses does not."""
    from sensor_msgs.msg import JointState

    words = dds.ros_args(remap=('joint_states:=/returning',))
    with (
        dds.NodeProcess('estimator_pkg.nodes.executables joint_observer', *words),
        dds.Observer(probe, topic='/unused') as listener,
    ):
        probe.until(lambda: listener.reports)
        entry = listener.diagnostics['/joint_observer']
        assert entry.message == 'no input: waits for a publisher of /returning'
        for done in range(3):
            publisher = probe.node.create_publisher(JointState, '/returning', best_effort(50))
            probe.until(publisher.get_subscription_count)
            begun = time.time_ns()
            for k in range(100):
                publisher.publish(listener.encode(begun + k * 1_000_000, ['a'], [1e-3 * k]))
                probe.spin(1e-3)
            due = 100 * (done + 1)
            if not dds.until(
                lambda due=due: len(listener.answers) == due, lambda: probe.spin(0.01)
            ):
                report = listener.next_report()['/joint_observer']
                there = {answer.stamp_ns for answer in listener.answers}
                missed = [k for k in range(100) if begun + k * 1_000_000 not in there]
                pytest.fail(f'stream {done + 1}: {missed} not answered; the node says {report}')
            probe.node.destroy_publisher(publisher)
            probe.until(lambda: not probe.node.count_subscribers('/returning'))
        values = listener.next_report()['/joint_observer']
        assert (values['lost_by_dds'], values['messages_received']) == ('0', '300')
        # a bridge may publish only where somebody has subscribed
        probe.until(lambda: probe.node.count_subscribers('/returning'))


@pytest.mark.slow
def test_what_is_lost_after_a_process_was_killed_is_counted(probe):
    """Fast DDS writes to the shared memory of the killed one for up to two seconds.

    The publisher knows the next node, which has the same port, before that is over.
    """
    from sensor_msgs.msg import JointState

    for number in range(4):
        topic = f'/killed_{number}'
        words = dds.ros_args(remap=(f'joint_states:={topic}',))
        with (
            dds.NodeProcess('estimator_pkg.nodes.executables joint_observer', *words) as process,
            dds.Observer(probe, topic='/unused') as listener,
        ):
            publisher = probe.node.create_publisher(JointState, topic, best_effort(50))
            probe.until(publisher.get_subscription_count)
            begun, sent = time.time_ns(), 0
            while sent < 100 or len(listener.answers) < 2:  # their spacing shows what is lost
                stamp = begun + sent * 1_000_000
                publisher.publish(listener.encode(stamp, ['a'], [1e-3 * sent]))
                sent += 1
                probe.spin(1e-3)
            values = listener.next_report()['/joint_observer']
            assert int(values['messages_received']) + int(values['lost_by_dds']) == sent, number
            process.signal(signal.SIGKILL)
            probe.node.destroy_publisher(publisher)


def test_a_subscriber_that_never_connects_does_not_keep_the_input_away(probe):
    """The node waits for the subscribers of its answers; one with a wrong QoS never connects."""
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import JointState

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    probe.node.create_subscription(JointState, '/joint_observer/estimate', print, latched)
    words = dds.ros_args(remap=('joint_states:=/waited_for',))
    with (
        dds.NodeProcess('estimator_pkg.nodes.executables joint_observer', *words),
        dds.Observer(probe, topic='/waited_for') as listener,
    ):
        listener.connect()
        begun = time.time_ns()
        raws = [listener.encode(begun + k * 1_000_000, ['a'], [1e-3 * k]) for k in range(20)]
        assert len(listener.feed(raws)) == 20


def test_the_first_answers_wait_for_a_subscriber_that_is_discovered_late(probe):
    """On a busy machine DDS discovers a process seconds late; this one comes after the messages."""
    from sensor_msgs.msg import JointState

    encode, kept = Encoder().encode, {'estimate': [], 'estimate_stddev': []}
    words = dds.ros_args(remap=('joint_states:=/early',))
    with dds.NodeProcess('estimator_pkg.nodes.executables joint_observer', *words):
        publisher = probe.node.create_publisher(JointState, '/early', best_effort(50))
        probe.until(publisher.get_subscription_count)
        begun = time.time_ns()
        stamps = [begun + k * 1_000_000 for k in range(300)]
        for k, stamp in enumerate(stamps):
            publisher.publish(encode(stamp, '', ['a'], [1e-3 * k]))
            probe.spin(1e-3)
        subscriptions = [
            probe.node.create_subscription(
                JointState, f'/joint_observer/{topic}', rows.append, 1000, raw=True
            )
            for topic, rows in kept.items()
        ]
        probe.until(lambda: all(len(rows) == len(stamps) for rows in kept.values()))
        assert all([stamp_of(raw) for raw in rows] == stamps for rows in kept.values())
        for subscription in subscriptions:
            probe.node.destroy_subscription(subscription)
        probe.node.destroy_publisher(publisher)
