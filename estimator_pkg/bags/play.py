# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator play``: publish a bag on the live graph, with its bytes and timing."""

from __future__ import annotations

import argparse
import math
import sys
import time
from typing import TYPE_CHECKING, Any

from estimator_pkg.bags import unpacking
from estimator_pkg.bags.reader import CDR, Bag, open_bag
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.optional import Lazy
from estimator_pkg.printable import show
from estimator_pkg.ros.message_class import message_class

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from estimator_pkg.bags.live import Live

live = Lazy('estimator_pkg.bags.live')

CLOCK = '/clock'
CLOCK_RATE = 200.0  # Hz
SUBSCRIPTION_WAIT = 5.0  # longest wait for subscriptions [s]
MATCHING_PAUSE = 0.5  # without a new subscription for this time, all have arrived [s]
LINGER = 0.3  # time for best-effort messages to arrive: they are lost when the process ends [s]
HANDSHAKE = 0.2  # time in which new subscriptions discover us: best effort does not wait [s]
NS_PER_S = 1_000_000_000
SIGNAL_PERIOD = NS_PER_S // 20  # longest time between two checks for a signal [ns]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument('bag', metavar='BAG', help='rosbag2 folder, .mcap or .db3 file')
    parser.add_argument(
        '--rate',
        metavar='R',
        type=float,
        default=1.0,
        help='speed relative to the recording (default 1)',
    )
    parser.add_argument('--loop', action='store_true', help='start again at the end')
    parser.add_argument(
        '--clock',
        action='store_true',
        help=f'publish the time of the bag on {CLOCK} at {CLOCK_RATE:g} Hz',
    )
    unpacking.arguments(parser)


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Play until the end or Ctrl-C; print and return the numbers of messages."""
    if not (math.isfinite(parsed.rate) and parsed.rate > 0.0):
        raise UsageError(f'--rate is {parsed.rate:g}: it must be above 0')
    with open_bag(parsed.bag, parsed.unpack_limit) as bag, live.live('bag_player') as here:
        player = Player(here, bag, parsed.rate, parsed.clock)
        player.wait()
        player.play()
        while parsed.loop and not here.stopping:
            player.play()
        player.finish()
    show(f'{parsed.bag}: ' + ', '.join(f'{name} {count}' for name, count in player.sent.items()))
    return {'bag': str(parsed.bag), 'sent': player.sent}


class Player:
    """Publishes the topics of a bag whose type is installed.

    Parameters
    ----------
    rate : speed over that of the recording.
    clock : publish the time of the bag on /clock, and not its topic of that name.

    Attributes
    ----------
    sent : messages published, by topic.
    """

    def __init__(self, here: Live, bag: Bag, rate: float, clock: bool) -> None:
        from rclpy.exceptions import InvalidTopicNameException
        from rosgraph_msgs.msg import Clock

        self._here, self._bag, self._rate = here, bag, rate
        self._publishers: dict[str, Publisher] = {}
        for topic in bag.topics.values():
            if not topic.count or (topic.name == CLOCK and clock):
                continue
            kind = message_class(topic.type)
            if topic.serialization != CDR:
                why = f"its messages are '{topic.serialization}', and ROS 2 needs CDR"
            elif kind is None:
                why = f'its type {topic.type} is not installed'
            else:
                try:
                    self._publishers[topic.name] = here.node.create_publisher(
                        kind, topic.name, live.matching(topic.qos)
                    )
                    continue
                except InvalidTopicNameException:
                    why = 'its name is not valid in ROS 2'
            bag.warn(f'{topic.name} is not played: {why}')
        if not self._publishers:
            raise UserError(f'{bag.path} has no topic to play: it has {bag.listing()}')
        self.sent = dict.fromkeys(self._publishers, 0)
        self._clock = here.node.create_publisher(Clock, CLOCK, 10) if clock else None
        self._zero_ns = 0  # steady time of the bag's first message
        self._start_ns = 0  # log time of that message
        self._next_clock = 0

    def wait(self) -> None:
        """Wait until every topic has a subscription, or no more appear."""
        until, matched = time.monotonic() + SUBSCRIPTION_WAIT, 0
        while matched < len(self._publishers) and time.monotonic() < until:
            if self._here.stopping:
                return
            before, publishers = matched, self._publishers.values()
            matched = sum(each.get_subscription_count() > 0 for each in publishers)
            if matched != before:
                until = time.monotonic() + MATCHING_PAUSE
            time.sleep(0.02)
        if matched:
            time.sleep(HANDSHAKE)
        else:
            print(
                f'no subscription within {SUBSCRIPTION_WAIT:g} s: playing without', file=sys.stderr
            )

    def play(self) -> None:
        """Publish every message once, at its time."""
        self._zero_ns = 0
        for message in self._bag.messages(self._publishers):
            if not self._zero_ns:
                self._start_ns = message.log_ns
                self._zero_ns = self._next_clock = time.monotonic_ns()
            self._until(message.log_ns)
            if self._here.stopping:
                return
            self._publishers[message.topic].publish(message.raw)
            self.sent[message.topic] += 1

    def finish(self) -> None:
        """Wait for the last messages to arrive."""
        from rclpy.duration import Duration

        if not self._here.stopping:
            for publisher in self._publishers.values():
                publisher.wait_for_all_acked(Duration(seconds=1))
            time.sleep(LINGER)

    def _until(self, log_ns: int) -> None:
        """Wait until a message of this log time is due, or a signal ends the command."""
        due = self._zero_ns + round((log_ns - self._start_ns) / self._rate)
        while not self._here.stopping:
            now = time.monotonic_ns()
            until = min(due, now + SIGNAL_PERIOD)
            if self._clock is not None:
                if now >= self._next_clock:
                    self._publish_time(self._clock, now)
                until = min(until, self._next_clock)
            if now >= due:
                return
            time.sleep(max(until - now, 0) / NS_PER_S)

    def _publish_time(self, clock: Publisher, now: int) -> None:
        """Publish the bag's time at this steady time."""
        from rclpy.time import Time
        from rosgraph_msgs.msg import Clock

        bag_ns = self._start_ns + round((now - self._zero_ns) * self._rate)
        clock.publish(Clock(clock=Time(nanoseconds=bag_ns).to_msg()))
        self._next_clock = max(self._next_clock + round(NS_PER_S / CLOCK_RATE), now)


COMMAND = Command(
    'publish a bag on the live graph',
    arguments,
    run,
    examples=(
        (
            'bags/dfki_double_pendulum/sys_id_500hz --clock',
            'with /clock, for nodes with use_sim_time',
        ),
        ('BAG --rate 0.5 --loop', 'at half speed, again and again'),
    ),
)
