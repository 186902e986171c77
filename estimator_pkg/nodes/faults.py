# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What keeps a node from estimating, or makes its estimates doubtful: the table of faults.

A fault is reported in three ways: once on the terminal when it begins, and while it lasts in
``~/status`` and in ``/diagnostics``. `estimator_pkg.nodes.detection.Detector` finds them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

SHOWN = 5.0  # time for which an event stays among the faults [s]
AGAIN = 2.0  # a fault that returns after this time is logged again [s]
NAMED = 5  # largest number of names in a text

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Fault:
    """A row of the table.

    Attributes
    ----------
    name : of the row, and of the detector's method that finds the fault unless `find` names it.
    cause : the fault, as the documentation lists it.
    text, remedy : of the report, with places for values.
    unless : rows before this one that explain it.
    confirmed : it is reported when two reports in a row find it.
    harmless : it does not explain why nothing is estimated. event : it is over when it is found.
    """

    name: str
    cause: str
    text: str
    remedy: str = '{why}'
    find: str = ''
    unless: tuple[str, ...] = ()
    confirmed: bool = False
    harmless: bool = False
    event: bool = False

    def report(self, values: Values) -> str:
        """Return what the user reads."""
        return f'{self.text}: {self.remedy}'.format_map(values)


# A row can explain those after it.
FAULTS = (
    Fault(
        'nobody',
        'nobody publishes the topic',
        'nobody publishes {topic} ({type})',
        "start its publisher, or remap the input with '-r {port}:=TOPIC'{hint}",
        find='graph',
        confirmed=True,
    ),
    Fault(
        'type',
        'it has another type',
        '{who} publishes {other} on {topic}, where this node needs {type}',
        'they are not connected; remap one of them',
        find='graph',
        confirmed=True,
    ),
    Fault(
        'qos',
        'it has an incompatible QoS',
        'a {role} on {topic} has an incompatible QoS and is not connected: {who} ({reason})',
        "change it there, or set the parameters 'qos_overrides.{topic}.{own}'",
        find='graph',
        confirmed=True,
    ),
    Fault(
        'mute',
        'its publisher sends nothing',
        '{who} publishes {topic}, but no message has arrived',
        'check that it runs and is not paused',
        confirmed=True,
    ),
    Fault(
        'shared',
        'another node publishes on its output (the same node, started twice)',
        '{who} publishes {topic} as this node does, so its subscribers get both',
        "stop one of them, remap the topic, or start it with another name ('-r __node:=NAME')",
        find='graph',
        confirmed=True,
        harmless=True,
    ),
    Fault(
        'missing',
        'a joint that the messages do not carry',
        '{topic} does not carry {names}',
        "{meant}correct {named} or 'per_joint' (it carries {carried})",
    ),
    Fault(
        'twice',
        'two publishers of the same joint',
        '{who} send {names} on {topic}, and the estimates mix their samples',
        'stop one of them, or remap its topic',
        harmless=True,
    ),
    Fault(
        'silent',
        'its messages, or those with a joint, end',
        'no {what} on {topic} for {passed:.1f} s',
        harmless=True,
    ),
    Fault(
        'sensor',
        'readings that no joint can make',
        "the sensor of '{name}' on {topic} may be faulty",
        '{what}; check sensor, cable and bus; an angle in degrees needs counts_per_revolution=360 '
        '(input angle or field)',
        harmless=True,
    ),
    Fault(
        'malformed',
        'messages that are cut off, or have another layout',
        '{count} of {received} messages are malformed and dropped, the last one on {topic}',
    ),
    Fault(
        'unused',
        'messages without positions, efforts or rows',
        '{count} of {received} messages on {topic} {what}',
        '{remedy}',
    ),
    Fault(
        'mismatched',
        'arrays of different lengths in a message',
        '{count} of {received} messages on {topic} are dropped',
        unless=('missing',),
    ),
    Fault(
        'refused',
        'more joints than `joints_max`',
        '{count} of {received} samples on {topic} are beyond joints_max and are dropped (newest '
        "name: '{name}'; {joints} joints exist)",
        "name the required joints in 'joints', or raise 'joints_max'",
    ),
    Fault(
        'lost',
        'messages that are lost for several seconds',
        '{count} of {received} messages on {topic} were lost in {passed:.0f} s',
        'their rate is too high for this node or the network; lower it, or stop other processes',
        harmless=True,
    ),
    Fault(
        'zero_stamp',
        'stamps that are zero',
        '{count} of {received} samples on {topic} have no time stamp and are dropped',
    ),
    Fault(
        'no_clock',
        '`use_sim_time` without a clock',
        'use_sim_time is true, but nobody publishes /clock',
        "start the simulation, play the bag with '--clock', or unset use_sim_time",
        harmless=True,
    ),
    Fault(
        'clock',
        'stamps of another clock',
        "stamps on {topic} are {offset:+.1f} s from this node's clock ({clock})",
        'check the clock of its publisher{other}',
        unless=('no_clock', 'twice'),
        harmless=True,
    ),
    Fault(
        'duplicate',
        'stamps that repeat',
        '{count} of {received} samples on {topic} repeat the previous stamp and are dropped',
        'stamp each measurement once, and name each joint once in a message{other}',
        find='dropped',
        unless=('twice',),
        confirmed=True,
    ),
    Fault(
        'late',
        'stamps that go back',
        '{count} of {received} samples on {topic} are older than the previous one and are dropped',
        'publish them in the order of their stamps{other}',
        find='dropped',
        unless=('twice',),
        confirmed=True,
    ),
    Fault(
        'repeated',
        'readings that repeat',
        '{count} of {received} samples on {topic} repeat the previous reading and are dropped',
        'publish each reading once; the sensor is slower than its driver',
        find='dropped',
        unless=('twice',),
        confirmed=True,
    ),
    Fault(
        'jump',
        'the clock of the stamps jumps',
        'the clock of the measurements jumped, and all {kept}s are reset',
        'a looping bag, a restarted simulation, or publishers whose clocks differ',
        unless=('twice',),
        harmless=True,
        event=True,
    ),
    Fault(
        'failed',
        'an observer or model that raises an error',
        'the observer failed on a message of {topic}, and all {kept}s are reset',
        event=True,
    ),
    Fault('unusable', 'samples that are all dropped', '{names}', event=True),
    Fault(
        'expired',
        'a joint that has not come for `expiry`',
        '{names} removed',
        'no sample for {expiry:g} s (expiry)',
        harmless=True,
        event=True,
    ),
    Fault(
        'nothing',
        'no estimate for another reason',
        'no estimate for {passed:.0f} s, though messages come on {topic}',
    ),
)
HARMLESS = {fault.name for fault in FAULTS if fault.harmless}


