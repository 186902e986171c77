# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A command on the live graph: its own node, QoS between bag and rclpy, another node's parameters.

Imports ROS, so the commands import it when they run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from estimator_pkg import interrupts
from estimator_pkg.errors import UserError, first_line
from estimator_pkg.optional import missing

try:
    from estimator_pkg.ros.runtime import make_executor  # isort: skip  prepares the environment
    import rclpy
    from rclpy.duration import Duration
    from rclpy.node import Node
    from rclpy.parameter import Parameter, parameter_value_to_python
    from rclpy.parameter_client import AsyncParameterClient
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
ANSWER_WAIT = 5.0  # longest wait for a node to be found, and to answer [s]
CHECK_PERIOD = 0.05  # time between checks [s]


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
    """Return a publisher's profile in the form of bags; both number their kinds as rmw does."""

    def split(duration: Duration) -> QosTime:
        return QosTime(*divmod(duration.nanoseconds, 1_000_000_000))

    return Qos(
        QosHistory(int(profile.history)),
        profile.depth,
        QosReliability(int(profile.reliability)),
        QosDurability(int(profile.durability)),
        split(profile.deadline),
        split(profile.lifespan),
        QosLiveliness(int(profile.liveliness)),
        split(profile.liveliness_lease_duration),
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


class RemoteParameters:
    """The parameters of another node.

    Parameters
    ----------
    name : of that node; without a leading '/', in the root namespace.

    Raises
    ------
    UserError : there is no such node; later also if it does not answer.
    """

    def __init__(self, here: Live, name: str) -> None:
        self.name = name if name.startswith('/') else f'/{name}'
        self._here = here
        self._client = AsyncParameterClient(here.node, self.name)
        if not self._came(self._client.services_are_ready):
            raise UserError(
                f"no node '{self.name}' with parameter services: check the name ('ros2 node list')"
            )

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the present values by name; None for a parameter that is unset or unknown."""
        found = {}
        for name in names:  # one that is unknown makes the whole answer empty
            values = self._answer(partial(self._client.get_parameters, [name])).values
            found[name] = parameter_value_to_python(values[0]) if values else None
        return found

    def set(self, values: Mapping[str, Any]) -> None:
        """Set them together; raise UserError if the node refuses one (with its reason)."""
        requested = [
            Parameter(name, value=list(value) if isinstance(value, tuple) else value)
            for name, value in values.items()
        ]
        answer = self._answer(partial(self._client.set_parameters_atomically, requested))
        if not answer.result.successful:
            raise UserError(f"the node '{self.name}' refused the gains: {answer.result.reason}")

    def _answer(self, request: Callable[[], Any]) -> Any:
        """Return the answer to a request; it is made again once, because a node that has not
        discovered this client drops its answer.
        """
        for _ in range(2):
            future = request()
            if self._came(future.done):
                return future.result()
        raise UserError(f"the node '{self.name}' does not answer: check that it runs")

    def _came(self, condition: Callable[[], Any]) -> bool:
        """Wait for a condition; return False if it did not come true."""
        end = time.monotonic() + ANSWER_WAIT
        while not condition():
            if time.monotonic() > end or self._here.stopping:
                return False
            self._here.spin(CHECK_PERIOD)
        return True
