# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Input topics: subscribed to while they have a publisher."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, time_ns

from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.nodes.faults import Senders
from estimator_pkg.nodes.misfits import type_name
from estimator_pkg.ros.executor import take_turn
from estimator_pkg.ros.loss import Loss

WAIT_FOR_PUBLISHER = 10.0  # [s] without a publisher, after which we subscribe all the same:
# some bridges publish only topics that have a subscriber


class Input:
    """A topic that a node reads, subscribed to while it has a publisher.

    A publisher knows of a subscription up to 0.1 s before the subscription knows of the publisher,
    and DDS drops the best-effort messages of that time unseen. A subscription that is made when the
    publisher is known knows it from its beginning, before the publisher can know of it.

    Parameters
    ----------
    topic_name : fully qualified. kind : message class.
    make : makes the subscription.
    port : name of the topic before remapping. qos : requested. optional : it needs no publisher.

    Attributes
    ----------
    type : name of the message class.
    found : nodes that publish the topic so that they are connected, at the last examination.
    left : nodes that were found before, and when they were missed, by `monotonic` [s]; the last.
    unnamed : True if a publisher had no name at the last report; set by the reporter.
    senders : what the messages carry; they are only looked at while `watched`.
    subscription : None while there is none.
    callback : receives its messages. loss : counts those that are lost.
    unpublished_since : when a publisher was last known, by `monotonic` [s].
    """

    def __init__(
        self,
        topic_name: str,
        kind: type,
        make: Callable[[], Subscription],
        port: str,
        qos: QoSProfile,
        optional: bool = False,
    ) -> None:
        self.topic_name, self._make, self.port, self.qos = topic_name, make, port, qos
        self.optional = optional
        self.type = type_name(kind)
        self.found: list[str] = []
        self.left: dict[str, float] = {}
        self.unnamed = False
        self.senders = Senders(self.type == JOINT_STATE)
        self.watched = True
        self.subscription: Subscription | None = None
        self.callback: Callable[..., None]
        self.loss = Loss(self.publishers)
        self.unpublished_since = monotonic()
        self._served = False  # True after a publisher was known

    def publishers(self) -> int:
        """The number of publishers that are connected."""
        return 0 if self.subscription is None else self.subscription.get_publisher_count()

    def connect(self, known: int, discovered: bool, node: Node) -> None:
        """Make the subscription, or destroy it after its last publisher.

        Parameters
        ----------
        known : number of publishers on the topic.
        discovered : they have had time to discover this node.
        """
        now = monotonic()
        if known:
            self.unpublished_since = now
        if self.subscription is None:
            if discovered if known else now - self.unpublished_since >= WAIT_FOR_PUBLISHER:
                self.loss.begins(time_ns())
                self._served = False
                self.subscription = self._make()
        elif known:
            self._served = True
        elif isinstance(node.executor, MultiThreadedExecutor):
            return  # another of its threads may be about to wait for the subscription
        elif self._served and self.drain():
            node.destroy_subscription(self.subscription)
            self.subscription = None
            self.loss.forget(time_ns())

    def drain(self) -> bool:
        """Receive messages that wait, for one turn of the executor; return True if none is left.

        EventsExecutor takes one message for each event. An event that comes while it takes a node
        or a subscription in may go unnoticed, and every message after it would be one message late.
        """
        return self.subscription is None or take_turn(self.subscription, self.callback)
