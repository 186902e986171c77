# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Inputs and outputs of a node: when they are connected, and the problems that DDS reports.

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
from time import monotonic, time_ns
from typing import Any

from rclpy.clock import Clock
from rclpy.event_handler import (
    PublisherEventCallbacks,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.exceptions import ParameterException
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, _declare_qos_parameters
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.nodes.faults import Senders, listed, say
from estimator_pkg.nodes.misfits import full_name, misfits, type_name
from estimator_pkg.nodes.qos import estimates, overriding, sensor_data
from estimator_pkg.nodes.ros_parameters import QOS, in_words
from estimator_pkg.ros import observers
from estimator_pkg.ros.executor import take_turn
from estimator_pkg.ros.loss import Loss


def get_message(name: str) -> Any:
    """Return the message class of a type's name, as in 'sensor_msgs/msg/JointState'."""
    package, _, kind = name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), kind)


CONNECT = 0.02  # [s] between looks for publishers, while a topic is not subscribed to
OFTEN_NS = round(1e9 * CONNECT)
SELDOM_NS = 10**15  # the same afterwards; another thread may have taken a timer that is canceled
UNCHANGED = 0.1  # [s] without a change among publishers and subscribers: they know us, too
UNCHANGED_AT_START = 0.5  # [s] the same after our start: they are not all known at once
UNMATCHED = 1.0  # [s] that are waited for subscribers of our outputs that are not connected yet;
# one whose QoS does not fit never is
GHOST = 25.0  # [s] for which one that was there at our start may have crashed: DDS shows it for 20
AT_START = 2.5  # [s] in which it is found
WAIT_FOR_PUBLISHER = 10.0  # [s] without a publisher, after which we subscribe all the same:
# some bridges publish only topics that have a subscriber
TOGETHER = 0.1  # [s] between the first and the last subscription of one process, at most
LEFT = 20  # nodes that are remembered after they ended

Receive = Callable[[bytes, Mapping[str, Any]], None]  # (CDR bytes, message info)


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
    mismatch, left : called for a publisher with an incompatible QoS, and after one has left.

    Attributes
    ----------
    topic_name : fully qualified. type : name of the message class. qos : requested.
    found : nodes that publish the topic so that they are connected, at the last examination.
    left : nodes that were found before, and when they were missed, by `monotonic` [s]; the last.
    unnamed : True if a publisher had no name at the last report; set by the reporter.
    senders : what the messages carry; they are only looked at while `watched`.
    subscription : None while there is none.
    loss : counts the messages that are lost.
    unpublished_since : when a publisher was last known, by `monotonic` [s].

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
        left: Callable[[], None],
    ) -> None:
        self._node, self._kind, self.port, self.optional = node, kind, port, optional
        self._receive, self._mismatch, self._publisher_left = receive, mismatch, left
        self.topic_name, self.qos = node.resolve_topic_name(port), sensor_data()
        self.type = type_name(kind)
        self.found: list[str] = []
        self.left: dict[str, float] = {}
        self.unnamed = False
        self.senders = Senders(self.type == JOINT_STATE)
        self.watched = True
        self.subscription: Subscription | None = None
        self.loss = Loss(self.publishers)
        self.unpublished_since = monotonic()
        self._served = False  # True after a publisher was known
        with _in_words(port):  # now, so that a wrong one ends the start
            _declare_qos_parameters(Subscription, node, self.topic_name, self.qos, overriding())

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
            self.unpublished_since = now
        if self.subscription is None:
            if discovered if known else now - self.unpublished_since >= WAIT_FOR_PUBLISHER:
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

        def make(**events: Any) -> Subscription:
            made = SubscriptionEventCallbacks(incompatible_qos=self._mismatch, **events)
            return self._node.create_subscription(
                self._kind, self.port, callback, self.qos, raw=True, event_callbacks=made
            )

        callback.__signature__ = _TWO_ARGUMENTS  # type: ignore[attr-defined]  # rclpy counts them
        with _in_words(self.port):
            try:
                return make(matched=self._matched, message_lost=self._reported)
            except UnsupportedEventTypeError:  # this middleware has no such events
                return make()

    def _came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        number = info['publication_sequence_number']
        self.loss.saw(number, info['source_timestamp'])
        if self.watched:
            self.senders.saw(raw, number)
        self._receive(raw, info)

    def _matched(self, event: Any) -> None:
        if event.current_count_change < 0:
            if event.current_count:  # else its last messages may wait, and show what is lost
                self.loss.forget(time_ns())
            self._publisher_left()

    def _reported(self, event: Any) -> None:
        self.loss.reported += event.total_count_change


