# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Inputs and outputs of a node: their QoS, and when they are connected.

An input is subscribed to while its topic has a publisher; the first messages of an output wait for
a subscriber.
"""

from __future__ import annotations

import importlib
import inspect
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from time import monotonic, time_ns
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import ParameterException
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import (
    InvalidQosOverridesError,
    QoSOverridingOptions,
    _declare_qos_parameters,
)
from rclpy.subscription import Subscription

from estimator_pkg.errors import UsageError
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.nodes.ros_parameters import QOS, in_words
from estimator_pkg.nodes.senders import Senders
from estimator_pkg.ros.executor import take_turn
from estimator_pkg.ros.loss import Loss

UNCHANGED = 0.1  # [s] without a change among publishers and subscribers: they know us, too
UNCHANGED_AT_START = 0.5  # [s] the same after our start: they are not all known at once
WAIT_FOR_PUBLISHER = 10.0  # [s] without a publisher, after which we subscribe all the same:
# some bridges publish only topics that have a subscriber
TOGETHER = 0.1  # [s] between the first and the last subscription of one process, at most
DEEPEST = 100_000  # largest depth of a queue


def _qos(depth: int, reliability: ReliabilityPolicy, **others: Any) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=reliability, **others)  # new: rclpy changes it


# Best effort matches every publisher; depth 200 bridges 0.2 s at 1 kHz.
sensor_data = partial(_qos, 200, ReliabilityPolicy.BEST_EFFORT)
# The queue keeps what a subscriber missed while it connected.
estimates = partial(_qos, 500, ReliabilityPolicy.RELIABLE)
# Late joiners get the last message.
latched = partial(_qos, 1, ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)

Receive = Callable[[bytes, Mapping[str, Any]], None]  # (CDR bytes, message info)


def get_message(name: str) -> Any:
    """Return the message class of a type's name, as in 'sensor_msgs/msg/JointState'."""
    package, _, kind = name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), kind)


def type_name(kind: Any) -> str:
    """Return the name of a message class, as in 'sensor_msgs/msg/JointState'."""
    package, what, _ = kind.__module__.split('.', 2)
    return f'{package}/{what}/{kind.__name__}'


def _possible(qos: QoSProfile) -> SetParametersResult:
    """Check that the depth is valid; the middleware would report it in ten lines."""
    if 1 <= qos.depth <= DEEPEST or qos.history == HistoryPolicy.KEEP_ALL:
        return SetParametersResult(successful=True)
    reason = f'depth {qos.depth} is outside [1, {DEEPEST}]'
    return SetParametersResult(successful=False, reason=reason)


OVERRIDING = QoSOverridingOptions(
    (
        QoSPolicyKind.HISTORY,
        QoSPolicyKind.DEPTH,
        QoSPolicyKind.RELIABILITY,
        QoSPolicyKind.DURABILITY,
    ),
    callback=_possible,
)


@contextmanager
def _in_words(topic: str) -> Iterator[None]:
    """Turn rclpy's errors about ``qos_overrides`` of a topic into UsageError."""
    try:
        with warnings.catch_warnings():  # about a depth of 0, which is refused
            warnings.simplefilter('ignore', UserWarning)
            yield
    except ParameterException as error:
        raise UsageError(in_words(error)) from error
    except (InvalidQosOverridesError, AssertionError, RuntimeError, TypeError, ValueError) as error:
        why = str(error).rpartition('are not valid: ')[2]
        raise UsageError(f"qos_overrides of '{topic}': {why}") from error


