# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Shared by `record` and `play`: their own node, message types, QoS between bag and rclpy.

Imports ROS, so the commands import it when they run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from estimator_pkg import interrupts
from estimator_pkg.errors import UserError, first_line
from estimator_pkg.optional import missing

try:
    from estimator_pkg.ros.runtime import make_executor  # isort: skip  prepares the environment
    import rclpy
    from rclpy.duration import Duration
    from rclpy.node import Node
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
    from rclpy.signals import SignalHandlerOptions
except ImportError as problem:
    raise UserError(missing(problem) or f'ROS cannot be used: {problem}') from problem

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

if TYPE_CHECKING:
    from estimator_pkg.ros.executor import SteadyExecutor

DEPTH = 1000  # of queues: no message may be lost while the disk is busy


@dataclass(frozen=True)
class Live:
    """A node on the live graph, and what runs its callbacks."""

    node: Node
    executor: SteadyExecutor

    @property
    def stopping(self) -> bool:
        """True after a signal that ends the process."""
        return bool(interrupts.came())

    def spin(self, seconds: float) -> None:
        """Run callbacks for at most `seconds`; at least one, if any is due."""
        self.executor.spin_once(timeout_sec=seconds)

    def makers(self, topics: Iterable[str]) -> dict[str, str]:
        """Return topic -> observer that publishes it, for those that one does."""
        from estimator_pkg.ros.observers import makers

        return makers(self.node, topics)


@contextmanager
def live(name: str) -> Iterator[Live]:
    """A node on the live graph.

    Raises
    ------
    UserError : ROS cannot start.
    """
    with interrupts.gently(background=True):  # our loops end by themselves, before ROS does
        try:
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            here = Live(Node(name, start_parameter_services=False), make_executor())
            here.executor.add_node(here.node)
        except Exception as error:  # of rcl: no middleware, a wrong environment
            raise UserError(f'ROS cannot start: {first_line(error)}') from error
        try:
            yield here
        finally:
            here.executor.shutdown()
            here.node.destroy_node()
            rclpy.try_shutdown()


def offered(profile: QoSProfile) -> Qos:
    """Return a publisher's profile in the form of bags."""

    def time(duration: Duration) -> QosTime:
        return QosTime(*divmod(duration.nanoseconds, 1_000_000_000))

    def same(kind: Any, value: Any) -> Any:
        return kind.__members__.get(value.name, kind.UNKNOWN)

    return Qos(
        same(QosHistory, profile.history),
        profile.depth,
        same(QosReliability, profile.reliability),
        same(QosDurability, profile.durability),
        time(profile.deadline),
        time(profile.lifespan),
        same(QosLiveliness, profile.liveliness),
        time(profile.liveliness_lease_duration),
        bool(profile.avoid_ros_namespace_conventions),
    )


def matching(profiles: Sequence[Qos]) -> QoSProfile:
    """Return a profile that connects to all of these, or offers what each of them did.

    It is reliable and transient local only if all are: a subscription that requests more than a
    publisher offers receives nothing.
    """
    reliable = bool(profiles) and all(
        item.reliability != QosReliability.BEST_EFFORT for item in profiles
    )
    latched = bool(profiles) and all(
        item.durability == QosDurability.TRANSIENT_LOCAL for item in profiles
    )
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max([DEPTH, *(item.depth for item in profiles)]),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
