# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The process of a publisher that floods a node.

python test/support/stream_roles.py RATE JOINTS

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
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from estimator_pkg.messages.joint_state import Encoder


def best_effort(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


class Flood:
    """The process of this file: joints at a rate [Hz]."""

    def __init__(self, rate: float, joints: int) -> None:
        self._child = subprocess.Popen(
            [sys.executable, __file__, str(rate), str(joints)],
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

    def __enter__(self) -> Flood:
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


def flood(node: Any, rate: float, joints: int) -> None:
    """Publish at this rate [Hz] until a line comes; print the number of messages."""
    publisher = node.create_publisher(JointState, 'joint_states', best_effort(50))
    ended, encode = threading.Event(), Encoder().encode
    names = [f'joint_{i}' for i in range(joints)]
    threading.Thread(target=lambda: (sys.stdin.readline(), ended.set()), daemon=True).start()
    while not publisher.get_subscription_count():
        time.sleep(1e-3)
    begun, begun_ns, k = time.perf_counter(), time.time_ns(), 0
    while not ended.is_set():
        time.sleep(max(0.0, begun + k / rate - time.perf_counter()))
        angles = [math.sin(1e-3 * k)] * joints
        publisher.publish(
            encode(begun_ns + round(1e9 * k / rate), 'base', names, angles, (), angles)
        )
        k += 1
    print(json.dumps({'published': k}), flush=True)
    time.sleep(0.5)  # the last ones leave


if __name__ == '__main__':
    rclpy.init()
    here = rclpy.create_node('starting_flood')
    flood(here, float(sys.argv[1]), int(sys.argv[2]))
    # Like every node it leaves ROS: after a process that was killed, its peers lose what they send
    # to the next one for a second or two (Fast DDS's shared memory).
    here.destroy_node()
    rclpy.try_shutdown()
