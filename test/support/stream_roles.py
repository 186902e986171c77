# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The process of a publisher that floods a node.

python test/support/stream_roles.py flood KIND RATE JOINTS

It ends when it has read a line.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import Any

import rclpy
from geometry_msgs.msg import Vector3Stamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from estimator_pkg.messages import vector3
from estimator_pkg.messages.joint_state import Encoder


def best_effort(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


class Role:
    """A process of this file."""

    def __init__(self, name: str, *words: str) -> None:
        self._child = subprocess.Popen(
            [*(sys.executable, __file__, name), *words],
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self.said: list[Any] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            with suppress(ValueError):  # DDS prints there, too
                self.said.append(json.loads(line))

    def go_on(self) -> None:
        assert self._child.stdin is not None
        self._child.stdin.write('\n')
        self._child.stdin.flush()

    def __enter__(self) -> Role:
        return self

    def __exit__(self, *error: Any) -> None:
        assert self._child.stdin is not None and self._child.stdout is not None
        self._child.stdin.close()
        try:
            self._child.wait(10.0)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._reader.join()
        self._child.stdout.close()


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
    _, what, often, count = sys.argv[1:]
    here = rclpy.create_node('starting_flood')
    flood(here, what, float(often), int(count))
    # Like every node it leaves ROS: after a process that was killed, its peers lose what they send
    # to the next one for a second or two (Fast DDS's shared memory).
    here.destroy_node()
    rclpy.try_shutdown()
