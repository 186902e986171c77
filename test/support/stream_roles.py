# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The processes next to a node: a publisher and a relay at the start of a stream, and a flood.

python test/support/stream_roles.py publish TOPIC
python test/support/stream_roles.py relay TOPIC
python test/support/stream_roles.py flood KIND RATE JOINTS

Publisher and relay go on when they read a line, and all end when they have read another one.
"""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from contextlib import suppress
from typing import Any

import rclpy
from geometry_msgs.msg import Vector3Stamped
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from estimator_pkg.messages import vector3
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

    def spin() -> None:
        with suppress(ExternalShutdownException):
            rclpy.spin(node)

    spinning = threading.Thread(target=spin)
    spinning.start()
    print('"there"', flush=True)
    sys.stdin.readline()
    print(json.dumps({'relayed': came}), flush=True)
    sys.stdin.readline()
    rclpy.shutdown()
    spinning.join()


TURNS = 50.0  # of that drive, electrical [1/s]
FLOODS = {
    'joints': {'joint_states': JointState},
    'estimates': {'estimate': JointState},
    'vectors': {'current': Vector3Stamped, 'voltage': Vector3Stamped},
}


def made(kind: str, joints: int, rate: float) -> Any:
    """Return (number, stamp [ns]) -> the bytes of one message on each topic of the flood."""
    encode = Encoder().encode
    names = [f'joint_{i}' for i in range(joints)]

    def of_joints(k: int, stamp_ns: int) -> tuple[bytes, ...]:
        angle = [math.sin(1e-3 * k)] * joints
        return (encode(stamp_ns, 'base', names, angle, (), angle),)

    def of_drive(k: int, stamp_ns: int) -> tuple[bytes, ...]:
        angle = 2.0 * math.pi * TURNS * k / rate
        sine, cosine = math.sin(angle), math.cos(angle)
        return (
            vector3.encode(stamp_ns, '', 5.0 * sine, 5.0 * cosine),
            vector3.encode(stamp_ns, '', 0.6 * cosine, -0.6 * sine),
        )

    return of_drive if kind == 'vectors' else of_joints


def flood(node: Any, kind: str, rate: float, joints: int) -> None:
    """Publish at this rate [Hz] until a line comes; print the number of messages on each topic."""
    publishers = [
        node.create_publisher(each, topic, best_effort(50)) for topic, each in FLOODS[kind].items()
    ]
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.readline(), ended.set()), daemon=True).start()
    while not all(each.get_subscription_count() for each in publishers):
        time.sleep(1e-3)
    make, k = made(kind, joints, rate), 0
    begun, begun_ns = time.perf_counter(), time.time_ns()
    while not ended.is_set():
        time.sleep(max(0.0, begun + k / rate - time.perf_counter()))
        for publisher, raw in zip(publishers, make(k, begun_ns + round(1e9 * k / rate))):
            publisher.publish(raw)
        k += 1
    print(json.dumps({'published': k * len(publishers)}), flush=True)
    time.sleep(0.5)  # the last ones leave


if __name__ == '__main__':
    rclpy.init()
    role, *words = sys.argv[1:]
    here = rclpy.create_node(f'starting_{role}')
    if role == 'flood':
        flood(here, words[0], float(words[1]), int(words[2]))
    else:
        {'publish': publish, 'relay': relay}[role](here, words[0])
    # Like every node it leaves ROS: after a process that was killed, its peers lose what they send
    # to the next one for a second or two (Fast DDS's shared memory).
    here.destroy_node()
    rclpy.try_shutdown()
