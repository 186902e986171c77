# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Subscriptions and publishers of a node: QoS that users can override, and their problems."""

from __future__ import annotations

import importlib
import inspect
import warnings
from collections.abc import Callable, Mapping
from time import monotonic, time_ns
from typing import Any

from rcl_interfaces.msg import SetParametersResult
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
    HistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import (
    InvalidQosOverridesError,
    QoSOverridingOptions,
    _declare_qos_parameters,
)
from rclpy.subscription import Subscription

from estimator_pkg.errors import UsageError
from estimator_pkg.nodes.ros_parameters import in_words
from estimator_pkg.ros.executor import waiting
from estimator_pkg.ros.loss import Loss


def get_message(name: str) -> Any:
    """Return the message class of a type's name, as in 'sensor_msgs/msg/JointState'."""
    package, _, kind = name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), kind)


def sensor_data() -> QoSProfile:
    """QoS of inputs: best effort matches every publisher; depth 200 bridges 0.2 s at 1 kHz."""
    return QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)


def estimates() -> QoSProfile:
    """QoS for outputs: reliable; depth 500 keeps what a subscriber missed while it connected."""
    return QoSProfile(depth=500, reliability=ReliabilityPolicy.RELIABLE)


def latched() -> QoSProfile:
    """QoS for latched topics: late joiners get the last message."""
    return QoSProfile(
        depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
    )


_OPEN = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)

DEEPEST = 100_000  # largest depth of a queue
SETTLED = 0.1  # [s] without a change among publishers and subscribers: they know us, too
SETTLED_AT_START = 0.5  # [s] the same after our start: they are not all known at once
WAIT_FOR_PUBLISHER = 10.0  # [s] without a publisher, after which we subscribe all the same:
# some bridges publish only topics that have a subscriber
UNNAMED = '_NODE_NAME_UNKNOWN_'  # ROS's name for a node that is not completely discovered

Receive = Callable[[bytes, Mapping[str, Any]], None]  # (CDR bytes, message info)


class Input:
    """A topic that a node reads, subscribed to while it has a publisher.

    A publisher knows of a subscription up to 0.1 s before the subscription knows of the publisher,
    and DDS drops the best-effort messages of that time unseen. A subscription that is made when the
    publisher is known knows it from its beginning, before the publisher can know of it.

    Parameters
    ----------
    topic_name : fully qualified. kind : message class.
    make : makes the subscription.

    Attributes
    ----------
    subscription : None while there is none.
    callback : receives its messages. loss : counts those that are lost.
    unpublished_since : when a publisher was last known, by `monotonic` [s].
    """

    def __init__(self, topic_name: str, kind: type, make: Callable[[], Subscription]) -> None:
        self.topic_name, self.kind, self._make = topic_name, kind, make
        self.subscription: Subscription | None = None
        self.callback: Callable[..., None]
        self.loss = Loss(self.publishers)
        self.unpublished_since = monotonic()
        self._served = False  # True after a publisher was known

    def publishers(self) -> int:
        """The number of publishers that are connected."""
        return 0 if self.subscription is None else self.subscription.get_publisher_count()

    def connect(self, known: int, settled: bool, node: Node) -> None:
        """Make the subscription, or destroy it after its last publisher.

        Parameters
        ----------
        known : number of publishers on the topic.
        settled : they have had time to discover this node.
        """
        now = monotonic()
        if known:
            self.unpublished_since = now
        if self.subscription is None:
            if settled if known else now - self.unpublished_since >= WAIT_FOR_PUBLISHER:
                self.loss.begins(time_ns())
                self._served = False
                self.subscription = self._make()
        elif known:
            self._served = True
        elif self._served:
            self.drain()
            node.destroy_subscription(self.subscription)
            self.subscription = None
            self.loss.forget()

    def drain(self) -> None:
        """Receive the messages that wait."""
        if self.subscription is not None:
            for raw, info in waiting(self.subscription):
                self.callback(raw, info)


class OnDemand:
    """A publisher of messages that are made only while there is a subscriber.

    Attributes
    ----------
    wanted : True if there was a subscriber at the last check.
    publish : publishes a message.
    """

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher
        self.publish = publisher.publish
        self.wanted = False

    def look(self) -> None:
        """Check for subscribers."""
        self.wanted = self._publisher.get_subscription_count() > 0


