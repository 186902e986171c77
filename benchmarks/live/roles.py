# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Roles of the live benchmarks around a measured node, each in its own process."""

from __future__ import annotations

import json
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from estimator_pkg.ros.runtime import run as run_node  # first: rclpy reads it  # isort: skip

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from benchmarks.drive import simulate
from benchmarks.live.processes import JOINTS, NULL, NULL_DRIVE
from estimator_pkg.messages import vector3
from estimator_pkg.messages.joint_state import Decoder, Encoder

TURNING = 2.0 * math.pi / 6.0  # of the published motion [rad/s]


def say(**words: Any) -> None:
    """Print a line of JSON."""
    print(json.dumps(words), flush=True)


def publish(hz: str, seconds: str, count: str, subscribers: str = '1') -> None:
    """Publish `count` joints at `hz` by absolute deadlines; print how many messages at the end."""
    messages = int(float(hz) * float(seconds))
    took = _play(float(hz), messages, int(count), int(subscribers))
    say(published=messages, seconds=took)
    time.sleep(1.0)
    rclpy.shutdown()


def feed(hz: str) -> None:
    """Publish at `hz` until SIGINT."""
    _play(float(hz), sys.maxsize, JOINTS, 0)


def feed_drive(hz: str) -> None:
    """Publish currents and voltages of a simulated drive at `hz`, stamped when sent, for 20 s."""
    signal = {'publish_rate': float(hz), 'profile': 'ramps', 'profile_time': 1.0}
    samples = simulate(signal, 20.0).samples.tolist()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('benchmark_drive')
    outputs = [node.create_publisher(Vector3Stamped, name, 50) for name in ('current', 'voltage')]
    for sample, _ in zip(samples, _paced(float(hz), len(samples))):
        stamp = time.time_ns()
        for k, output in enumerate(outputs):
            output.publish(vector3.encode(stamp, '', *sample[2 * k : 2 * k + 2]))


def _paced(rate: float, count: int) -> Iterator[int]:
    """Count at this rate, by absolute deadlines."""
    begun = time.perf_counter()
    for i in range(count):
        wait = begun + i / rate - time.perf_counter()
        if wait > 0.0:
            time.sleep(wait)
        yield i


def _play(rate: float, count: int, joints: int, subscribers: int) -> float:
    """Publish JointStates with efforts, stamped when sent; return the seconds that it took."""
    publisher, names, encode = *_publisher(joints, subscribers), Encoder().encode
    begun = time.perf_counter()
    for i in _paced(rate, count):
        angle = math.sin(TURNING * i / rate)
        positions, efforts = [angle] * joints, [-0.1 * TURNING * TURNING * angle] * joints
        publisher.publish(encode(time.time_ns(), 'base', names, positions, (), efforts))
    return time.perf_counter() - begun


def _publisher(joints: int, subscribers: int) -> tuple[Any, list[str]]:
    """Return (publisher with this number of subscribers, names of the joints)."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # SIGINT ends the process
    publisher = rclpy.create_node('benchmark_publisher').create_publisher(
        JointState, 'joint_states', 10
    )
    while publisher.get_subscription_count() < subscribers:
        time.sleep(0.02)
    if subscribers:
        time.sleep(1.0)  # until the other processes are connected
        print('started', flush=True)
    return publisher, [f'joint_{i}' for i in range(joints)]


def time_answers(topic: str) -> None:
    """Print when the first estimate arrives, and on SIGINT the latencies.

    First a line 'listening'. Then a line of JSON each: {"estimate": ns} (a message whose velocities
    are not all nan), and the number of answers with their times from stamp to receipt [ms].
    """
    late: list[int] = []
    printed: list[int] = []

    def make() -> Node:
        node, layout = rclpy.create_node('benchmark_clock'), Decoder().layout

        def take(raw: Any) -> None:  # bytes: the subscription is raw
            now = time.time_ns()
            found = layout(raw)
            late.append(now - found.stamp_ns(raw))
            velocities = found.numbers(raw, 1)
            if not printed and not (velocities and all(map(math.isnan, velocities))):
                printed.append(now)
                say(estimate=now)

        node.create_subscription(JointState, topic, take, 5000, raw=True)
        print('listening', flush=True)
        return node

    run_node(make, [])
    steady = sorted(late[len(late) // 4 :])  # without the time after the connection
    times = {}
    if steady:
        times['median_ms'] = 1e-6 * statistics.median(steady)
        times['late_ms'] = 1e-6 * steady[int(0.99 * (len(steady) - 1))]
    say(answered=len(late), **times)


def diagnose() -> None:
    """Print, on SIGINT, the newest counters that joint_observer reported."""
    newest: dict[str, str] = {}

    def came(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == '/joint_observer':
                newest.update({item.key: item.value for item in status.values})

    def make() -> Node:
        node = rclpy.create_node('benchmark_diagnosis')
        node.create_subscription(DiagnosticArray, '/diagnostics', came, 10)
        return node

    run_node(make, [])
    say(**newest)


def null_node() -> None:
    """Receive and republish JointStates, typed, as any rclpy node would: the minimum cost."""

    def make() -> Node:
        node = rclpy.create_node(NULL)
        publisher = node.create_publisher(JointState, '~/estimate', 50)
        quality = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
        node.create_subscription(JointState, 'joint_states', publisher.publish, quality)
        return node

    run_node(make, [])


def null_drive() -> None:
    """Receive currents and voltages, typed, and publish a JointState for each voltage."""

    def make() -> Node:
        node = rclpy.create_node(NULL_DRIVE)
        publisher = node.create_publisher(JointState, '~/estimate', 50)
        quality = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)

        def answer(voltage: Vector3Stamped) -> None:
            publisher.publish(JointState(header=voltage.header, name=['rotor'], velocity=[0.0]))

        node.create_subscription(Vector3Stamped, 'current', lambda current: None, quality)
        node.create_subscription(Vector3Stamped, 'voltage', answer, quality)
        return node

    run_node(make, [])


ROLES: dict[str, Callable[..., None]] = {
    each.__name__: each
    for each in (publish, feed, feed_drive, time_answers, diagnose, null_node, null_drive)
}
if __name__ == '__main__':
    ROLES[sys.argv[1]](*sys.argv[2:])
