# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Listens to a running observer: estimates, intervals, states and counters of its joints."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from time import monotonic
from typing import Any

from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from estimator_pkg.ros.observers import estimate_topics, listen, observers

INTERVAL = 1.959964  # standard deviations of a 95 % interval
WINDOW = 1.0  # time over which messages are counted [s]


@dataclass
class Joint:
    """The newest values of a joint: rad or m, rad/s or m/s, Hz; nan for unknown ones.

    interval : half of the 95 % interval of the velocity. state, why : as in ~/status.
    dropped : samples that the guard dropped, of those received.
    """

    position: float = math.nan
    velocity: float = math.nan
    interval: float = math.nan
    state: str = '-'
    why: str = ''
    rate: float = math.nan
    received: int = 0
    dropped: int = 0


class Watching:
    """Subscribes to an observer's topics, and keeps the newest value of each joint.

    Parameters
    ----------
    node : the node that listens. name : full name of the observer.

    Attributes
    ----------
    joints : by name, in the order of their appearance.
    faults : what the observer itself reports; '' or 'ok': nothing.
    count : received messages with estimates.
    """

    def __init__(self, node: Node, name: str) -> None:
        self._node, self.name = node, name
        self.joints: dict[str, Joint] = {}
        self.faults = ''
        self.count = 0
        self._topics: set[str] = set()
        self._times: deque[float] = deque()
        self._heard = monotonic()
        listen(node, name, self._status, self._diagnosed)
        self.look()

    def look(self) -> bool:
        """Subscribe to topics that have appeared; return True while the observer is there."""
        takers = self._estimate, self._stddev
        for topic, take in zip(estimate_topics(self._node, self.name), takers):
            if topic and topic not in self._topics:
                self._topics.add(topic)
                self._node.create_subscription(JointState, topic, take, qos_profile_sensor_data)
        return self.name in observers(self._node)

    @property
    def silence(self) -> float:
        """Time since the last message of any kind [s]."""
        return monotonic() - self._heard

    @property
    def messages_hz(self) -> float:
        """Messages with estimates per second."""
        now = monotonic()
        while self._times and self._times[0] < now - WINDOW:
            self._times.popleft()
        return len(self._times) / WINDOW

    def _joint(self, name: str) -> Joint:
        return self.joints.setdefault(name, Joint())

    def _estimate(self, message: JointState) -> None:
        self._heard = monotonic()
        self.count += 1
        self._times.append(self._heard)
        for name, position, velocity in zip(message.name, message.position, message.velocity):
            joint = self._joint(name)
            joint.position, joint.velocity = position, velocity

    def _stddev(self, message: JointState) -> None:
        for name, sigma in zip(message.name, message.velocity):
            self._joint(name).interval = INTERVAL * sigma

    def _diagnosed(self, text: str) -> None:
        self._heard = monotonic()
        self.faults = text

    def _status(self, entries: Iterable[Any]) -> None:
        self._heard = monotonic()
        joints = {}  # a joint that has expired is in no status
        for entry in entries:
            values = {item.key: item.value for item in entry.values}
            if 'status' not in values:  # of the node
                continue
            joint = joints[entry.name] = self._joint(entry.name)
            joint.state, joint.why = values['status'], values['why']
            joint.rate = float(values['rate_hz'] or 'nan')
            joint.received = int(values['received'])
            joint.dropped = joint.received - int(values['used'])
        self.joints = joints
