# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator record``: write topics of the live graph into a bag, as received."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from estimator_pkg import interrupts
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.optional import Lazy
from estimator_pkg.printable import show
from estimator_pkg.ros.message_class import message_class

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile
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
QUIET_CHECKS = 3  # consecutive looks without a message after which all received ones are recorded
CHECK_TIME = 0.02  # time between these looks [s]
LONGEST_END_CHECKS = 0.3  # longest time for them [s]
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
    lost = {name: track.lost for name, track in recorder.tracks.items()}
    show(f'{parsed.out}:')
    for name, count in counts.items():
        show(f'  {name}  {count} messages' + (f', {lost[name]} lost' if lost[name] else ''))
    return {'bag': parsed.out, 'messages': counts, 'lost': lost}


@dataclass
class RecordedTopic:
    """A topic that is being recorded."""

    subscription: Subscription
    receive: Callable[[bytes, Any], None]
    qos: QoSProfile
    loss: Loss
    profiles: list[Qos]
    lost_before: int = 0

    @property
    def lost(self) -> int:
        """Number of messages lost between publisher and recorder."""
        return self.lost_before + self.loss.count


class Recorder:
    """Follows the graph and writes the received messages.

    Parameters
    ----------
    topics : names of topics; empty: all.
    """

    def __init__(self, here: Live, writer: BagWriter, topics: list[str]) -> None:
        self._here = here
        self._writer = writer
        self._topics = topics
        self._refused: set[str] = set()
        self._first_ns = 0
        self._received = 0
        self.tracks: dict[str, RecordedTopic] = {}

    def run(self, duration: float | None) -> None:
        """Record for `duration` [s] from the first message on, or until Ctrl-C."""
        look = flush = 0.0
        begun = time.monotonic()
        if self._topics:
            show(f'waiting for {", ".join(self._topics)}', file=sys.stderr)
        while not self._here.stopping:
            now = time.monotonic()
            if now >= look:
                self._look()
                look = now + GRAPH_PERIOD
            if now >= flush:
                self._writer.flush()
                flush = now + FLUSH_PERIOD
            self._take()
            since = self._first_ns * 1e-9 if self._first_ns else begun + FIRST_MESSAGE_WAIT
            if duration is not None and now - since > duration:
                break
            time.sleep(TAKE_PERIOD)
        until, quiet = time.monotonic() + LONGEST_END_CHECKS, 0
        while quiet < QUIET_CHECKS and time.monotonic() < until:
            quiet = 0 if self._take() else quiet + 1
            time.sleep(CHECK_TIME)

    def _take(self) -> bool:
        """Write the messages that came; return True if there were some."""
        before = self._received
        for track in self.tracks.values():
            executor.take_turn(track.subscription, track.receive, LONGEST_TURN)
        return self._received > before

    def _look(self) -> None:
        """Subscribe to new topics, and adapt to publishers that offer less than before."""
        for name, types in self._here.node.get_topic_names_and_types():
            if name in self._refused or (self._topics and name not in self._topics):
                continue
            publishers = self._here.node.get_publishers_info_by_topic(name)
            if not publishers:
                continue
            profiles = list(dict.fromkeys(live.offered(each.qos_profile) for each in publishers))
            track = self.tracks.get(name)
            if track is None:
                self._start(name, types, profiles, str(publishers[0].topic_type_hash))
            elif any(profile not in track.profiles for profile in profiles):
                self._adapt(name, types[0], track, profiles)

    def _start(self, name: str, types: list[str], profiles: list[Qos], type_hash: str) -> None:
        kind = message_class(types[0])
        if kind is None or len(types) > 1:
            self._refused.add(name)
            several = len(types) > 1
            why = 'it has several types' if several else f'its type {types[0]} is not installed'
            if self._topics:
                raise UserError(f'{name} cannot be recorded: {why}')
            show(f'warning: {name} is not recorded: {why}', file=sys.stderr)
            return
        self._writer.add_topic(
            name, types[0], profiles, type_hash=type_hash if type_hash.startswith('RIHS01_') else ''
        )
        self.tracks[name] = self._subscribe(name, kind, profiles)
        show(f'recording {name} ({types[0]})', file=sys.stderr)

    def _adapt(self, name: str, type_name: str, track: RecordedTopic, profiles: list[Qos]) -> None:
        """Subscribe again if a new publisher does not match the present subscription."""
        track.profiles += [profile for profile in profiles if profile not in track.profiles]
        qos = live.matching(track.profiles)
        if (qos.reliability, qos.durability) == (track.qos.reliability, track.qos.durability):
            return
        show(
            f'warning: a publisher of {name} offers less than the others: subscribing again',
            file=sys.stderr,
        )
        self._take()
        self._here.node.destroy_subscription(track.subscription)
        again = self._subscribe(name, message_class(type_name), track.profiles)
        again.lost_before = track.lost
        self.tracks[name] = again

    def _subscribe(self, name: str, kind: Any, profiles: list[Qos]) -> RecordedTopic:
        """Subscribe without an executor: `_take` polls, and DDS knows when each message came."""
        qos = live.matching(profiles)
        subscription = self._here.node.create_subscription(kind, name, _unused, qos, raw=True)
        counted = loss.Loss(subscription.get_publisher_count)

        def receive(raw: bytes, info: Any) -> None:
            counted.saw(info['publication_sequence_number'])
            now = time.time_ns()
            self._writer.write(
                name, info['received_timestamp'] or now, raw, info['source_timestamp'] or now
            )
            self._received += 1
            self._first_ns = self._first_ns or time.monotonic_ns()

        return RecordedTopic(subscription, receive, qos, counted, profiles)


def _unused(raw: bytes) -> None:
    """Stand in for the callback that rclpy requires."""


COMMAND = Command(
    'write topics of the live graph into a bag',
    arguments,
    run,
    examples=(
        ('/joint_states --out arm --duration 60', 'a minute of joint states'),
        ('--out everything', 'all topics, until Ctrl-C'),
    ),
)
