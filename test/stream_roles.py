# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The processes next to a node at the start of a stream: a publisher and a relay.

python test/stream_roles.py publish TOPIC     python test/stream_roles.py relay TOPIC

Both go on when they read a line, and end when they have read another one.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from typing import Any

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from estimator_pkg.messages.joint_state import Encoder

JOINTS = ('shoulder', 'elbow')  # the node does not know them before the first message
PERIOD_NS = 1_000_000
MESSAGES = 400


def best_effort(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def stamp_of(raw: bytes) -> int:
    """The stamp of a message [ns]."""
    return int.from_bytes(raw[4:8], 'little') * 1_000_000_000 + int.from_bytes(raw[8:12], 'little')


def publish(node: Any, topic: str) -> None:
    """Make a publisher; publish when it has matched two subscriptions; print the first stamp."""
    sys.stdin.readline()
    publisher = node.create_publisher(JointState, topic, best_effort(50))
    encode = Encoder().encode
    while publisher.get_subscription_count() < 2:
        time.sleep(1e-3)
    due, begun_ns = time.perf_counter(), time.time_ns()
    for k in range(MESSAGES):
        publisher.publish(encode(begun_ns + k * PERIOD_NS, 'base', JOINTS, (1e-3 * k, -1e-3 * k)))
        # Where the machine was busy the stream is late from then on: it makes up for nothing.
        due = max(due + 1e-9 * PERIOD_NS, time.perf_counter() + 0.5e-9 * PERIOD_NS)
        time.sleep(max(0.0, due - time.perf_counter()))
    print(json.dumps({'published': begun_ns}), flush=True)
    sys.stdin.readline()


def relay(node: Any, topic: str) -> None:
    """Note what comes; print the stamps."""
    came: list[int] = []
    node.create_subscription(
        JointState, topic, lambda raw: came.append(stamp_of(raw)), best_effort(5000), raw=True
    )
    threading.Thread(target=rclpy.spin, args=[node], daemon=True).start()
    print('"there"', flush=True)
    sys.stdin.readline()
    print(json.dumps({'relayed': came}), flush=True)
    sys.stdin.readline()


if __name__ == '__main__':
    rclpy.init()
    {'publish': publish, 'relay': relay}[sys.argv[1]](
        rclpy.create_node(f'starting_{sys.argv[1]}'), sys.argv[2]
    )
    sys.stdout.flush()
    os._exit(0)  # there may be a thread that spins
