# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator record``: write topics of the live graph into a bag, as received."""

from __future__ import annotations

import argparse
import inspect
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from estimator_pkg import interrupts
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.printable import show

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription
    from rosbags.interfaces import Qos

    from estimator_pkg.bags.live import Live
    from estimator_pkg.ros.loss import Loss

GRAPH_PERIOD = 0.1  # time between two checks of the graph [s]
FIRST_MESSAGE_WAIT = 10.0  # added to a duration while no message has arrived yet [s]
QUIET_CHECKS = 3  # consecutive checks without a message after which all received ones are recorded
CHECK_TIME = 0.02  # length of such a check [s]
LONGEST_END_CHECKS = 0.3  # longest time for these checks [s]
LONGEST_DRAIN = 0.5  # longest time for messages of one topic that the executor has not noticed [s]
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
    from estimator_pkg.bags.live import live  # isort: skip  prepares the environment
    from rclpy.exceptions import InvalidTopicNameException
    from rclpy.validate_full_topic_name import validate_full_topic_name

    topics = [name if name.startswith('/') else f'/{name}' for name in parsed.topics]
    for name in topics:
        try:
            validate_full_topic_name(name)
        except InvalidTopicNameException:
            raise UsageError(f"'{name}' is not a valid topic name: correct it") from None
    with interrupts.gently(background=True), BagWriter(parsed.out, keep=True) as writer:
        with live('bag_recorder') as here:
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
    lost_before: int = 0
    profiles: list[Qos] = field(default_factory=list)

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
        self._follow(duration)
        until, quiet = time.monotonic() + LONGEST_END_CHECKS, 0  # take in the waiting messages
        while quiet < QUIET_CHECKS and time.monotonic() < until:
            before = self._received
            self._here.spin(CHECK_TIME)
            self._drain()
            quiet = quiet + 1 if self._received == before else 0

    def _follow(self, duration: float | None) -> None:
        look = flush = 0.0
        printed = False
        begun = time.monotonic()
        while not self._here.stopping:
            now = time.monotonic()
            if now >= look:
                self._look()
                self._drain()
                look = now + GRAPH_PERIOD
                if not printed and now > begun + 1.0:
                    printed = True
                    self._print_missing()
            if now >= flush:
                self._writer.flush()
                flush = now + FLUSH_PERIOD
            if duration is not None:
                since = self._first_ns * 1e-9 if self._first_ns else begun + FIRST_MESSAGE_WAIT
                if time.monotonic() - since > duration:
                    return
            self._here.spin(min(GRAPH_PERIOD, duration or GRAPH_PERIOD))

    def _drain(self) -> None:
        """Receive messages that the executor has not noticed."""
        from estimator_pkg.ros.executor import take_turn

        for track in self.tracks.values():
            take_turn(track.subscription, track.receive, LONGEST_DRAIN)

    def _print_missing(self) -> None:
        missing = [name for name in self._topics if name not in self.tracks]
        if missing:
            show(f'waiting for {", ".join(missing)}', file=sys.stderr)

    def _look(self) -> None:
        """Subscribe to new topics, and adapt to publishers that offer less than before."""
        for name, types in self._here.node.get_topic_names_and_types():
            if name in self._refused or (self._topics and name not in self._topics):
                continue
            publishers = self._here.node.get_publishers_info_by_topic(name)
            if not publishers:
                continue
            from estimator_pkg.bags.live import offered

            profiles = []
            for publisher in publishers:
                profile = offered(publisher.qos_profile)
                if profile not in profiles:
                    profiles.append(profile)
            track = self.tracks.get(name)
            if track is None:
                self._start(name, types, profiles, str(publishers[0].topic_type_hash))
            elif any(profile not in track.profiles for profile in profiles):
                self._adapt(name, types[0], track, profiles)

    def _start(self, name: str, types: list[str], profiles: list[Qos], type_hash: str) -> None:
        from estimator_pkg.bags.live import matching
        from estimator_pkg.ros.message_class import message_class

        kind = message_class(types[0])
        if kind is None or len(types) > 1:
            self._refused.add(name)
            why = (
                'it has several types'
                if len(types) > 1
                else f'its type {types[0]} is not installed'
            )
            if self._topics:
                raise UserError(f'{name} cannot be recorded: {why}')
            show(f'warning: {name} is not recorded: {why}', file=sys.stderr)
            return
        self._writer.add_topic(
            name, types[0], profiles, type_hash=type_hash if type_hash.startswith('RIHS01_') else ''
        )
        qos = matching(profiles)
        self.tracks[name] = self._subscribe(name, kind, qos, profiles)
        show(f'recording {name} ({types[0]})', file=sys.stderr)

    def _adapt(self, name: str, type_name: str, track: RecordedTopic, profiles: list[Qos]) -> None:
        """Subscribe again if a new publisher does not match the present subscription."""
        from estimator_pkg.bags.live import matching
        from estimator_pkg.ros.message_class import message_class

        track.profiles += [profile for profile in profiles if profile not in track.profiles]
        qos = matching(track.profiles)
        if (qos.reliability, qos.durability) == (track.qos.reliability, track.qos.durability):
            return
        show(
            f'warning: a publisher of {name} offers less than the others: subscribing again',
            file=sys.stderr,
        )
        self._drain()
        self._here.node.destroy_subscription(track.subscription)
        again = self._subscribe(name, message_class(type_name), qos, track.profiles)
        again.lost_before = track.lost
        self.tracks[name] = again

    def _subscribe(
        self, name: str, kind: Any, qos: QoSProfile, profiles: list[Qos]
    ) -> RecordedTopic:
        from estimator_pkg.ros.loss import Loss

        holder: list[Subscription] = []
        loss = Loss(lambda: holder[0].get_publisher_count())
        write = self._writer.write

        def receive(raw: bytes, info: Any) -> None:
            loss.saw(info['publication_sequence_number'])
            now = time.time_ns()
            write(name, info['received_timestamp'] or now, raw, info['source_timestamp'] or now)
            self._received += 1
            if not self._first_ns:
                self._first_ns = time.monotonic_ns()

        def callback(*arguments: Any) -> None:
            # EventsExecutor of rclpy 7.1 passes one tuple, other executors two arguments.
            receive(*(arguments if len(arguments) == 2 else arguments[0]))

        callback.__signature__ = inspect.signature(receive)  # type: ignore[attr-defined]  # rclpy counts them
        holder.append(self._here.node.create_subscription(kind, name, callback, qos, raw=True))
        return RecordedTopic(holder[0], receive, qos, loss, profiles=list(profiles))


COMMAND = Command(
    'write topics of the live graph into a bag',
    arguments,
    run,
    examples=(
        ('/joint_states --out arm --duration 60', 'a minute of joint states'),
        ('--out everything', 'all topics, until Ctrl-C'),
    ),
)