class Faults:
    """The present faults of a node; each is logged once, when it begins.

    Parameters
    ----------
    log : logs the report of a row.

    Attributes
    ----------
    present : reports of the present faults, by kind: the row's name and what distinguishes several.
    """

    def __init__(self, log: Callable[[Fault, str], None]) -> None:
        self._log = log
        self.present: dict[str, str] = {}
        self._shown: dict[str, tuple[str, float]] = {}  # report, and until when it is present

    def update(self, found: Mapping[str, tuple[Fault, str]], now: float) -> None:
        """Take the faults that are found now, by kind."""
        for kind, (fault, report) in found.items():
            if now - self._shown.get(kind, ('', -math.inf))[1] > AGAIN:
                self._log(fault, report)
            self._shown[kind] = report, now + (SHOWN if fault.event else 0.0)
        self._shown = {kind: each for kind, each in self._shown.items() if now - each[1] <= AGAIN}
        self.present = {kind: text for kind, (text, until) in self._shown.items() if until >= now}


def listed(names: Iterable[str], quote: str = '') -> str:
    """Return names for a text: 'a, b and 3 more'."""
    names = list(names)
    more = f' and {len(names) - NAMED} more' if len(names) > NAMED else ''
    return ', '.join(f'{quote}{name}{quote}' for name in names[:NAMED]) + more


def called(names: Iterable[str], kept: str = 'joint') -> str:
    """Return joints for a text: "joint 'a'", or "7 joints ('a', 'b', 'c', 'd', 'e' and 2 more)"."""
    names = list(names)
    return (
        f"{kept} '{names[0]}'"
        if len(names) == 1
        else f'{len(names)} {kept}s ({listed(names, chr(39))})'
    )
