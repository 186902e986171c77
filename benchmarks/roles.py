# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Processes of ``--part live`` and ``soak`` around a node: ``python -m benchmarks.roles ROLE``."""

from __future__ import annotations

import json
import math
import random
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

from estimator_pkg.ros.runtime import run as run_node  # first: rclpy reads it  # isort: skip

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from benchmarks.drive import RATE, simulate
from benchmarks.live import BATCHES, CURRENTS, JOINTS
from benchmarks.soak import RATE as SOAKED
from benchmarks.soak import Driver, counts
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.joint_state import Decoder, Encoder
from estimator_pkg.nodes.ros_parameters import ros_values

TURNING = 2.0 * math.pi / 6.0  # of the published motion [rad/s]
TOPICS = {
    JOINTS: {'joint_states': JointState},
    CURRENTS: {'current': Vector3Stamped, 'voltage': Vector3Stamped},
    BATCHES: {'drive_samples': Float64MultiArray},
}
Raw = Callable[[int, int], list[bytes]]  # (number, stamp [ns]) -> a message for each topic


def say(**words: Any) -> None:
    """Print a line of JSON."""
    print(json.dumps(words), flush=True)


def _joints(count: int, rate: float, messages: int) -> Raw:
    """Return messages of `count` joints with efforts."""
    encode, names = Encoder().encode, [f'joint_{i}' for i in range(count)]

    def raw(number: int, stamp: int) -> list[bytes]:
        angle = math.sin(TURNING * number / rate)
        efforts = [-0.1 * TURNING * TURNING * angle] * count
        return [encode(stamp, 'base', names, [angle] * count, (), efforts)]

    return raw


def _drive(rows: int, rate: float, messages: int) -> Raw:
    """Return samples of a simulated drive: a batch of `rows`, or one on two topics."""
    signal = {'publish_rate': rows * rate, 'profile': 'ramps', 'profile_time': 1.0}
    samples = simulate(signal, messages / rate).samples
    ages = np.arange(1 - rows, 1) * round(1e9 / RATE)

    def raw(number: int, stamp: int) -> list[bytes]:
        part = samples[number * rows : (number + 1) * rows]
        if rows > 1:
            return [drive_samples.encode(stamp + ages, part)]
        return [vector3.encode(stamp, '', *part[0, k : k + 2].tolist()) for k in (0, 2)]

    return raw


def play(kind: str, hz: str, seconds: str, size: str, subscribers: str) -> None:
    """Publish messages of `size` at `hz` by absolute deadlines, stamped when sent.

    Prints 'started' once there are enough subscribers on each topic, and the number of messages.
    """
    rate = float(hz)
    messages = round(rate * float(seconds))
    raw = (_joints if kind == JOINTS else _drive)(int(size), rate, messages)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # SIGINT ends the process
    node = rclpy.create_node('benchmark_publisher')
    publishers = [node.create_publisher(each, topic, 50) for topic, each in TOPICS[kind].items()]
    while min(each.get_subscription_count() for each in publishers) < int(subscribers):
        time.sleep(0.02)
    time.sleep(1.0)  # until the other processes are connected
    print('started', flush=True)
    begun = time.perf_counter()
    for number in range(messages):
        wait = begun + number / rate - time.perf_counter()
        if wait > 0.0:
            time.sleep(wait)
        for publisher, message in zip(publishers, raw(number, time.time_ns())):
            publisher.publish(message)
    say(published=messages)
    time.sleep(1.0)
    rclpy.shutdown()


