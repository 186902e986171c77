# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Subscribes to the demo's topics and matches their newest samples for the table."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from estimator_pkg.circle import wrap
from estimator_pkg.messages.joint_state import Decoder, JointState

if TYPE_CHECKING:
    from rclpy.node import Node

KEPT = 200  # messages kept per topic, to match estimates with truth by stamp
MEASURED, TRUTH = '/joint_states', '/ground_truth/joint_states'
OBSERVER = '/joint_observer'
ESTIMATE, STDDEV = f'{OBSERVER}/estimate', f'{OBSERVER}/estimate_stddev'
TOPICS = MEASURED, TRUTH, ESTIMATE, STDDEV


class Snapshot(NamedTuple):
    """One moment of the demo: rad, rad/s, all at the same stamp.

    The finite difference is nan before the second measurement; stddev, which has its own topic, is
    nan until a message of the same stamp has arrived.
    """

    seconds: float
    angle: float
    true_velocity: float
    difference: float
    velocity: float
    stddev: float
    messages: int

    @property
    def error(self) -> float:
        """Estimate minus truth [rad/s]."""
        return self.velocity - self.true_velocity

    @property
    def difference_error(self) -> float:
        """Finite difference minus truth [rad/s]."""
        return self.difference - self.true_velocity


class Listener:
    """The raw messages of the four topics: of some thousand a second few need decoding."""

    def __init__(self, node: Node) -> None:
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import JointState as Message

        self._kept = {topic: deque[bytes](maxlen=KEPT) for topic in TOPICS}
        self._decoders = {topic: Decoder() for topic in TOPICS}
        self.count = 0  # of estimates
        self._first_ns = 0
        for topic in TOPICS:
            take = partial(self._take, topic)
            node.create_subscription(Message, topic, take, qos_profile_sensor_data, raw=True)

    def _take(self, topic: str, raw: bytes) -> None:
        self._kept[topic].append(raw)
        self.count += topic == ESTIMATE

    def snapshot(self) -> Snapshot | None:
        """Return the newest estimate with truth and measurement of the same stamp, else None."""
        for estimate in self._newest_first(ESTIMATE):
            if not estimate.velocities or math.isnan(estimate.velocities[0]):
                continue  # no estimate yet
            truth = self._at(TRUTH, estimate.stamp_ns)
            measured = self._at(MEASURED, estimate.stamp_ns)
            if truth is None or measured is None:
                continue
            sigma = self._at(STDDEV, estimate.stamp_ns)
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

    def _newest_first(self, topic: str) -> Iterator[JointState]:
        return map(self._decoders[topic].decode, reversed(self._kept[topic]))

    def _at(self, topic: str, stamp_ns: int) -> JointState | None:
        return next((each for each in self._newest_first(topic) if each.stamp_ns == stamp_ns), None)

    def _difference(self, newest: JointState) -> float:
        """Return the finite difference of the last two measurements [rad/s]."""
        for before in self._newest_first(MEASURED):
            passed = (newest.stamp_ns - before.stamp_ns) * 1e-9
            if passed > 0.0:
                return wrap(newest.positions[0] - before.positions[0], 2.0 * math.pi) / passed
        return math.nan
