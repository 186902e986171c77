# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Subscribes to the demo's topics and matches their newest samples for the table."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from estimator_pkg.circle import wrap
from estimator_pkg.messages.joint_state import Decoder, JointState

if TYPE_CHECKING:
    from rclpy.node import Node

KEPT = 200  # messages kept per topic, to match estimates with truth by stamp


class Snapshot(NamedTuple):
    """One moment of the demo: rad, rad/s, all at the same stamp.

    finite_difference is nan before the second measurement; stddev, which has its own topic, is nan
    until a message of the same stamp has arrived.
    """

    seconds: float
    angle: float
    true_velocity: float
    finite_difference: float
    velocity: float
    stddev: float
    messages: int

    @property
    def error(self) -> float:
        """Estimate minus truth [rad/s]."""
        return self.velocity - self.true_velocity


class Topics:
    """The raw messages of the four topics, decoded only for a snapshot."""

    def __init__(self) -> None:
        self.measured: deque[bytes] = deque(maxlen=KEPT)
        self.truth: deque[bytes] = deque(maxlen=KEPT)
        self.estimates: deque[bytes] = deque(maxlen=KEPT)
        self.stddevs: deque[bytes] = deque(maxlen=KEPT)
        self.count = 0
        self._first_ns = 0
        self._decoder = {id(kept): Decoder() for kept in self._all()}

    def _all(self) -> tuple[deque[bytes], ...]:
        return self.measured, self.truth, self.estimates, self.stddevs

    def on_measured(self, raw: bytes) -> None:
        """Store a measurement."""
        self.measured.append(raw)

    def on_truth(self, raw: bytes) -> None:
        """Store a true state."""
        self.truth.append(raw)

    def on_estimate(self, raw: bytes) -> None:
        """Store and count an estimate."""
        self.estimates.append(raw)
        self.count += 1

    def on_stddev(self, raw: bytes) -> None:
        """Store a standard deviation."""
        self.stddevs.append(raw)

    def snapshot(self) -> Snapshot | None:
        """Return the newest estimate with truth and measurement of the same stamp, else None."""
        for estimate in self._newest_first(self.estimates):
            if not estimate.velocities or math.isnan(estimate.velocities[0]):
                continue  # no estimate yet
            truth = self._at(self.truth, estimate.stamp_ns)
            measured = self._at(self.measured, estimate.stamp_ns)
            if truth is None or measured is None:
                continue
            sigma = self._at(self.stddevs, estimate.stamp_ns)
            self._first_ns = self._first_ns or estimate.stamp_ns
            return Snapshot(
                (estimate.stamp_ns - self._first_ns) * 1e-9,
                measured.positions[0],
                truth.velocities[0],
                self._difference(measured),
                estimate.velocities[0],
                sigma.velocities[0] if sigma and sigma.velocities else math.nan,
                self.count,
            )
        return None

    def _newest_first(self, kept: deque[bytes]):
        decoder = self._decoder[id(kept)]
        for raw in reversed(list(kept)):
            yield decoder.decode(raw)

    def _at(self, kept: deque[bytes], stamp_ns: int) -> JointState | None:
        for message in self._newest_first(kept):
            if message.stamp_ns == stamp_ns:
                return message
            if message.stamp_ns < stamp_ns:
                return None
        return None

    def _difference(self, newest: JointState) -> float:
        """Return the finite difference of the last two measurements [rad/s]."""
        for before in self._newest_first(self.measured):
            passed = (newest.stamp_ns - before.stamp_ns) * 1e-9
            if passed > 0.0:
                return wrap(newest.positions[0] - before.positions[0], 2.0 * math.pi) / passed
        return math.nan


def listen(
    topics: Topics, *, measured: str, truth: str, estimate: str, stddev: str
) -> tuple[Node, Callable[[float], None]]:
    """Subscribe to the four topics; return the node, and a function that spins for n seconds.

    The subscriptions are raw: of some thousand messages a second only the few that are shown need
    decoding.
    """
    import rclpy
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import JointState as JointStateMessage

    from estimator_pkg.ros.runtime import make_executor

    node = rclpy.create_node('demo')
    for name, take in (
        (measured, topics.on_measured),
        (truth, topics.on_truth),
        (estimate, topics.on_estimate),
        (stddev, topics.on_stddev),
    ):
        node.create_subscription(JointStateMessage, name, take, qos_profile_sensor_data, raw=True)
    executor = make_executor()
    executor.add_node(node)

    def spin(seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=left)

    return node, spin
