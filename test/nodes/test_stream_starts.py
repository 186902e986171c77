# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The first messages of a stream: what a relay next to the node gets, the node answers."""

import re
import threading
import time
from pathlib import Path

import dds
import pytest
from stream_roles import MESSAGES, best_effort
from stream_starts import ORDERS, start


def check(probe, order, count):
    """Start so often; fails if any start lost a message that the relay got, or did not count it."""
    starts = [start(probe, order) for _ in range(count)]
    worse = [found for found in starts if found['missed']]
    assert not worse, f'{len(worse)} of {count} starts: {worse}'
    assert all(found['received'] + found['counted'] == MESSAGES for found in starts), starts


@pytest.mark.parametrize('order', ['publisher first', 'node first'])
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
        for done in range(2):
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
        assert (values['lost_by_dds'], values['messages_received']) == ('0', '200')


def test_the_code_of_the_page_starts_and_ends_a_node(probe):
    page = Path(__file__).parents[2] / 'docs/ros_tools.md'
    start, end = re.findall(r'```python\n(.*?)```', page.read_text(), re.DOTALL)
    for _ in range(2):
        exec(start, names := {})
        spins = threading.Event()

        def spin(executor=names['executor'], ends=spins):
            while not ends.is_set():
                executor.spin_once(timeout_sec=0.1)

        thread = threading.Thread(target=spin)
        thread.start()
        with dds.Observer(probe, '/arm_observer') as live:
            live.connect()
            raws = [live.encode(10**18 + k * 10**6, ['a'], [1e-3 * k]) for k in range(50)]
            assert len(live.feed(raws)) == 50
            spins.set()
            thread.join()
            exec(end, names)
            probe.until(lambda live=live: not live.publisher.get_subscription_count())
        names['executor'].shutdown()
