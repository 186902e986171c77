# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Detect repeated readings: a sensor slower than the driver that publishes it.

A driver that publishes at 1 kHz the readings of a 100 Hz sensor repeats each reading nine times. An
observer that treats the repeated ones as measurements sees a joint that stops and jumps. So
`advance` of `estimator_pkg.driver.channel` drops them, once the pattern is recognised.

The evidence is a hold: an unchanged reading while the joint moves. An encoder at creep repeats its
reading as regularly, but then each change is one count, whatever the speed, and the length of the
holds depends on the speed. With repeated readings the changes depend on the speed and the holds do
not. So holds are collected in chains of equal length and spacing. A hold counts if the change into
it is several times the second smallest change in its chain (a single one may be part of a count,
where a sensor clips), has the same sign as the previous change, and leads to another reading. Noise
gives equal readings at random, which form no chains. At constant speed there is another criterion:
a chain whose holds all have exactly the same spacing while their changes differ. For creep to look
like this, it would need exactly a rational fraction of a count per sample and coarsely rounded
readings.
"""

from __future__ import annotations

import math

from estimator_pkg.circle import wrap
from estimator_pkg.record import record

SCORE = 12  # a chain is accepted at this many holds of one sample, half as many longer ones
EVEN_HOLDS = 50  # or at this many holds with exactly the same spacing,
DIFFERENCES = 10  # if this many of their changes differ
MOTION_RATIO = 3.0  # a change above this multiple of the second smallest is motion, not one count
DIFFERENT = 0.002  # two changes differ if their relative difference is larger than this
LEAST_CHANGE = 1e-10  # smaller changes are rounding [rad or m],
LEAST_RELATIVE_CHANGE = 3e-7  # or smaller than this fraction of the reading (float32)
SLIP = 1.25  # allowed difference of the spacing within a chain [samples],
SPACING_SLACK = 0.2  # or this fraction of it
LONGEST_SPACING = 16.0  # holds of one sample further apart form no chain [samples]
BREAKS = 3  # this many changes in a row without a hold end the recognition


@record
class Repeats:
    """A pattern of repeated readings, or the chain of holds that may become one."""

    most: int  # equal readings in a row that are dropped; 0: no pattern is recognised
    length: int  # equal readings since the last change, or since the last sample used
    hold_ns: int  # stamp of the newest hold
    spacing_ns: int  # from the hold before it
    change: float  # the change into it [rad]
    value: float  # its reading [rad]
    least: float  # smallest change of the chain [rad]
    second: float  # second smallest change of the chain [rad]
    score: int  # holds that count
    alone: bool  # in a pattern: the newest reading is of a joint at rest
    alike: int  # holds in a row whose spacing was exactly the same
    differences: int  # how many of their changes differed
    longest: int  # length of the longest hold
    changes: int  # changes in a row without a hold
    patience: int  # this many end the recognition
    message_period: float  # sample time of the messages [ns]


def is_repeated(
    repeats: Repeats,
    stamp_ns: int,
    passed_ns: int,
    measurement: float,
    reading: float,
    earlier: float,
    mean_dt: float,
    period: float,
) -> bool:
    """Return True if the measurement is a repeated reading, which is dropped.

    Called where it equals the reading before, or where a pattern is recognised.

    Parameters
    ----------
    passed_ns : time since the last used sample.
    measurement, reading, earlier : the newest three readings, the newest first [rad or m].
    mean_dt : mean sample time [s].
    period : wrap period [rad]; 0: none.
    """
    if repeats.most > 0:
        if measurement == reading:
            repeats.length += 1
            drop = repeats.length <= repeats.most
            # one more than the pattern has means that the joint is at rest: a new reading
            repeats.length = repeats.length if drop else 0
            repeats.alone = not drop
            repeats.changes = 0
            return drop
        change_in_pattern(repeats, passed_ns, wrap(measurement - reading, period))
        return False
    if reading != earlier:
        follow_hold(repeats, stamp_ns, reading, earlier, mean_dt, period)
        return repeats.most > 0
    if repeats.length == 1:
        repeats.length = 2
    return False


def follow_hold(
    repeats: Repeats, stamp_ns: int, reading: float, earlier: float, mean_dt: float, period: float
) -> None:
    """Take a reading that is repeated and had changed, without a pattern so far.

    Parameters
    ----------
    stamp_ns : stamp of the repeated reading.
    reading, earlier : the repeated reading, and the one before it [rad or m].
    """
    change = wrap(reading - earlier, period)
    last, value, length = repeats.change, repeats.value, repeats.length
    size, pace = abs(change), 1e9 * mean_dt
    spacing_ns = stamp_ns - repeats.hold_ns
    slip = abs(spacing_ns - repeats.spacing_ns)
    follows = earlier == value  # one change since the last hold
    regular = float(slip) <= max(SLIP * pace, SPACING_SLACK * spacing_ns) and (
        follows or (length == 1 and float(spacing_ns) < LONGEST_SPACING * pace)
    )
    rounding = LEAST_CHANGE + LEAST_RELATIVE_CHANGE * (abs(reading) + abs(earlier))
    repeats.length = 1
    repeats.hold_ns = stamp_ns
    repeats.spacing_ns = spacing_ns
    repeats.change = change
    repeats.value = reading
    if not regular or size <= rounding:
        repeats.least, repeats.second = size, math.inf
        repeats.score = repeats.alike = repeats.differences = repeats.longest = 0
        return
    held = int(spacing_ns / pace + 0.5) - 1 if follows else 1
    repeats.longest = max(repeats.longest, max(held, 1))
    if size < repeats.least:
        repeats.second = repeats.least
        repeats.least = size
    elif size < repeats.second:
        repeats.second = size
    repeats.alike += 1
    if float(slip) > 0.5 * pace:
        repeats.alike = repeats.differences = 0
    if change * last > 0.0 and reading != value:
        if size >= MOTION_RATIO * repeats.second:
            repeats.score += 1 if held == 1 else 2
        if abs(change - last) > DIFFERENT * size + rounding:
            repeats.differences += 1
    if repeats.score < SCORE and (repeats.alike < EVEN_HOLDS or repeats.differences < DIFFERENCES):
        return
    repeats.most = repeats.longest
    repeats.patience = BREAKS if follows else BREAKS + 2 * int(spacing_ns / pace + 0.5)
    repeats.message_period = pace
    repeats.alone = False
    repeats.score = repeats.alike = repeats.differences = repeats.longest = repeats.changes = 0


def change_in_pattern(repeats: Repeats, passed_ns: int, change: float) -> None:
    """Take a reading that changed in a pattern; too many without a hold end the recognition.

    Parameters
    ----------
    passed_ns : time since the last used sample.
    change : change of the reading [rad or m].
    """
    repeats.changes = (
        repeats.changes + 1
        if repeats.length == 0 and float(passed_ns) < 1.5 * repeats.message_period
        else 0
    )
    if repeats.changes >= repeats.patience:
        blank = Repeats()
        repeats.take(blank)
        return
    if (
        repeats.alone
        and repeats.length == 0
        and change * repeats.change > 0.0
        and abs(change) >= MOTION_RATIO * repeats.second
        and abs(repeats.change) >= 0.5 * abs(change)
    ):
        repeats.most += 1  # what was taken for a reading at rest was in the midst of the motion
    repeats.alone = False
    repeats.length = 0
    repeats.change = change


def note_on_repeats(times: int) -> str:
    """Return a note for the status on readings repeated so often in a row; '' for 0."""
    if times == 0:
        return ''
    return (
        f'the stream repeats its readings (up to {times} times each): the repeated ones are dropped'
    )
