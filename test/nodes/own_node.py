# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A node in the test's process, in no executor, whose steady time the test makes."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import dds
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.nodes.observer import ObserverNode
from estimator_pkg.nodes.ros_parameters import ros_values

BEGIN = 1_700_000_000_000_000_000  # [ns]
LOOK = 0.1  # [s] between two looks of the node


class OwnNode:
    """A node, those that publish to it, and what it reports.

    Parameters
    ----------
    patch : a monkeypatch, which sets the node's clock. kind : of the observers.
    space : its namespace. values : parameters; cli : arguments of ROS.

    Attributes
    ----------
    now : steady time [s]. others : nodes by name. publishers : theirs.
    status, diagnostics : (time, entry of the node) of each report.
    """

    def __init__(
        self, patch: Any, kind: Any, space: str = '', cli: tuple[str, ...] = (), **values: Any
    ) -> None:
        self.now = time.monotonic()
        for module in ('health', 'senders', 'endpoints'):
            patch.setattr(f'estimator_pkg.nodes.{module}.monotonic', lambda: self.now)
        self.node = ObserverNode(
            kind, namespace=space, cli_args=list(cli), parameter_overrides=ros_values(values)
        )
        self.space, self.encode, self.begun = (
            f'/{space}' if space else '',
            Encoder().encode,
            self.now,
        )
        self.others: dict[str, Any] = {}
        self.publishers: dict[str, Any] = {}
        self.status: list[tuple[float, Any]] = []
        self.diagnostics: list[tuple[float, Any]] = []
        for way in ('status', 'diagnostics'):
            self._note(way, getattr(self.node.health, f'_{way}'))

    def _note(self, way: str, publisher: Any) -> None:
        heard, name = getattr(self, way), self.node.get_fully_qualified_name()

        def publish(raw: bytes) -> None:
            entries = deserialize_message(raw, DiagnosticArray).status
            heard.extend((self.now, each) for each in entries if each.name == name)

        patched = type('', (), {'publish': staticmethod(publish)})
        setattr(self.node.health, f'_{way}', patched)

    def publisher(
        self,
        name: str,
        kind: type = JointState,
        topic: str = 'joint_states',
        context: Any = None,
        reliable: bool = True,
    ) -> Any:
        """A publisher on a topic of the node, of another node of this name."""
        self.others[name] = rclpy.create_node(name, namespace=self.space, context=context)
        policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        topic = topic if topic.startswith('/') else f'{self.space}/{topic}'
        self.publishers[name] = self.others[name].create_publisher(
            kind, topic, QoSProfile(depth=100, reliability=policy)
        )
        return self.publishers[name]

    def gone(self, name: str) -> None:
        """The node of a publisher ends."""
        del self.publishers[name]
        self.others.pop(name).destroy_node()

    def send(
        self,
        names: Any,
        positions: Any,
        stamp_ns: int | None = None,
        by: str = 'driver',
        efforts: Any = (),
        velocities: Any = (),
    ) -> None:
        """Publish a JointState."""
        stamp_ns = time.time_ns() if stamp_ns is None else stamp_ns
        self.publishers[by].publish(
            self.encode(stamp_ns, '', names, positions, velocities, efforts)
        )

    def pass_time(self, seconds: float, tick: Callable[[], None] = lambda: None) -> None:
        """Let the node look around ten times a second; `tick` publishes before each look."""
        for _ in range(round(seconds / LOOK)):
            tick()
            time.sleep(0.002)
            self.now += LOOK
            self.node._look_around()

    def connect(self) -> None:
        """Pass time until every publisher is connected."""
        end = time.monotonic() + 20.0
        while not all(each.get_subscription_count() for each in self.publishers.values()):
            assert time.monotonic() < end
            self.pass_time(LOOK, lambda: time.sleep(0.02))

    def take(self, *raws: bytes, by: str = 'driver') -> dict[str, int]:
        """Publish messages, and wait until the node has taken them; its counters."""
        before, end = self.node.health._totals()['messages_received'], time.monotonic() + 20.0
        for raw in raws:
            self.publishers[by].publish(raw)
        while self.node.health._totals()['messages_received'] < before + len(raws):
            assert time.monotonic() < end
            self.pass_time(LOOK)
        return self.node.health._totals()

    def report(self) -> Any:
        """The entry of the next report."""
        self.pass_time(1.1)
        return self.diagnostics[-1][1]

    def set(self, **values: Any) -> str:
        """Set parameters together ('__' stands for '.'); why the node refuses, '' where not."""
        given = {key.replace('__', '.'): value for key, value in values.items()}
        result = self.node.set_parameters_atomically(ros_values(given))
        return '' if result.successful else result.reason

    def status_of(self, joint: str) -> tuple[int, str]:
        """The status of a joint at the node's last look, and why."""
        return self.node.health.watch.statuses[joint]

    def close(self) -> None:
        self.node.destroy_node()
        for each in self.others.values():
            each.destroy_node()


@contextmanager
def in_context(file: Any = None) -> Iterator[dict[str, Any]]:
    """Arguments for a node on its own context, which reads a parameter file as ROS does."""
    context = rclpy.Context()
    rclpy.init(args=dds.ros_args(file=file), context=context, domain_id=dds.DOMAIN)
    try:
        yield {'context': context}
    finally:
        rclpy.try_shutdown(context=context)


def logged(text: str) -> list[tuple[str, str]]:
    """(level, message) of each line of a log."""
    return re.findall(r'\[(\w+)\] \[[\d.]+\] \[[^]]*\]: (.*)', text)
