# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The first messages of a stream are answered; a node in an executor of the user's."""

import re
import threading
import time
from pathlib import Path

import dds
import pytest
from sensor_msgs.msg import JointState
from stream_roles import best_effort


@pytest.mark.parametrize('first', ['node', 'publisher'])
def test_the_first_messages_of_a_stream_are_answered(first, probe):
    """A publisher that waits for its subscription loses nothing, also where it comes back: the
    subscription ends with the last publisher, and its count of losses does not.
    """
    topic = f'/{first}_first'
    words = dds.ros_args(remap=(f'joint_states:={topic}',))

    def publisher():
        return probe.node.create_publisher(JointState, topic, best_effort(50))

    waiting = publisher() if first == 'publisher' else None
    with (
        dds.NodeProcess('estimator_pkg.nodes.executables joint_observer', *words),
        dds.Observer(probe, topic='/unused') as listener,
    ):
        if first == 'node':
            probe.until(lambda: listener.reports)
            entry = listener.diagnostics['/joint_observer']
            assert entry.message == f'no input: waits for a publisher of {topic}'
        for done in range(2):
            source, waiting = waiting or publisher(), None
            probe.until(source.get_subscription_count)
            begun = time.time_ns()
            for k in range(100):
                source.publish(listener.encode(begun + k * 1_000_000, ['a'], [1e-3 * k]))
                probe.spin(1e-3)
            due = 100 * (done + 1)
            if not dds.until(
                lambda due=due: len(listener.answers) == due, lambda: probe.spin(0.01)
            ):
                report = listener.next_report()['/joint_observer']
                pytest.fail(f'stream {done + 1}: {len(listener.answers)} of {due}: {report}')
            probe.node.destroy_publisher(source)
            probe.until(lambda: not probe.node.count_subscribers(topic))
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
