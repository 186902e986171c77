# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Subscriptions and publishers of a node: QoS that users can override, and their problems."""

from __future__ import annotations

import importlib
import inspect
import warnings
from collections.abc import Callable, Iterable, Mapping
from time import monotonic, time_ns
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.duration import Infinite
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
    LivelinessPolicy,
    QoSCompatibility,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.qos_overriding_options import (
    InvalidQosOverridesError,
    QoSOverridingOptions,
    _declare_qos_parameters,
)
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.nodes.faults import Senders, listed, say
from estimator_pkg.nodes.ros_parameters import in_words
from estimator_pkg.ros.executor import take_turn
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
CONNECT = 0.02  # [s] between looks for publishers, while a topic is not subscribed to
SETTLED = 0.1  # [s] without a change among publishers and subscribers: they know us, too
SETTLED_AT_START = 0.5  # [s] the same after our start: they are not all known at once
UNMATCHED = 1.0  # [s] that are waited for subscribers of our outputs that are not connected yet;
# one whose QoS does not fit never is
WAIT_FOR_PUBLISHER = 10.0  # [s] without a publisher, after which we subscribe all the same:
# some bridges publish only topics that have a subscriber
LEFT = 20  # nodes that are remembered after they ended
UNNAMED_PUBLISHER = 'an unnamed publisher'
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
        self.type = _type_name(kind)
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
        self._written: dict[str, str] = {}  # topic -> the same before remapping
        self._on_demand: list[OnDemand] = []
        self._around: list[int] = []  # publishers of our inputs, subscriptions to our outputs
        self._settled = monotonic() + SETTLED_AT_START  # when all of them know us
        self._often: Timer | None = None  # calls `connect`

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
            self._around, self._settled = around, max(self._settled, now + SETTLED)
        settled = now >= self._settled + (0.0 if matched else UNMATCHED)
        for each, publishers in zip(self._inputs, known):
            each.connect(publishers, settled, node)
        if self._often is None:
            return
        if settled and all(each.subscription for each in self._inputs):
            self._often.cancel()  # `look` calls it, five times less often
        elif self._often.is_canceled():
            self._often.reset()

    def _look_often(self) -> None:
        """Call `connect` often for a while: a publisher left, and another one may come."""
        self._settled = max(self._settled, monotonic() + SETTLED)
        if self._often is not None:
            self._often.reset()

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
            wrong, each.found = self._misfits(others, topic, each.type, each.qos, 'publisher')
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
            kind, qos = _type_name(publisher.msg_type), publisher.qos_profile
            texts.update(self._misfits(others, topic, kind, qos, 'subscription')[0])
        return texts

    def _misfits(
        self, others: Iterable[Any], topic: str, kind: str, qos: QoSProfile, role: str
    ) -> tuple[dict[str, str], list[str]]:
        """Return (texts about endpoints of others that are not connected, names of the rest)."""
        texts, rest = {}, []
        qos = _offered(qos)
        for other in others:
            who = _full_name(other)
            if other.topic_type != kind:
                does = {'other': other.topic_type, 'topic': topic, 'type': kind}
                if role == 'publisher':
                    texts[f'type {topic} {who}'] = say('type', who=who, **does)
                continue
            ends = (other.qos_profile, qos) if role == 'publisher' else (qos, other.qos_profile)
            compatible, reason = qos_check_compatible(*ends)
            if compatible != QoSCompatibility.ERROR:
                rest.append(who)
                continue
            own = 'subscription' if role == 'publisher' else 'publisher'
            policy = next((each for word, each in _POLICIES.items() if word in reason), '')
            theirs, ours = (_value(each, policy) for each in (other.qos_profile, qos))
            remedy = (
                f"set the parameter 'qos_overrides.{topic}.{own}.{policy}' to {theirs}"
                if policy in ('reliability', 'durability')
                else f'change it in {who}'
            )
            values = {'policy': policy or 'QoS', 'theirs': theirs, 'ours': ours}
            texts[f'qos {topic} {who}'] = say(
                'qos', role=role, topic=topic, who=who, remedy=remedy, **values
            )
        return texts, rest

    def _instead(self, each: Input) -> str:
        """Return the topics with a publisher of an input's type that may be meant, as text."""
        node = self._node
        own = {*self.inputs, *(publisher.topic_name for publisher in self._publishers)}
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
                Subscription, self._node, name, profile, _overriding()
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
        self._drain()
        for publisher in self._on_demand:
            publisher.look()

    def _drain(self) -> None:
        """Receive the messages that still wait on the subscriptions."""
        for each in self._inputs:
            each.drain()

    def publisher(self, kind: type, topic: str, qos: QoSProfile | None = None) -> Publisher:
        """Create a publisher; raise UsageError for a wrong ``qos_overrides`` parameter."""

        def make() -> Publisher:
            return self._node.create_publisher(
                kind,
                topic,
                qos or estimates(),
                qos_overriding_options=_overriding(),
                event_callbacks=PublisherEventCallbacks(incompatible_qos=self._mismatch),
            )

        made: Publisher = self._made(topic, make, {})
        self._publishers.append(made)
        self._written[made.topic_name] = topic
        return made

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

    def _mismatch(self, event: Any) -> None:
        # the change is 0 where the other side was there before: an event is one at least
        self.qos_mismatches += max(1, event.total_count_change)


_POLICIES = {
    'eliab': 'reliability',
    'olatile': 'durability',
    'eadline': 'deadline',
    'iveliness': 'liveliness',
}  # word in the reason of `qos_check_compatible` -> policy


def _offered(qos: QoSProfile) -> QoSProfile:
    """Return one of our profiles as the graph shows it: the policies that we leave open are set."""
    return QoSProfile(
        depth=1,
        reliability=qos.reliability,
        durability=qos.durability,
        deadline=Infinite,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Infinite,
    )


def _value(qos: QoSProfile, policy: str) -> str:
    value = getattr(qos, policy, '')
    return str(getattr(value, 'name', value)).lower()


def _full_name(endpoint: Any) -> str:
    """Return the node of another's endpoint; a publisher outside ROS has none."""
    if endpoint.node_name == UNNAMED:
        return UNNAMED_PUBLISHER
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


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
