# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Roles of the live benchmarks around a measured node, each in its own process.

python -m benchmarks.live.roles publish RATE SECONDS JOINTS [SUBSCRIBERS]
python -m benchmarks.live.roles feed RATE
python -m benchmarks.live.roles listen TOPIC
python -m benchmarks.live.roles time TOPIC
python -m benchmarks.live.roles diagnose
python -m benchmarks.live.roles null
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

from benchmarks.live.processes import JOINTS
from estimator_pkg.ros.runtime import run as run_node

PERIOD = 6.0  # period of the published motion [s]


def publish(rate: float, seconds: float, joints: int, subscriptions: int) -> None:
    """Publish JointStates at `rate` by absolute deadlines; print how many at the end."""
    import math

    import rclpy
    from sensor_msgs.msg import JointState

    from estimator_pkg.messages.joint_state import Encoder

    rclpy.init()
    node = rclpy.create_node('benchmark_publisher')
    publisher = node.create_publisher(JointState, 'joint_states', 10)
    encode = Encoder().encode
    names = [f'joint_{i}' for i in range(joints)]
    while publisher.get_subscription_count() < subscriptions:
        time.sleep(0.02)
    time.sleep(1.0)  # until the other processes are connected
    print('started', flush=True)
    count = int(rate * seconds)
    begun, begun_ns = time.perf_counter(), time.time_ns()
    for i in range(count):
        wait = begun + i / rate - time.perf_counter()
        if wait > 0.0:
            time.sleep(wait)
        angle = math.sin(2.0 * math.pi * i / rate / PERIOD)
        publisher.publish(
            encode(
                begun_ns + round(i * 1e9 / rate),
                'base',
                names,
                [angle + 0.1 * joint for joint in range(joints)],
            )
        )
    took = time.perf_counter() - begun
    print(json.dumps({'published': count, 'seconds': took}), flush=True)
    time.sleep(1.0)
    rclpy.shutdown()


def feed(rate: float) -> None:
    """Publish JointStates with efforts at `rate`, stamped when sent, until SIGINT."""
    import math
    import threading

    from sensor_msgs.msg import JointState

    from estimator_pkg.messages.joint_state import Encoder

    def make():
        import rclpy

        node = rclpy.create_node('benchmark_feed')
        publisher = node.create_publisher(JointState, 'joint_states', 10)
        encode = Encoder().encode
        names = [f'joint_{i}' for i in range(JOINTS)]
        turning = 2.0 * math.pi / PERIOD

        def play() -> None:
            begun, i = time.perf_counter(), 0
            while rclpy.ok():
                i += 1
                wait = begun + i / rate - time.perf_counter()
                if wait > 0.0:
                    time.sleep(wait)
                angle = math.sin(turning * i / rate)
                try:
                    publisher.publish(
                        encode(
                            time.time_ns(),
                            'base',
                            names,
                            [angle] * JOINTS,
                            (),
                            [-0.1 * turning * turning * angle] * JOINTS,
                        )
                    )
                except Exception:  # the context ended meanwhile
                    if rclpy.ok():
                        raise
                    return

        threading.Thread(target=play, daemon=True).start()
        return node

    run_node(make, [])


def time_answers(topic: str) -> None:
    """Print when the first message and the first estimate arrive, and on SIGINT the latencies.

    A line of JSON each: {"message": ns}, {"estimate": ns} (a message with a velocity), and at
    the end the number of answers with their times from stamp to receipt [ms].
    """
    import math
    import statistics

    from sensor_msgs.msg import JointState

    from estimator_pkg.messages.joint_state import Decoder

    late: list[int] = []
    printed: set[str] = set()

    def say(what: str, now: int) -> None:
        printed.add(what)
        print(json.dumps({what: now}), flush=True)

    def make():
        import rclpy

        node = rclpy.create_node('benchmark_clock')
        layout = Decoder().layout

        def take(raw: Any) -> None:  # bytes: the subscription is raw
            now = time.time_ns()
            found = layout(raw)
            late.append(now - found.stamp_ns(raw))
            if 'estimate' not in printed:
                if 'message' not in printed:
                    say('message', now)
                if not all(map(math.isnan, found.numbers(raw, 1))):
                    say('estimate', now)

        node.create_subscription(JointState, topic, take, 5000, raw=True)
        print('listening', flush=True)
        return node

    run_node(make, [])
    steady = sorted(late[len(late) // 4 :])  # without the time after the connection
    print(
        json.dumps(
            {
                'answered': len(late),
                **(
                    {
                        'median_ms': 1e-6 * statistics.median(steady),
                        'late_ms': 1e-6 * steady[int(0.99 * (len(steady) - 1))],
                    }
                    if steady
                    else {}
                ),
            }
        ),
        flush=True,
    )


def listen(topic: str) -> None:
    """Count JointStates on `topic`; print the count and the stamps on SIGINT."""
    from sensor_msgs.msg import JointState

    from estimator_pkg.messages.joint_state import Decoder

    seen: list[int] = []

    def make():
        import rclpy

        node = rclpy.create_node('benchmark_listener')
        layout = Decoder().layout

        def take(raw: Any) -> None:  # bytes: the subscription is raw
            seen.append(layout(raw).stamp_ns(raw))

        node.create_subscription(JointState, topic, take, 5000, raw=True)
        return node

    run_node(make, [])
    print(json.dumps({'received': len(seen), 'distinct': len(set(seen))}), flush=True)


def diagnose() -> None:
    """Print, on SIGINT, the newest counters that joint_observer reported."""
    from diagnostic_msgs.msg import DiagnosticArray

    newest: dict[str, str] = {}

    def came(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == '/joint_observer':
                newest.update({item.key: item.value for item in status.values})

    def make():
        import rclpy

        node = rclpy.create_node('benchmark_diagnosis')
        node.create_subscription(DiagnosticArray, '/diagnostics', came, 10)
        return node

    run_node(make, [])
    print(json.dumps(newest), flush=True)


def null() -> None:
    """Receive and republish JointStates, typed, as any rclpy node would: the minimum cost."""
    from sensor_msgs.msg import JointState

    def make():
        import rclpy
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        node = rclpy.create_node('null_node')
        publisher = node.create_publisher(JointState, '~/estimate', 50)
        node.create_subscription(
            JointState,
            'joint_states',
            publisher.publish,
            QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT),
        )
        return node

    run_node(make, [])


if __name__ == '__main__':
    role, *rest = sys.argv[1:]
    if role == 'publish':
        publish(float(rest[0]), float(rest[1]), int(rest[2]), int(rest[3]) if rest[3:] else 1)
    elif role == 'feed':
        feed(float(rest[0]))
    elif role == 'time':
        time_answers(rest[0])
    elif role == 'listen':
        listen(rest[0])
    elif role == 'diagnose':
        diagnose()
    else:
        null()
