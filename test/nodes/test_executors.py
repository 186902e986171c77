# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Our executor, and the node in executors of the user's."""

import re
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import dds
import pytest
import rclpy
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from stream_roles import best_effort

from estimator_pkg.nodes.observer import ObserverNode
from estimator_pkg.nodes.ros_parameters import ros_values
from estimator_pkg.ros.executor import SteadyExecutor
from estimator_pkg.ros.runtime import make_executor


def turning(live, names, count, first=0):
    """Messages of shafts that turn at 1 rad/s, each ms."""
    return [
        live.encode(10**18 + k * 10**6, names, [1e-3 * k] * len(names))
        for k in range(first, first + count)
    ]


def test_a_stream_that_is_too_fast_starves_no_service(probe):
    """A callback of 2 ms and a message every 0.3 ms: the queue of events must not grow."""
    context = Context()
    rclpy.init(context=context, domain_id=dds.DOMAIN)
    busy, taken = rclpy.create_node('busy', context=context), []

    def slow(raw):
        taken.append(raw)
        time.sleep(2e-3)

    def answer(request, response):
        response.message = str(len(taken))
        return response

    busy.create_subscription(Float64, 'flood', slow, best_effort(50), raw=True)
    busy.create_service(Trigger, 'busy', answer)
    executor = SteadyExecutor(context=context)
    executor.add_node(busy)
    flowing, ended = threading.Event(), threading.Event()

    def spin():
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.05)

    def flood():
        while flowing.is_set():
            publisher.publish(bytes(12))
            time.sleep(2e-4)

    def handled():
        return int(probe.call(Trigger, 'busy', Trigger.Request()).message)

    publisher = probe.node.create_publisher(Float64, 'flood', 50)
    flowing.set()
    threads = [threading.Thread(target=spin), threading.Thread(target=flood)]
    try:
        threads[0].start()
        probe.until(publisher.get_subscription_count)
        threads[1].start()
        assert dds.until(lambda: executor.in_turns)
        for _ in range(5):
            before = len(taken)
            assert handled() - before < 250  # events queued in the meantime would be thousands
        flowing.clear()
        time.sleep(0.5)  # the queue runs empty
        count = len(taken)
        publisher.publish(bytes(12))
        assert dds.until(lambda: len(taken) == count + 1)
        assert handled() == count + 1
    finally:
        flowing.clear()
        ended.set()
        for thread in threads:
            thread.join()
        executor.shutdown()
        busy.destroy_node()
        rclpy.shutdown(context=context)


def test_an_event_of_a_destroyed_subscription_is_dropped(probe):
    """DDS queues that a publisher left, and its subscription is destroyed before the event runs."""
    executor, node = make_executor(), rclpy.create_node('leaving')
    executor.add_node(node)

    def spin(seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.01)

    try:
        matched = []
        callbacks = SubscriptionEventCallbacks(matched=matched.append)
        subscription = node.create_subscription(
            JointState, 'leaving', repr, 10, event_callbacks=callbacks
        )
        publisher = probe.node.create_publisher(JointState, 'leaving', 10)
        assert dds.until(lambda: matched, lambda: spin(0.01))
        probe.node.destroy_publisher(publisher)
        time.sleep(0.3)  # the event waits
        node.destroy_subscription(subscription)
        spin(0.2)
    finally:
        executor.shutdown()
        node.destroy_node()


@contextmanager
def spinning(executor, *nodes):
    """These nodes in an executor of the user's, in a thread."""
    for node in nodes:
        executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    try:
        yield thread
    finally:
        executor.shutdown()
        thread.join()
        for node in nodes:
            node.destroy_node()


def test_the_class_in_an_executor_of_ones_own(probe):
    """Which hands callbacks other arguments than EventsExecutor."""
    values = {'observer': 'finite_difference', 'joints': ('a',), 'bandwidth_hz': 100}
    options = {'namespace': '/own', 'parameter_overrides': ros_values(values)}
    node, made = ObserverNode('angle', 'mine', **options), []
    encode = node.stream._answering._stddev.encode
    node.stream._answering._stddev.encode = lambda *given: made.append(given) or encode(*given)
    with (
        spinning(SingleThreadedExecutor(), node),
        dds.Observer(probe, '/own/mine', '/own/joint_states') as live,
    ):
        live.connect()
        answer = live.feed(turning(live, ['a', 'b'], 200))[-1]
        assert answer.names == ('a',)
        assert answer.velocities == pytest.approx((1.0,), rel=1e-6)
        assert not made  # nobody listens, so no standard deviation is made
        listener = probe.node.create_subscription(
            JointState, '/own/mine/estimate_stddev', lambda message: None, 10
        )
        probe.until(listener.get_publisher_count)
        probe.spin(0.3)
        live.feed(turning(live, ['a'], 5, first=200))
        assert len(made) == 5
        assert '/own/mine/acceleration' not in dict(node.get_topic_names_and_types())


def test_publishers_come_and_go_while_several_threads_spin(probe):
    """What a callback destroys another thread may have taken, which ends its spin."""
    nodes = [ObserverNode('angle', name, namespace='/threads') for name in ('one', 'two')]

    def come_and_go():
        """A publisher that both nodes hear; return their subscriptions meanwhile."""
        publisher = probe.node.create_publisher(JointState, '/threads/joint_states', 10)
        before = [node.stream.received[0] for node in nodes]

        def heard():
            message = JointState(name=['a'], position=[0.1])
            message.header.stamp = probe.node.get_clock().now().to_msg()
            publisher.publish(message)
            return all(node.stream.received[0] > old for node, old in zip(nodes, before))

        probe.until(heard)
        probe.spin(0.3)
        subscriptions = [list(node.subscriptions) for node in nodes]
        probe.node.destroy_publisher(publisher)
        probe.spin(0.15)
        return subscriptions

    with spinning(MultiThreadedExecutor(2), *nodes) as thread:
        subscriptions = [come_and_go() for _ in range(2)]
        assert thread.is_alive() and subscriptions[0] == subscriptions[1]


def test_the_code_of_the_page_starts_and_ends_a_node(probe):
    page = Path(__file__).parents[2] / 'docs/ros_tools.md'
    start, end = re.findall(r'```python\n(.*?)```', page.read_text(), re.DOTALL)
    exec(start, names := {})
    ends = threading.Event()

    def spin():
        while not ends.is_set():
            names['executor'].spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin)
    thread.start()
    with dds.Observer(probe, '/arm_observer') as live:
        try:
            assert len(live.connect().feed(turning(live, ['a'], 50))) == 50
        finally:
            ends.set()
            thread.join()
        exec(end, names)
        probe.until(lambda: not live.publisher.get_subscription_count())
    names['executor'].shutdown()
