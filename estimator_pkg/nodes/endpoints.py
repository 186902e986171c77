# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Subscriptions and publishers of a node, and the problems that DDS reports."""

from __future__ import annotations

import importlib
import inspect
import warnings
from collections.abc import Callable, Mapping
from time import monotonic, time_ns
from typing import Any

from rclpy.clock import Clock
from rclpy.event_handler import (
    PublisherEventCallbacks,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, _declare_qos_parameters
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.nodes.faults import listed, say
from estimator_pkg.nodes.inputs import Input
from estimator_pkg.nodes.misfits import full_name, misfits, type_name
from estimator_pkg.nodes.outputs import Output, Outputs
from estimator_pkg.nodes.qos import estimates, overriding, sensor_data
from estimator_pkg.nodes.ros_parameters import QOS, in_words
from estimator_pkg.ros import observers


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
LEFT = 20  # nodes that are remembered after they ended

Receive = Callable[[bytes, Mapping[str, Any]], None]  # (CDR bytes, message info)


class Endpoints:
    """Creates a node's subscriptions and publishers and counts the problems that DDS reports.

    Parameters
    ----------
    node : the node. wait_for_subscriber : see `Outputs` [s].

    Attributes
    ----------
    qos_mismatches : number of publishers and subscriptions with incompatible QoS.
    outputs : the topics of answers.
    """

    def __init__(self, node: Node, wait_for_subscriber: float) -> None:
        self._node = node
        self.qos_mismatches = 0
        self.outputs = Outputs(wait_for_subscriber)
        self._inputs: list[Input] = []
        self._publishers: list[Publisher] = []
        self._written: dict[str, str] = {}  # topic -> the same before remapping
        self._around: list[int] = []  # publishers of our inputs, subscriptions to our outputs
        self._discovered = monotonic() + UNCHANGED_AT_START  # when all of them know us
        self._often: Timer | None = None  # calls `connect`
        self._started = monotonic()
        self._first_seen: dict[bytes, float] = {}  # publishers of our first output, by identity

    @property
    def inputs(self) -> list[str]:
        """Names of the input topics."""
        return [each.topic_name for each in self._inputs]

    @property
    def lost(self) -> dict[str, int]:
        """Messages lost on the way to our subscriptions since they were made, by topic."""
        return {each.topic_name: each.loss.lost for each in self._inputs}

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
        around = [node.count_publishers(each.topic_name) for each in self._inputs]
        known, matched = tuple(around), True
        if not all(each.subscription for each in self._inputs):
            listeners = [node.count_subscribers(each.topic_name) for each in self._publishers]
            around += listeners
            matched = all(
                each.get_subscription_count() >= count
                for each, count in zip(self._publishers, listeners)
            )
        if around != self._around:
            self._around, self._discovered = around, max(self._discovered, now + UNCHANGED)
        discovered = now >= self._discovered + (0.0 if matched else UNMATCHED)
        for each, publishers in zip(self._inputs, known):
            each.connect(publishers, discovered, node)
        connected = all(each.subscription for each in self._inputs)
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
            for each in self._inputs:
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
        for each in self._inputs:
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
        own = {*self.inputs, *(publisher.topic_name for publisher in self._publishers)}
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
        self,
        kind: type,
        topic: str,
        receive: Receive,
        qos: QoSProfile | None = None,
        *,
        optional: bool = False,
    ) -> Input:
        """Return an input that `connect` subscribes; `receive` gets every message's bytes and info.

        Parameters
        ----------
        optional : the node works without a publisher of it.

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
                event_callbacks=SubscriptionEventCallbacks(
                    incompatible_qos=self._mismatch, **events
                ),
            )

        made = Input(
            name,
            kind,
            lambda: self._made(topic, make, {'matched': matched, 'message_lost': reported}),
            topic,
            profile,
            optional,
        )
        loss = made.loss
        saw = loss.saw

        def callback(*arguments: Any) -> None:
            # EventsExecutor of rclpy 7.1 passes one tuple, other executors two arguments.
            raw, info = arguments if len(arguments) == 2 else arguments[0]
            saw(info['publication_sequence_number'], info['source_timestamp'])
            if made.watched:
                made.senders.saw(raw, info['publication_sequence_number'])
            receive(raw, info)

        callback.__signature__ = _TWO_ARGUMENTS  # type: ignore[attr-defined]  # rclpy counts them
        made.callback = callback

        def matched(event: Any) -> None:
            if event.current_count_change < 0:
                if event.current_count:  # else its last messages may wait, and show what is lost
                    loss.forget(time_ns())
                self._look_often()

        def reported(event: Any) -> None:
            loss.reported += event.total_count_change

        # Now, so that a wrong one ends the start.
        self._made(
            topic,
            lambda **_: _declare_qos_parameters(
                Subscription, self._node, name, profile, overriding()
            ),
            {},
        )
        self._inputs.append(made)
        return made

    def look(self) -> None:
        """Check for publishers and subscribers, and receive waiting messages; to be called
        regularly.
        """
        self.connect()
        for each in self._inputs:
            each.drain()

    def publisher(self, kind: type, topic: str, qos: QoSProfile | None = None) -> Publisher:
        """Create a publisher; raise UsageError for a wrong ``qos_overrides`` parameter.

        One that such a parameter makes transient local is latched, as the user expects of it.
        """
        name = f'{QOS}{self._node.resolve_topic_name(topic)}.publisher.durability'
        durability = self._node._parameter_overrides.get(name)
        latches = durability is not None and durability.value == 'transient_local'

        def make() -> Publisher:
            return self._node.create_publisher(
                kind,
                topic,
                qos or (estimates(depth=1) if latches else estimates()),
                qos_overriding_options=overriding(),
                event_callbacks=PublisherEventCallbacks(incompatible_qos=self._mismatch),
            )

        made: Publisher = self._made(topic, make, {})
        self._publishers.append(made)
        self._written[made.topic_name] = topic
        return made

    def output(self, kind: type, topic: str, qos: QoSProfile | None, on_demand: bool) -> Output:
        """Create an output of answers; raises as `publisher`."""
        made = Output(self.publisher(kind, topic, qos), on_demand)
        self.outputs.append(made)
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

    def _mismatch(self, event: Any) -> None:
        # the change is 0 where the other side was there before: an event is one at least
        self.qos_mismatches += max(1, event.total_count_change)


_TWO_ARGUMENTS = inspect.signature(lambda message, info: None)