class Endpoints:
    """Creates a node's subscriptions and publishers and counts the problems that DDS reports.

    Attributes
    ----------
    qos_mismatches : number of publishers and subscriptions with incompatible QoS.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.qos_mismatches = 0
        self._inputs: list[Input] = []
        self._publishers: list[Publisher] = []
        self._on_demand: list[OnDemand] = []
        self._around: list[int] = []  # publishers of our inputs, subscriptions to our outputs
        self._settled = monotonic() + SETTLED_AT_START  # when all of them know us

    @property
    def inputs(self) -> list[str]:
        """Names of the input topics."""
        return [each.topic_name for each in self._inputs]

    @property
    def lost(self) -> dict[str, int]:
        """Messages lost on the way to our subscriptions since they were made, by topic."""
        return {each.topic_name: each.loss.lost for each in self._inputs}

    def connect(self) -> None:
        """Subscribe to topics that have a publisher; to be called often.

        A subscriber of our outputs must know them before, or it would miss the first answers.
        """
        now, node = monotonic(), self._node
        around = [node.count_publishers(each.topic_name) for each in self._inputs]
        known = tuple(around)
        if not all(each.subscription for each in self._inputs):
            around += [node.count_subscribers(each.topic_name) for each in self._publishers]
        if around != self._around:
            self._around, self._settled = around, max(self._settled, now + SETTLED)
        for each, publishers in zip(self._inputs, known):
            each.connect(publishers, now >= self._settled, node)

    def of_other_types(self) -> list[str]:
        """Return, as texts, the publishers on our inputs with another message type.

        DDS does not report them: they are not connected, as if they did not exist.
        """
        texts = []
        for each in self._inputs:
            topic, expected = each.topic_name, _type_name(each.kind)
            texts += [
                f'{found.node_name} publishes {found.topic_type} on {topic}, where this node '
                f'needs {expected}: they are not connected; remap one of them'
                for found in self._node.get_publishers_info_by_topic(topic)
                if found.topic_type != expected and found.node_name != UNNAMED
            ]
        return texts

    def subscribe(
        self, kind: type, topic: str, receive: Receive, qos: QoSProfile | None = None
    ) -> Input:
        """Return an input that `connect` subscribes; `receive` gets every message's bytes and info.

        Raises
        ------
        UsageError : a wrong ``qos_overrides`` parameter.
        """
        name, profile = self._node.resolve_topic_name(topic), qos or sensor_data()

        def make(**events: Any) -> Subscription:
            return self._node.create_subscription(
                kind,
                topic,
                callback,
                profile,
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(incompatible_qos=mismatch, **events),
            )

        made = Input(
            name,
            kind,
            lambda: self._made(topic, make, {'matched': matched, 'message_lost': reported}),
        )
        loss = made.loss
        saw = loss.saw

        def callback(*arguments: Any) -> None:
            # EventsExecutor of rclpy 7.1 passes one tuple, other executors two arguments.
            raw, info = arguments if len(arguments) == 2 else arguments[0]
            saw(info['publication_sequence_number'], info['source_timestamp'])
            receive(raw, info)

        callback.__signature__ = _TWO_ARGUMENTS  # type: ignore[attr-defined]  # rclpy counts them
        made.callback = callback

        def mismatch(event: Any) -> None:
            self._mismatch(name, 'publisher', 'subscription', event)

        def matched(event: Any) -> None:
            if event.current_count_change < 0:
                loss.forget()

        def reported(event: Any) -> None:
            loss.reported += event.total_count_change

        # Now, so that a wrong one ends the start.
        self._made(
            topic,
            lambda **_: _declare_qos_parameters(
                Subscription, self._node, name, profile, _overriding()
            ),
            {},
        )
        self._inputs.append(made)
        return made

    def look(self) -> None:
        """Check for subscribers, and receive waiting messages; to be called regularly."""
        self._drain()
        for publisher in self._on_demand:
            publisher.look()

    def _drain(self) -> None:
        """Receive the messages that still wait on the subscriptions."""
        for each in self._inputs:
            each.drain()

    def publisher(self, kind: type, topic: str, qos: QoSProfile | None = None) -> Publisher:
        """Create a publisher; raise UsageError for a wrong ``qos_overrides`` parameter."""
        holder: list[Publisher] = []

        def mismatch(event: Any) -> None:
            self._mismatch(holder[0].topic_name, 'subscription', 'publisher', event)

        def make() -> Publisher:
            return self._node.create_publisher(
                kind,
                topic,
                qos or estimates(),
                qos_overriding_options=_overriding(),
                event_callbacks=PublisherEventCallbacks(incompatible_qos=mismatch),
            )

        holder.append(self._made(topic, make, {}))
        self._publishers.append(holder[0])
        return holder[0]

    def on_demand(self, kind: type, topic: str) -> OnDemand:
        """Create a publisher of messages made on demand; raises as `publisher`."""
        made = OnDemand(self.publisher(kind, topic))
        self._on_demand.append(made)
        return made

    def _made(self, topic: str, make: Callable[..., Any], events: dict[str, Any]) -> Any:
        try:
            with warnings.catch_warnings():  # about a depth of 0, which is refused
                warnings.simplefilter('ignore', UserWarning)
                try:
                    return make(**events)
                except UnsupportedEventTypeError:  # this middleware has no such events
                    return make()
        except ParameterException as error:
            raise UsageError(in_words(error)) from error
        except (
            InvalidQosOverridesError,
            AssertionError,
            RuntimeError,
            TypeError,
            ValueError,
        ) as error:
            why = str(error).rpartition('are not valid: ')[2]
            raise UsageError(f"qos_overrides of '{topic}': {why}") from error

    def _mismatch(self, topic: str, other: str, own: str, event: Any) -> None:
        # the change is 0 where the other side was there before: an event is one at least
        self.qos_mismatches += max(1, event.total_count_change)
        policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
        self._node.get_logger().warning(
            f'a {other} on {topic} has an incompatible QoS and is not connected: {policy} differs; '
            f"set the parameter 'qos_overrides.{topic}.{own}.{policy}'"
        )


def _overriding() -> QoSOverridingOptions:
    return QoSOverridingOptions(_OPEN, callback=_possible)


def _possible(qos: QoSProfile) -> SetParametersResult:
    """Check that the depth is valid; the middleware would report it in ten lines."""
    if 1 <= qos.depth <= DEEPEST or qos.history == HistoryPolicy.KEEP_ALL:
        return SetParametersResult(successful=True)
    return SetParametersResult(
        successful=False, reason=f'depth {qos.depth} is outside [1, {DEEPEST}]'
    )


def _type_name(kind: Any) -> str:
    package, what, _ = kind.__module__.split('.', 2)
    return f'{package}/{what}/{kind.__name__}'


_TWO_ARGUMENTS = inspect.signature(lambda message, info: None)
