"""Subscriptions and publishers of a node: QoS that users can override, and what goes wrong."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.event_handler import (
    PublisherEventCallbacks,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription

from estimator_pkg.errors import UsageError
from estimator_pkg.nodes.loss import Loss


def sensor_data() -> QoSProfile:
    """Of measurements: best effort matches every publisher; 50 messages bridge a pause."""
    return QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


def estimates() -> QoSProfile:
    """Of what a node gives."""
    return QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)


def latched() -> QoSProfile:
    """Of what late subscriptions must see too."""
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)


_OPEN = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY,
         QoSPolicyKind.DURABILITY)

Receive = Callable[[bytes, Mapping[str, Any]], None]  # (CDR bytes, message info)


class OnDemand:
    """A publisher of what is made only while somebody listens.

    Attributes
    ----------
    wanted : whether somebody did when it was last looked.
    publish : as of the publisher.
    """

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher
        self.publish = publisher.publish
        self.wanted = False

    def look(self) -> None:
        """See whether somebody listens."""
        self.wanted = self._publisher.get_subscription_count() > 0


class Endpoints:
    """Makes a node's subscriptions and publishers and counts what the middleware reports.

    Attributes
    ----------
    qos_mismatches : publishers and subscriptions met that could not be connected to.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.qos_mismatches = 0
        self._losses: list[Loss] = []
        self._inputs: list[tuple[Subscription, Callable[..., None]]] = []
        self._on_demand: list[OnDemand] = []
        self._reported = 0  # by the middleware's own event

    @property
    def inputs(self) -> list[str]:
        """Names of the topics that are subscribed to."""
        return [subscription.topic_name for subscription, _ in self._inputs]

    @property
    def lost(self) -> int:
        """Messages lost on the way to our subscriptions since they were made."""
        if any(loss.known for loss in self._losses):
            return sum(loss.count for loss in self._losses)
        return self._reported

    def subscribe(self, kind: type, topic: str, receive: Receive,
                  qos: QoSProfile | None = None) -> Subscription:
        """A raw subscription: `receive` gets every message's bytes and info.

        Raises
        ------
        UsageError : a wrong ``qos_overrides`` parameter.
        """
        holder: list[Subscription] = []
        loss = Loss(lambda: holder[0].get_publisher_count())
        self._losses.append(loss)
        saw = loss.saw

        def callback(*arguments: Any) -> None:
            # EventsExecutor of rclpy 7.1 hands over one tuple, other executors two arguments.
            raw, info = arguments if len(arguments) == 2 else arguments[0]
            saw(info['publication_sequence_number'])
            receive(raw, info)

        callback.__signature__ = _TWO_ARGUMENTS  # type: ignore[attr-defined]  # rclpy counts them

        def mismatch(event: Any) -> None:
            self._mismatch(holder[0].topic_name, 'publisher', 'subscription', event)

        def matched(event: Any) -> None:
            if event.current_count_change < 0:
                loss.forget()

        def reported(event: Any) -> None:
            self._reported = event.total_count

        def make(**events: Any) -> Subscription:
            return self._node.create_subscription(
                kind, topic, callback, qos or sensor_data(), raw=True,
                qos_overriding_options=_overriding(),
                event_callbacks=SubscriptionEventCallbacks(incompatible_qos=mismatch, **events))

        holder.append(self._made(topic, make, {'matched': matched, 'message_lost': reported}))
        self._inputs.append((holder[0], callback))
        return holder[0]

    def look(self) -> None:
        """See who listens, and receive what still waits; to be called now and then."""
        self._drain()
        for publisher in self._on_demand:
            publisher.look()

    def _drain(self) -> None:
        """Receive what still waits on the subscriptions.

        EventsExecutor takes one message for each event. An event that comes while it takes the
        node in may go unnoticed, and every message after it would be one message late.
        """
        for subscription, callback in self._inputs:
            for _ in range(subscription.qos_profile.depth or 1):
                with subscription.handle:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                callback(*taken)

    def publisher(self, kind: type, topic: str, qos: QoSProfile | None = None) -> Publisher:
        """A publisher; raises UsageError for a wrong ``qos_overrides`` parameter."""
        holder: list[Publisher] = []

        def mismatch(event: Any) -> None:
            self._mismatch(holder[0].topic_name, 'subscription', 'publisher', event)

        def make() -> Publisher:
            return self._node.create_publisher(
                kind, topic, qos or estimates(), qos_overriding_options=_overriding(),
                event_callbacks=PublisherEventCallbacks(incompatible_qos=mismatch))

        holder.append(self._made(topic, make, {}))
        return holder[0]

    def on_demand(self, kind: type, topic: str) -> OnDemand:
        """A publisher of what is made only while somebody listens; errors as of `publisher`."""
        made = OnDemand(self.publisher(kind, topic))
        self._on_demand.append(made)
        return made

    def _made(self, topic: str, make: Callable[..., Any], events: dict[str, Any]) -> Any:
        try:
            try:
                return make(**events)
            except UnsupportedEventTypeError:  # of this middleware: then without
                return make()
        except (InvalidQosOverridesError, ParameterException, AssertionError, RuntimeError,
                TypeError, ValueError) as error:
            raise UsageError(f"qos_overrides of '{topic}': {error}") from error

    def _mismatch(self, topic: str, other: str, own: str, event: Any) -> None:
        self.qos_mismatches += event.total_count_change
        policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
        self._node.get_logger().warning(
            f"a {other} on {topic} has an incompatible QoS and is not connected: {policy} differs; "
            f"set the parameter 'qos_overrides.{topic}.{own}.{policy}'")


def _overriding() -> QoSOverridingOptions:
    return QoSOverridingOptions(_OPEN)


_TWO_ARGUMENTS = inspect.signature(lambda message, info: None)
