# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Listens to a running observer: estimates, intervals, states and counters of its joints."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.ros.observers import LATCHED, STATUS, estimate_topics, observers

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
    arrived: float = field(default=-math.inf)


class Watching:
    """Subscribes to an observer's topics, raw, and keeps the newest value of each joint.

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
        self._topics = ('', '')
        self._decoders = (Decoder(), Decoder())
        self._times: deque[float] = deque()
        self._heard = monotonic()
        node.create_subscription(DiagnosticArray, name + STATUS, self._status, LATCHED)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 10)
        self.look()

    def look(self) -> bool:
        """Subscribe to topics that have appeared; return True while the observer is there."""
        found = estimate_topics(self._node, self.name)
        for which, (topic, before) in enumerate(zip(found, self._topics)):
            if topic and not before:
                take = self._estimate if which == 0 else self._stddev
                self._node.create_subscription(
                    JointState, topic, take, qos_profile_sensor_data, raw=True
                )
        estimate, stddev = (topic or before for topic, before in zip(found, self._topics))
        self._topics = estimate, stddev
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

    def _estimate(self, raw: bytes) -> None:
        try:
            message = self._decoders[0].decode(raw)
        except MalformedMessageError:
            return
        self._heard = now = monotonic()
        self.count += 1
        self._times.append(now)
        for name, position, velocity in zip(message.names, message.positions, message.velocities):
            joint = self._joint(name)
            joint.position, joint.velocity, joint.arrived = position, velocity, now

    def _stddev(self, raw: bytes) -> None:
        try:
            message = self._decoders[1].decode(raw)
        except MalformedMessageError:
            return
        for name, sigma in zip(message.names, message.velocities):
            self._joint(name).interval = INTERVAL * sigma

    def _status(self, message: DiagnosticArray) -> None:
        self._heard = monotonic()
        names = [entry.name for entry in message.status if entry.name != self.name]
        self.joints = {  # a joint that has expired is in no status
            name: joint for name, joint in self.joints.items() if name in names or not names
        }
        for entry in message.status:
            self._take(entry.name, entry)

    def _diagnosed(self, message: DiagnosticArray) -> None:
        for entry in message.status:
            if entry.name == self.name:
                self._heard = monotonic()
                self.faults = entry.message
            elif entry.name.startswith(f'{self.name}: '):
                self._take(entry.name.removeprefix(f'{self.name}: '), entry)

    def _take(self, name: str, entry: Any) -> None:
        values: Mapping[str, str] = {item.key: item.value for item in entry.values}
        if name == self.name or 'status' not in values:
            return
        joint = self._joint(name)
        joint.state, joint.why = values['status'], values.get('why', '')
        joint.rate = _number(values.get('rate_hz', ''))
        joint.received = int(values.get('received', '0') or 0)
        joint.dropped = joint.received - int(values.get('used', '0') or 0)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