def diagnose(node: Node, name: str, counters: dict[str, str]) -> None:
    """Keep the newest diagnostics of the node `name` in `counters`."""

    def diagnosed(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == f'/{name}':  # the node itself: its joints have entries, too
                counters.update({item.key: item.value for item in status.values})

    node.create_subscription(DiagnosticArray, '/diagnostics', diagnosed, 10)


def listen(name: str, estimates: str) -> None:
    """Print what a node answers: its first estimate [ns], and on SIGINT counts and latencies.

    Prints 'listening' first. Its estimates are received unless `estimates` is '0'. The latencies
    are from stamp to receipt [ms]; the counters are those of its newest diagnostics.
    """
    late: list[int] = []
    printed: list[int] = []
    counters: dict[str, str] = {}
    layout = Decoder().layout

    def take(raw: Any) -> None:  # bytes: the subscription is raw
        now, found = time.time_ns(), layout(raw)
        late.append(now - found.stamp_ns(raw))
        velocities = found.numbers(raw, 1)
        if not printed and not (velocities and all(map(math.isnan, velocities))):
            printed.append(now)
            say(estimate=now)

    def make() -> Node:
        node = rclpy.create_node(f'benchmark_listener_{name}')
        diagnose(node, name, counters)
        if estimates == '2':  # and their deviations, of which nothing is computed
            topic = f'/{name}/estimate_stddev'
            node.create_subscription(JointState, topic, lambda raw: None, 5000, raw=True)
        if estimates != '0':
            node.create_subscription(JointState, f'/{name}/estimate', take, 5000, raw=True)
        print('listening', flush=True)
        return node

    run_node(make, [])
    steady = sorted(late[len(late) // 4 :])  # without the time after the connection
    times = {}
    if steady:
        times['median_ms'] = 1e-6 * statistics.median(steady)
        times['late_ms'] = 1e-6 * steady[int(0.99 * (len(steady) - 1))]
    say(answered=len(late), counters=counters, **times)


def faulty(path: str) -> None:
    """Publish the messages of `benchmarks.soak.Driver`, which counts them in the file `path`."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node, driver = rclpy.create_node('faulty_driver'), Driver(counts(path))
    publisher = node.create_publisher(JointState, 'joint_states', 50)
    while not publisher.get_subscription_count():
        time.sleep(0.02)
    time.sleep(1.0)  # until the node is connected, too
    due = time.perf_counter()
    while True:
        due = max(due + 1.0 / SOAKED, time.perf_counter() - 0.1)
        time.sleep(max(0.0, due - time.perf_counter()))
        message, pause = driver.message()
        time.sleep(pause)
        publisher.publish(message)


def witness(name: str) -> None:
    """Change gains of a node every 2 s; print on SIGINT what it answered, and its counters.

    Prints 'listening' first. The number of a message is the first effort of its answer.
    """
    chance, layout = random.Random(2), Decoder().layout
    found: dict[str, Any] = dict.fromkeys(
        ('answers', 'twice', 'backwards', 'changed', 'refused'), 0
    )
    counters: dict[str, str] = {}
    last = -1.0

    def take(raw: Any) -> None:
        nonlocal last
        number = layout(raw).numbers(raw, 2)[0]
        found['answers'] += 1
        found['twice'] += number == last
        found['backwards'] += number < last
        last = number

    def make() -> Node:
        node = rclpy.create_node('soak_witness')
        node.create_subscription(JointState, f'/{name}/estimate', take, 5000, raw=True)
        diagnose(node, name, counters)
        service = f'/{name}/set_parameters_atomically'
        client = node.create_client(SetParametersAtomically, service)

        def changed(future: Any) -> None:
            found['changed' if future.result().result.successful else 'refused'] += 1

        def change() -> None:
            gains = {
                'prefer': chance.choice(('smooth', 'balanced', 'fast')),
                'gap_max': chance.uniform(0.1, 0.3),
                'timeout': chance.uniform(0.4, 0.8),
            }
            parameters = [each.to_parameter_msg() for each in ros_values(gains)]
            request = SetParametersAtomically.Request(parameters=parameters)
            if client.service_is_ready():
                client.call_async(request).add_done_callback(changed)

        node.create_timer(2.0, change)
        print('listening', flush=True)
        return node

    run_node(make, [])
    say(**found, counters=counters)


def null(kind: str) -> None:
    """Receive typed messages and publish a JointState for each: the minimum cost of a node."""

    def make() -> Node:
        node = rclpy.create_node(f'null_{kind}')
        publisher = node.create_publisher(JointState, '~/estimate', 50)
        quality = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)

        def answer(message: Any) -> None:
            if kind == CURRENTS:
                message = JointState(header=message.header, name=['rotor'], velocity=[0.0])
            elif kind == BATCHES:
                (sec, nanosec), made = message.data[-6:-4], JointState(name=['r'], velocity=[0.0])
                made.header.stamp.sec, made.header.stamp.nanosec = int(sec), int(nanosec)
                message = made
            publisher.publish(message)

        *others, answered = TOPICS[kind].items()
        for topic, each in others:
            node.create_subscription(each, topic, lambda message: None, quality)
        node.create_subscription(answered[1], answered[0], answer, quality)
        return node

    run_node(make, [])


if __name__ == '__main__':
    {each.__name__: each for each in (play, listen, faulty, witness, null)}[sys.argv[1]](
        *sys.argv[2:]
    )
