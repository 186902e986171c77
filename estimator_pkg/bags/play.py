# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator play``: publish a bag on the live graph, with its bytes and timing."""

from __future__ import annotations

import argparse
import math
import os
import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from estimator_pkg.bags import unpacking
from estimator_pkg.bags.reader import Bag, open_bag
from estimator_pkg.bags.source import CDR
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.printable import show


@contextmanager
def keys() -> Iterator[Callable[[], str]]:
    """Yield a function that returns the last pressed key, or ''; without a terminal always ''.

    The terminal's state is restored at the end in any case.
    """
    try:
        import termios
        import tty

        number = sys.stdin.fileno()
        # The system stops a background job that reads its terminal.
        if not os.isatty(number) or os.tcgetpgrp(number) != os.getpgrp():
            raise OSError
        before = termios.tcgetattr(number)
    except (ImportError, OSError, ValueError, AttributeError):
        yield lambda: ''
        return

    def pressed() -> str:
        if select.select([number], [], [], 0.0)[0]:
            return os.read(number, 1).decode('utf-8', 'ignore')
        return ''

    tty.setcbreak(number)
    try:
        yield pressed
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)


if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from estimator_pkg.bags.live import Live

CLOCK = '/clock'
CLOCK_RATE = 200.0  # Hz
LOOK = 0.05  # time between checks of keyboard and services [s]
QUIET = 0.5  # without a new subscription for this time, all have arrived [s]
LINGER = 0.3  # time for best-effort messages to arrive: they are lost when the process ends [s]
HANDSHAKE = 0.2  # time in which new subscriptions discover us: best effort does not wait [s]
SECOND = 1_000_000_000


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument('bag', metavar='BAG', help='rosbag2 folder, .mcap or .db3 file')
    parser.add_argument('--topics', metavar='TOPIC', nargs='+', help='play only these topics')
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
        metavar='HZ',
        type=float,
        nargs='?',
        const=CLOCK_RATE,
        help=f'publish the time of the bag on {CLOCK} (default {CLOCK_RATE:g} Hz)',
    )
    parser.add_argument(
        '--start-paused',
        action='store_true',
        help='wait for the space bar, or the service ~/resume',
    )
    parser.add_argument(
        '--remap',
        metavar='FROM:=TO',
        nargs='+',
        default=[],
        action='extend',
        help='publish topic FROM as TO',
    )
    parser.add_argument(
        '--wait',
        metavar='S',
        type=float,
        default=5.0,
        help='longest wait for subscriptions [s] (default 5; 0: start at once)',
    )
    unpacking.arguments(parser)


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Play until the end or Ctrl-C; print and return the numbers of messages."""
    for name, value, low in (('rate', parsed.rate, 0.0), ('clock', parsed.clock, 0.0)):
        if value is not None and not (math.isfinite(value) and value > low):
            raise UsageError(f'--{name} is {value:g}: it must be above {low:g}')
    if not (math.isfinite(parsed.wait) and parsed.wait >= 0.0):
        raise UsageError(f'--wait is {parsed.wait:g} s: it must be 0 or more')
    remap = dict(_remapping(text) for text in parsed.remap)
    with open_bag(parsed.bag, parsed.unpack_limit) as bag:
        for name in parsed.topics or ():
            bag.require(name)
        remap = {_meant(bag, name): target for name, target in remap.items()}
        from estimator_pkg.bags.live import live

        with live('bag_player') as here, keys() as pressed:
            player = Player(
                here,
                bag,
                pressed,
                topics=parsed.topics,
                remap=remap,
                rate=parsed.rate,
                clock=parsed.clock,
                paused=parsed.start_paused,
            )
            player.wait(parsed.wait)
            player.play()
            while parsed.loop and not here.stopping:
                player.play()
            player.finish()
    show(f'{parsed.bag}: ' + ', '.join(f'{name} {count}' for name, count in player.sent.items()))
    return {'bag': str(parsed.bag), 'sent': player.sent}


def _remapping(text: str) -> tuple[str, str]:
    source, mark, target = text.partition(':=')
    if not mark or not source or not target:
        raise UsageError(f"--remap '{text}' is not a remapping: write it as FROM:=TO")
    return source, target if target.startswith('/') else f'/{target}'


def _meant(bag: Bag, name: str) -> str:
    """Return the topic of the bag with this name, with or without its first slash."""
    return bag.require(name if name in bag.topics or name.startswith('/') else f'/{name}').name


class Player:
    """Publishes a bag.

    Parameters
    ----------
    pressed : returns the key pressed since the last call, or ''.
    topics : topics to play; None: all whose type is installed.
    remap : name in the bag -> name on the graph.
    rate : speed over that of the recording.
    clock : rate of /clock [Hz]; None: no /clock.

    Attributes
    ----------
    sent : messages published, by topic on the graph. best_effort : True if some topic is.
    """

    def __init__(
        self,
        here: Live,
        bag: Bag,
        pressed: Callable[[], str],
        *,
        topics: list[str] | None,
        remap: dict[str, str],
        rate: float,
        clock: float | None,
        paused: bool,
    ) -> None:
        from rclpy.exceptions import InvalidTopicNameException
        from rclpy.qos import ReliabilityPolicy
        from std_srvs.srv import Trigger

        from estimator_pkg.bags.live import matching
        from estimator_pkg.ros.message_class import message_class

        self._here, self._bag, self._pressed = here, bag, pressed
        self._rate = rate
        self.paused = paused
        self.sent: dict[str, int] = {}
        self.best_effort = False
        self._publishers: dict[str, tuple[str, Publisher]] = {}
        for topic in bag.topics.values():
            if (
                (topics is not None and topic.name not in topics)
                or not topic.count
                or (topic.name == CLOCK and clock)
            ):
                continue
            if topic.serialization != CDR:
                bag.warn(
                    f"{topic.name} is not played: its messages are '{topic.serialization}', "
                    'and ROS 2 needs CDR'
                )
                continue
            kind = message_class(topic.type)
            if kind is None:
                bag.warn(f'{topic.name} is not played: its type {topic.type} is not installed')
                continue
            name = remap.get(topic.name, topic.name)
            name = name if name.startswith('/') else f'/{name}'
            profile = matching(topic.qos)
            self.best_effort |= profile.reliability == ReliabilityPolicy.BEST_EFFORT
            try:
                publisher = here.node.create_publisher(kind, name, profile)
            except InvalidTopicNameException as error:
                raise UserError(
                    f"'{name}' is not a valid topic name: rename it with --remap {topic.name}:=NAME"
                ) from error
            self._publishers[topic.name] = name, publisher
            self.sent[name] = 0
        if not self._publishers:
            raise UserError(f'{bag.path} has no topic to play: it has {bag.listing()}')
        self._clock: Publisher | None = None
        self._clock_step = 0
        if clock:
            from rosgraph_msgs.msg import Clock

            self._clock = here.node.create_publisher(Clock, CLOCK, 10)
            self._clock_step = max(1, round(SECOND / clock))
        here.node.create_service(Trigger, '~/pause', lambda _, reply: self._answer(True, reply))
        here.node.create_service(Trigger, '~/resume', lambda _, reply: self._answer(False, reply))
        self._zero_ns = 0  # steady time of the bag's first message
        self._start_ns = 0  # log time of that message
        self._next_look = 0
        self._next_clock = 0

    def wait(self, seconds: float) -> None:
        """Wait up to `seconds` until every topic has a subscription, or no more appear."""
        begun = changed = time.monotonic()
        before = 0
        while not self._here.stopping and time.monotonic() < begun + seconds:
            matched = sum(
                publisher.get_subscription_count() > 0 for _, publisher in self._publishers.values()
            )
            if matched != before:
                before, changed = matched, time.monotonic()
            if matched == len(self._publishers) or (matched and time.monotonic() > changed + QUIET):
                self._here.spin(HANDSHAKE)
                return
            self._here.spin(0.02)
        if seconds and not before and not self._here.stopping:
            print(f'no subscription within {seconds:g} s: playing without', file=sys.stderr)

    def play(self) -> None:
        """Publish every message once, at its time."""
        first = True
        for message in self._bag.messages(self._publishers):
            if first:
                self._begin(message.log_ns)
                first = False
            if not self._until(message.log_ns):
                return
            name, publisher = self._publishers[message.topic]
            publisher.publish(message.raw)
            self.sent[name] += 1

    def finish(self) -> None:
        """Wait for the last messages to arrive."""
        from rclpy.duration import Duration

        for _, publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(nanoseconds=0 if self._here.stopping else SECOND))
        if not self._here.stopping and self.best_effort:
            time.sleep(LINGER)

    def _begin(self, start_ns: int) -> None:
        if self.paused:
            print('paused: the space bar or the service ~/resume starts', file=sys.stderr)
        self._start_ns = start_ns
        self._zero_ns = self._next_look = self._next_clock = time.monotonic_ns()

    def _until(self, log_ns: int) -> bool:
        """Wait until a message of this log time is due; return False if the user ended it."""
        due = self._zero_ns + round((log_ns - self._start_ns) / self._rate)
        while True:
            now = time.monotonic_ns()
            if now >= self._next_look:
                shift = self._look(now)
                if self._here.stopping:
                    return False
                due += shift
                now = time.monotonic_ns()
            if self._clock is not None and now >= self._next_clock:
                self._publish_time(now)
            if now >= due:
                return True
            until = min(due, self._next_look)
            if self._clock is not None:
                until = min(until, self._next_clock)
            if until > now:
                time.sleep((until - now) / SECOND)

    def _look(self, now: int) -> int:
        """Handle keyboard and services, wait while paused; return the added delay [ns]."""
        self._here.spin(0.0)
        self._key()
        paused_at = time.monotonic_ns()
        while self.paused and not self._here.stopping:
            self._here.spin(0.01)
            self._key()
            if self._clock is not None and time.monotonic_ns() >= self._next_clock:
                self._publish_time(paused_at)
        shift = 0
        if self.paused or time.monotonic_ns() - paused_at > SECOND // 1000:
            shift = time.monotonic_ns() - paused_at
            self._zero_ns += shift
        self._next_look = time.monotonic_ns() + round(LOOK * SECOND)
        return shift

    def _key(self) -> None:
        if self._pressed() == ' ':
            self.paused = not self.paused
            print('paused' if self.paused else 'playing', file=sys.stderr)

    def _answer(self, paused: bool, response: Any) -> Any:
        self.paused = paused
        response.success = True
        response.message = 'paused' if paused else 'playing'
        return response

    def _publish_time(self, now: int) -> None:
        """Publish the bag's time at this steady time."""
        from builtin_interfaces.msg import Time
        from rosgraph_msgs.msg import Clock

        assert self._clock is not None
        bag_ns = self._start_ns + round((now - self._zero_ns) * self._rate)
        sec, nanosec = divmod(bag_ns, SECOND)
        self._clock.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))
        behind = time.monotonic_ns() - self._next_clock
        self._next_clock += self._clock_step * (1 + max(0, behind) // self._clock_step)


COMMAND = Command(
    'publish a bag on the live graph',
    arguments,
    run,
    examples=(
        (
            'bags/dfki_double_pendulum/sys_id_500hz --clock',
            'with /clock, for nodes with use_sim_time',
        ),
        (
            'BAG --topics /joint_states --rate 0.5 --loop',
            'one topic at half speed, again and again',
        ),
    ),
)