_TWO_ARGUMENTS = inspect.signature(lambda message, info: None)


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
    waits : True while messages are kept.
    topic_name : fully qualified.
    """

    def __init__(self, publisher: Publisher, on_demand: bool) -> None:
        self._publisher, self._on_demand = publisher, on_demand
        self.topic_name = publisher.topic_name
        self._kept: deque[bytes] = deque(maxlen=publisher.qos_profile.depth)
        self.wanted = self.waits = True
        self.publish: Any = self._kept.append

    def look(self, wait: bool) -> bool:
        """Check for subscribers and return True if there are any.

        Parameters
        ----------
        wait : keep waiting if there are none.
        """
        known = self._publisher.get_subscription_count() > 0
        if self.waits and (known or not wait):
            self.waits, self.publish = False, self._publisher.publish
            for message in self._kept:
                self.publish(message)
            self._kept.clear()
        self.wanted = known or self.waits or not self._on_demand
        return known


class Outputs(list[Output]):
    """The outputs of a node. They wait for a subscriber together.

    Parameters
    ----------
    wait : for how long after the inputs are connected [s]; 0: not at all.
    """

    def __init__(self, wait: float) -> None:
        super().__init__()
        self._wait = wait
        self._until = float('inf') if wait else 0.0

    def look(self, connected: bool) -> bool:
        """Check for subscribers; return True while an output waits for one.

        Parameters
        ----------
        connected : the inputs are subscribed to.
        """
        now = monotonic()
        if connected:
            self._until = min(self._until, now + self._wait)
        known = [each.look(now < self._until) for each in self]
        if any(known):
            self._until = min(self._until, now + TOGETHER)
        return any(each.waits for each in self)


class Endpoints:
    """Creates a node's subscriptions and publishers and counts the problems that DDS reports.

    Parameters
    ----------
    node : the node. wait_for_subscriber : see `Outputs` [s].

    Attributes
    ----------
    qos_mismatches : number of publishers and subscriptions with incompatible QoS.
    inputs : by port, the measurement first.
    outputs : the topics of answers.
    """

    def __init__(self, node: Node, wait_for_subscriber: float) -> None:
        self._node = node
        self.qos_mismatches = 0
        self.outputs = Outputs(wait_for_subscriber)
        self.inputs: list[Input] = []
        self._publishers: list[Publisher] = []
        self._written: dict[str, str] = {}  # topic -> the same before remapping
        self._around: list[int] = []  # publishers of our inputs, subscriptions to our outputs
        self._discovered = monotonic() + UNCHANGED_AT_START  # when all of them know us
        self._often: Timer | None = None  # calls `connect`
        self._started = monotonic()
        self._first_seen: dict[bytes, float] = {}  # publishers of our first output, by identity

    @property
    def lost(self) -> dict[str, int]:
        """Messages lost on the way to our subscriptions since they were made, by topic."""
        return {each.topic_name: each.loss.lost for each in self.inputs}

    def open(self, clock: Clock) -> None:
        """Subscribe to topics that have a publisher, once the executor runs.

        Parameters
        ----------
        clock : of the looks for publishers.
        """
        self._often = self._node.create_timer(CONNECT, self.connect, clock=clock)

    def connect(self) -> None:
        """Subscribe to topics that have a publisher.

        A subscriber of our outputs must know them before, or it would miss the first answers.
        """
        now, node = monotonic(), self._node
        around = [node.count_publishers(each.topic_name) for each in self.inputs]
        known, matched = tuple(around), True
        if not all(each.subscription for each in self.inputs):
            listeners = [node.count_subscribers(each.topic_name) for each in self._publishers]
            around += listeners
            matched = all(
                each.get_subscription_count() >= count
                for each, count in zip(self._publishers, listeners)
            )
        if around != self._around:
            self._around, self._discovered = around, max(self._discovered, now + UNCHANGED)
        discovered = now >= self._discovered + (0.0 if matched else UNMATCHED)
        for each, publishers in zip(self.inputs, known):
            each.connect(publishers, discovered)
        connected = all(each.subscription for each in self.inputs)
        waits = self.outputs.look(connected)
        if self._often is None:
            return
        if discovered and connected and not waits:
            self._often.timer_period_ns = SELDOM_NS  # `look` calls it, five times less often
        elif self._often.timer_period_ns > OFTEN_NS:
            self._call_often(self._often)

    def _look_often(self) -> None:
        """Call `connect` often for a while: a publisher left, and another one may come."""
        self._discovered = max(self._discovered, monotonic() + UNCHANGED)
        if self._often is not None:
            self._call_often(self._often)

    @staticmethod
    def _call_often(timer: Timer) -> None:
        timer.timer_period_ns = OFTEN_NS
        timer.reset()

    def refuse_circles(self) -> None:
        """Raise UsageError if an output is published on a topic that the node reads."""
        for publisher in self._publishers:
            for each in self.inputs:
                if publisher.topic_name == each.topic_name:
                    name = each.topic_name.rpartition('/')[2]
                    raise UsageError(
                        f'{self._written[publisher.topic_name]} and the input {each.port} are the '
                        f'same topic {each.topic_name}, so the node would read its own output: '
                        f"remap the input to the driver's topic, as in '-r {each.port}:={name}_raw'"
                    )

    def faults(self) -> dict[str, str]:
        """Return what is wrong among the publishers of our inputs and the subscribers of our
        outputs, as texts by kind; DDS reports most of it to nobody.
        """
        node, texts = self._node, {}
        for each in self.inputs:
            topic = each.topic_name
            others = node.get_publishers_info_by_topic(topic)
            before = each.found
            wrong, each.found = misfits(others, topic, each.type, each.qos, 'publisher')
            each.left.update(dict.fromkeys(set(before) - set(each.found), monotonic()))
            for name in (*each.found, *list(each.left)[:-LEFT]):
                each.left.pop(name, None)
            texts.update(wrong)
            if not others and not each.optional:
                values = {'topic': topic, 'type': each.type, 'port': each.port}
                texts[f'nobody {topic}'] = say('nobody', **values, hint=self._instead(each))
        for publisher in self._publishers:
            topic = publisher.topic_name
            others = node.get_subscriptions_info_by_topic(topic)
            kind, qos = type_name(publisher.msg_type), publisher.qos_profile
            texts.update(misfits(others, topic, kind, qos, 'subscription')[0])
        texts.update(self._shared())
        return texts

    def _shared(self) -> dict[str, str]:
        """Return the text about another publisher of our first output, once it is surely alive."""
        node, topic, now = self._node, self.outputs[0].topic_name, monotonic()
        there = {
            bytes(each.endpoint_gid): each for each in node.get_publishers_info_by_topic(topic)
        }
        before = self._first_seen
        self._first_seen = {gid: before.get(gid, now) for gid in there}
        own = node.get_fully_qualified_name()
        who = sorted(
            (full_name(each) != own, self._first_seen[gid], full_name(each))
            for gid, each in there.items()
        )
        alive = [
            name
            for _, since, name in who[1:]  # the first one is this node
            if since > self._started + AT_START or now - since > GHOST
        ]
        return {f'shared {topic}': say('shared', who=listed(alive), topic=topic)} if alive else {}

    def _instead(self, each: Input) -> str:
        """Return the topics with a publisher of an input's type that may be meant, as text."""
        node = self._node
        own = {each.topic_name for each in self.inputs}
        own.update(each.topic_name for each in self._publishers)
        own.update(*(observers.outputs(node, name) for name in observers.observers(node)))
        names = sorted(
            name
            for name, kinds in node.get_topic_names_and_types()
            if each.type in kinds and name not in own and node.count_publishers(name)
        )
        if not names:
            return ''
        said = suggestion(each.topic_name, names)
        return f'; {said}' if 'mean' in said else f'; others of this type: {listed(names)}'

    def subscribe(
        self, kind: type, topic: str, receive: Receive, *, optional: bool = False
    ) -> None:
        """Add an input, which `connect` subscribes; raises as `Input`."""
        self.inputs.append(
            Input(self._node, kind, topic, receive, optional, self._mismatch, self._look_often)
        )

    def look(self) -> None:
        """Check for publishers and subscribers, and receive waiting messages; to be called
        regularly.
        """
        self.connect()
        for each in self.inputs:
            each.drain()

    def publisher(self, kind: type, topic: str, qos: QoSProfile | None = None) -> Publisher:
        """Create a publisher; raise UsageError for a wrong ``qos_overrides`` parameter.

        One that such a parameter makes transient local is latched, as the user expects of it.
        """
        name = f'{QOS}{self._node.resolve_topic_name(topic)}.publisher.durability'
        durability = self._node._parameter_overrides.get(name)
        latches = durability is not None and durability.value == 'transient_local'

        with _in_words(topic):
            made = self._node.create_publisher(
                kind,
                topic,
                qos or (estimates(depth=1) if latches else estimates()),
                qos_overriding_options=overriding(),
                event_callbacks=PublisherEventCallbacks(incompatible_qos=self._mismatch),
            )
        self._publishers.append(made)
        self._written[made.topic_name] = topic
        return made

    def output(self, kind: type, topic: str, qos: QoSProfile | None, on_demand: bool) -> Output:
        """Create an output of answers; raises as `publisher`."""
        made = Output(self.publisher(kind, topic, qos), on_demand)
        self.outputs.append(made)
        return made

    def _mismatch(self, event: Any) -> None:
        # the change is 0 where the other side was there before: an event is one at least
        self.qos_mismatches += max(1, event.total_count_change)