class Input:
    """A topic that a node reads, subscribed to while it has a publisher.

    A publisher knows of a subscription up to 0.1 s before the subscription knows of the publisher,
    and DDS drops the best-effort messages of that time unseen. A subscription that is made when the
    publisher is known knows it from its beginning, before the publisher can know of it.

    Parameters
    ----------
    node : the node that reads. kind : message class.
    port : name of the topic before remapping.
    receive : gets the bytes of every message, and its info.
    optional : the node works without a publisher of it.
    mismatch : called for a publisher with an incompatible QoS.

    Attributes
    ----------
    topic_name : fully qualified. type : name of the message class. qos : requested.
    found : nodes that publish the topic so that they are connected, at the last examination.
    left : nodes that were found before, and when they were missed, by `monotonic` [s]; the last.
    senders : what the messages carry.
    subscription : None while there is none.
    loss : counts the messages that are lost.

    Raises
    ------
    UsageError : a wrong ``qos_overrides`` parameter.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        port: str,
        receive: Receive,
        optional: bool,
        mismatch: Callable[[Any], None],
    ) -> None:
        self._node, self._kind, self.port, self.optional = node, kind, port, optional
        self._receive, self._mismatch = receive, mismatch
        self.topic_name, self.type = node.resolve_topic_name(port), type_name(kind)
        self.qos = sensor_data()
        self.found: list[str] = []
        self.left: dict[str, float] = {}
        self.senders = Senders(self.type == JOINT_STATE)
        self.subscription: Subscription | None = None
        self.loss = Loss(self.publishers)
        self._unpublished_since = monotonic()  # when a publisher was last known [s]
        self._served = False  # True after a publisher was known
        with _in_words(port):  # now, so that a wrong one ends the start
            _declare_qos_parameters(Subscription, node, self.topic_name, self.qos, OVERRIDING)

    def publishers(self) -> int:
        """The number of publishers that are connected."""
        return 0 if self.subscription is None else self.subscription.get_publisher_count()

    def connect(self, known: int, discovered: bool) -> None:
        """Make the subscription, or destroy it after its last publisher.

        Parameters
        ----------
        known : number of publishers on the topic.
        discovered : they have had time to discover this node.
        """
        now = monotonic()
        if known:
            self._unpublished_since = now
        if self.subscription is None:
            if discovered if known else now - self._unpublished_since >= WAIT_FOR_PUBLISHER:
                self.loss.begins(time_ns())
                self._served = False
                self.subscription = self._subscribe()
        elif known:
            self._served = True
        elif isinstance(self._node.executor, MultiThreadedExecutor):
            return  # another of its threads may be about to wait for the subscription
        elif self._served and self.drain():
            self._node.destroy_subscription(self.subscription)
            self.subscription = None
            self.loss.forget(time_ns())

    def drain(self) -> bool:
        """Receive messages that wait, for one turn of the executor; return True if none is left.

        EventsExecutor takes one message for each event. An event that comes while it takes a node
        or a subscription in may go unnoticed, and every message after it would be one message late.
        """
        return self.subscription is None or take_turn(self.subscription, self._came)

    def _subscribe(self) -> Subscription:
        def callback(*arguments: Any) -> None:
            # EventsExecutor of rclpy 7.1 passes one tuple, other executors two arguments.
            self._came(*(arguments if len(arguments) == 2 else arguments[0]))

        callback.__signature__ = _TWO_ARGUMENTS  # type: ignore[attr-defined]  # rclpy counts them
        events = SubscriptionEventCallbacks(
            incompatible_qos=self._mismatch, matched=self._matched, message_lost=self._reported
        )
        with _in_words(self.port):
            return self._node.create_subscription(
                self._kind, self.port, callback, self.qos, raw=True, event_callbacks=events
            )

    def _came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        number = info['publication_sequence_number']
        self.loss.saw(number, info['source_timestamp'])
        self.senders.saw(raw, number)
        self._receive(raw, info)

    def _matched(self, event: Any) -> None:
        if event.current_count_change < 0 and event.current_count:
            self.loss.forget(time_ns())  # else its last messages may wait, and show what is lost

    def _reported(self, event: Any) -> None:
        self.loss.reported += event.total_count_change


_TWO_ARGUMENTS = inspect.signature(lambda message, info: None)


class Output:
    """A topic of answers, which at the start wait for their first subscriber.

    A publisher sends nothing to a subscription that it does not know, and on a busy machine DDS
    discovers a process seconds late: one that has found us may be unknown to us. So the answers of
    the first seconds are kept, as many as the publisher itself keeps, until somebody subscribes.
    (Fast DDS announces a process every 3 s.)

    Parameters
    ----------
    on_demand : its messages are made only while there is a subscriber, or one is waited for.

    Attributes
    ----------
    wanted : True if messages are to be made.
    publish : publishes a message, or keeps it.
    topic_name : fully qualified.
    """

    def __init__(self, publisher: Publisher, on_demand: bool) -> None:
        self._publisher, self._on_demand = publisher, on_demand
        self.topic_name = publisher.topic_name
        self._kept: deque[bytes] = deque(maxlen=publisher.qos_profile.depth)
        self.wanted = self._waits = True
        self.publish: Any = self._kept.append

    def look(self, wait: bool) -> bool:
        """Check for subscribers and return True if there are any.

        Parameters
        ----------
        wait : keep waiting if there are none.
        """
        known = self._publisher.get_subscription_count() > 0
        if self._waits and (known or not wait):
            self._waits, self.publish = False, self._publisher.publish
            for message in self._kept:
                self.publish(message)
            self._kept.clear()
        self.wanted = known or self._waits or not self._on_demand
        return known


class Endpoints:
    """Creates a node's subscriptions and publishers and counts the problems that DDS reports.

    Parameters
    ----------
    node : the node.
    wait_for_subscriber : for how long after the inputs are connected the outputs wait for a
        subscriber, together [s]; 0: not at all.

    Attributes
    ----------
    qos_mismatches : number of publishers and subscriptions with incompatible QoS.
    inputs : by port, the measurement first.
    outputs : the topics of answers. publishers : of all topics.
    """

    def __init__(self, node: Node, wait_for_subscriber: float) -> None:
        self._node, self._wait = node, wait_for_subscriber
        self.qos_mismatches = 0
        self.inputs: list[Input] = []
        self.outputs: list[Output] = []
        self.publishers: list[Publisher] = []
        self._around: list[int] = []  # publishers of our inputs, subscriptions to our outputs
        self._discovered = monotonic() + UNCHANGED_AT_START  # when all of them know us
        self._until = float('inf') if wait_for_subscriber else 0.0  # the outputs wait

    @property
    def lost(self) -> dict[str, int]:
        """Messages lost on the way to our subscriptions since they were made, by topic."""
        return {each.topic_name: each.loss.lost for each in self.inputs}

    def look(self) -> None:
        """Subscribe to topics that have a publisher, check for subscribers, and receive waiting
        messages; to be called ten times a second.
        """
        now, count = monotonic(), self._node.count_publishers
        known = [count(each.topic_name) for each in self.inputs]
        listeners = [self._node.count_subscribers(each.topic_name) for each in self.outputs]
        if known + listeners != self._around:
            self._around = known + listeners
            self._discovered = max(self._discovered, now + UNCHANGED)
        for each, publishers in zip(self.inputs, known):
            each.connect(publishers, discovered=now >= self._discovered)
        if all(each.subscription for each in self.inputs):
            self._until = min(self._until, now + self._wait)
        heard = [output.look(wait=now < self._until) for output in self.outputs]
        if any(heard):
            self._until = min(self._until, now + TOGETHER)
        for each in self.inputs:
            each.drain()

    def refuse_circles(self) -> None:
        """Raise UsageError if an output is published on a topic that the node reads."""
        topics = {output.topic_name for output in self.outputs}
        for each in self.inputs:
            if each.topic_name in topics:
                name = each.topic_name.rpartition('/')[2]
                raise UsageError(
                    f'the input {each.port} and an output are the same topic {each.topic_name}, so '
                    "the node would read its own output: remap the input to the driver's topic, as "
                    f"in '-r {each.port}:={name}_raw'"
                )

    def subscribe(
        self, kind: type, topic: str, receive: Receive, *, optional: bool = False
    ) -> None:
        """Add an input, which `look` subscribes; raises as `Input`."""
        self.inputs.append(Input(self._node, kind, topic, receive, optional, self._mismatch))

    def publisher(self, kind: type, topic: str, qos: QoSProfile | None = None) -> Publisher:
        """Create a publisher; raise UsageError for a wrong ``qos_overrides`` parameter.

        One that such a parameter makes transient local is latched, as the user expects of it.
        """
        name = f'{QOS}{self._node.resolve_topic_name(topic)}.publisher.durability'
        durability = self._node._parameter_overrides.get(name)
        qos = qos or estimates()
        if durability is not None and durability.value == 'transient_local':
            qos.depth = 1
        with _in_words(topic):
            made = self._node.create_publisher(
                kind,
                topic,
                qos,
                qos_overriding_options=OVERRIDING,
                event_callbacks=PublisherEventCallbacks(incompatible_qos=self._mismatch),
            )
        self.publishers.append(made)
        return made

    def output(self, kind: type, topic: str, qos: QoSProfile | None, on_demand: bool) -> None:
        """Add an output of answers; raises as `publisher`."""
        self.outputs.append(Output(self.publisher(kind, topic, qos), on_demand))

    def _mismatch(self, event: Any) -> None:
        # the change is 0 where the other side was there before: an event is one at least
        self.qos_mismatches += max(1, event.total_count_change)
