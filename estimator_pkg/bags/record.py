# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator record``: write topics of the live graph into a bag, as received."""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from estimator_pkg import interrupts
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.optional import Lazy
from estimator_pkg.printable import show
from estimator_pkg.ros.message_class import message_class

if TYPE_CHECKING:
    from rclpy.subscription import Subscription
    from rosbags.interfaces import Qos

    from estimator_pkg.bags.live import Live
    from estimator_pkg.ros.loss import Loss

executor = Lazy('estimator_pkg.ros.executor')
live = Lazy('estimator_pkg.bags.live')
loss = Lazy('estimator_pkg.ros.loss')

GRAPH_PERIOD = 0.1  # time between two checks of the graph [s]
FIRST_MESSAGE_WAIT = 10.0  # added to a duration while no message has arrived yet [s]
TAKE_PERIOD = 0.005  # time between two looks for messages [s]
LONGEST_TURN = 0.5  # longest time for the messages of one topic [s]
LAST_MESSAGES = 0.3  # time at the end for messages that have been received already [s]
FLUSH_PERIOD = 2.0  # time between two flushes to the disk [s]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        'topics',
        metavar='TOPIC',
        nargs='*',
        help='topics to record (default: all, also those that appear later)',
    )
    parser.add_argument('--out', metavar='BAG', required=True, help='bag to write')
    parser.add_argument(
        '--duration',
        metavar='S',
        type=float,
        help='end S seconds after the first message (after S + 10 s without any); default: Ctrl-C',
    )


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Record until Ctrl-C or for a duration; print and return the numbers of messages."""
    if parsed.duration is not None and not (
        math.isfinite(parsed.duration) and parsed.duration > 0.0
    ):
        raise UsageError(f'--duration is {parsed.duration:g} s: it must be above 0')
    with_ros = live.live  # prepares the environment of rclpy
    from rclpy.exceptions import InvalidTopicNameException
    from rclpy.validate_full_topic_name import validate_full_topic_name

    topics = [name if name.startswith('/') else f'/{name}' for name in parsed.topics]
    for name in topics:
        try:
            validate_full_topic_name(name)
        except InvalidTopicNameException:
            raise UsageError(f"'{name}' is not a valid topic name: correct it") from None
    with interrupts.gently(background=True), BagWriter(parsed.out, keep=True) as writer:
        with with_ros('bag_recorder') as here:
            recorder = Recorder(here, writer, topics)
            recorder.run(parsed.duration)
        counts = writer.counts()
        if not sum(counts.values()):
            raise UserError(
                'nothing was recorded: '
                + (
                    f'no messages arrived on {", ".join(topics)}: check the names'
                    if topics
                    else 'no topic had messages'
                )
            )
    lost = {
        name: sum(each.count for each in track.losses) for name, track in recorder.tracks.items()
    }
    show(f'{parsed.out}:')
    for name, count in counts.items():
        show(f'  {name}  {count} messages' + (f', {lost[name]} lost' if lost[name] else ''))
    return {'bag': parsed.out, 'messages': counts, 'lost': lost}


@dataclass
class RecordedTopic:
    """A topic that is being recorded.

    kind : class of its messages. profiles : all that its publishers offered. losses : of its
    subscription, and of those before it.
    """

    name: str
    kind: Any
    profiles: list[Qos] = field(default_factory=list)
    subscription: Subscription | None = None
    losses: list[Loss] = field(default_factory=list)


class Recorder:
    """Follows the graph and writes the received messages.

    Parameters
    ----------
    topics : names of topics; empty: all.
    """

    def __init__(self, here: Live, writer: BagWriter, topics: list[str]) -> None:
        self._here, self._writer, self._topics = here, writer, topics
        self._refused: set[str] = set()
        self._first = 0.0  # steady time of the first message [s]
        self.tracks: dict[str, RecordedTopic] = {}

    def run(self, duration: float | None) -> None:
        """Record for `duration` [s] from the first message on, or until Ctrl-C."""
        look = flush = 0.0
        now = begun = time.monotonic()
        if self._topics:
            show(f'waiting for {", ".join(self._topics)}', file=sys.stderr)
        while not self._here.stopping:
            if now >= look:
                self._look()
                look = now + GRAPH_PERIOD
            if now >= flush:
                self._writer.flush()
                flush = now + FLUSH_PERIOD
            self._take()
            now = time.monotonic()
            since = self._first or begun + FIRST_MESSAGE_WAIT
            if duration is not None and now - since > duration:
                break
        until = time.monotonic() + LAST_MESSAGES
        while time.monotonic() < until:
            self._take()

    def _take(self) -> None:
        """Write the messages that came."""
        for track in self.tracks.values():
            executor.take_turn(track.subscription, partial(self._receive, track), LONGEST_TURN)
        time.sleep(TAKE_PERIOD)

    def _receive(self, track: RecordedTopic, raw: bytes, info: Any) -> None:
        track.losses[-1].saw(info['publication_sequence_number'])
        now = time.time_ns()
        log_ns, publish_ns = info['received_timestamp'] or now, info['source_timestamp'] or now
        self._writer.write(track.name, log_ns, raw, publish_ns)
        self._first = self._first or time.monotonic()

    def _look(self) -> None:
        """Subscribe to new topics, and again where a publisher offers less than those before."""
        for name, types in self._here.node.get_topic_names_and_types():
            if name in self._refused or (self._topics and name not in self._topics):
                continue
            publishers = self._here.node.get_publishers_info_by_topic(name)
            if publishers and name not in self.tracks:
                self._declare(name, types, publishers)
            if name in self.tracks:
                profiles = [live.offered(each.qos_profile) for each in publishers]
                self._subscribe(self.tracks[name], profiles)

    def _declare(self, name: str, types: list[str], publishers: list[Any]) -> None:
        """Add a topic to the bag, or to those that cannot be recorded."""
        kind = message_class(types[0])
        if kind is None or len(types) > 1:
            self._refused.add(name)
            several = len(types) > 1
            why = 'it has several types' if several else f'its type {types[0]} is not installed'
            if self._topics:
                raise UserError(f'{name} cannot be recorded: {why}')
            show(f'warning: {name} is not recorded: {why}', file=sys.stderr)
            return
        profiles = list(dict.fromkeys(live.offered(each.qos_profile) for each in publishers))
        known = str(publishers[0].topic_type_hash)
        self._writer.add_topic(
            name, types[0], profiles, type_hash=known if known.startswith('RIHS01_') else ''
        )
        self.tracks[name] = RecordedTopic(name, kind)
        show(f'recording {name} ({types[0]})', file=sys.stderr)

    def _subscribe(self, track: RecordedTopic, profiles: list[Qos]) -> None:
        """Subscribe so that all publishers match, if the subscription does not do so already.

        There is no executor: `_take` polls, and DDS knows when each message came.
        """
        old = live.matching(track.profiles)
        track.profiles = list(dict.fromkeys([*track.profiles, *profiles]))
        qos = live.matching(track.profiles)
        if track.subscription is not None:
            if (qos.reliability, qos.durability) == (old.reliability, old.durability):
                return
            show(
                f'warning: a publisher of {track.name} offers less than the others: subscribing '
                'again',
                file=sys.stderr,
            )
            self._take()
            self._here.node.destroy_subscription(track.subscription)
        track.subscription = self._here.node.create_subscription(
            track.kind, track.name, lambda _: None, qos, raw=True
        )
        track.losses.append(loss.Loss(track.subscription.get_publisher_count))


COMMAND = Command(
    'write topics of the live graph into a bag',
    arguments,
    run,
    examples=(
        ('/joint_states --out arm --duration 60', 'a minute of joint states'),
        ('--out everything', 'all topics, until Ctrl-C'),
    ),
)
