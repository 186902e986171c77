# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Readings that did not change: the joint stands, the sensor was not read, or it is stuck.

A driver that publishes at 1 kHz the readings of a 100 Hz sensor repeats each reading nine times,
and one that reads its sensor over a bus repeats it for as long as that takes. An observer that
takes the repeated ones for measurements sees a joint that stops and jumps. So `advance` of
`estimator_pkg.driver.channel` drops them, once holds are recognised.

A hold is an unchanged reading while the joint moves. An encoder at creep repeats its reading, too,
but then each change is one count, whatever the speed. What ends a hold is a *leap*: a single change
of several counts between two holds, in the direction of the one before, and not of its size. A few
of them show that the sensor is held, at regular times or not. Noise gives equal readings at random,
which form no chain. Single repeated readings need a longer chain, of equal spacing; at constant
speed one whose holds all have exactly the same spacing while their changes differ. For creep to
look like this, it would need exactly a rational fraction of a count per sample and coarsely rounded
readings.

Until it is known, no speed is published that is above the leap over the time since the reading
before it, and the deviation covers it; nor is a speed certain that the unchanged reading does not
show. Where a steady motion stops and `MISSING` counts do not come, the rest is named: a stop, or a
stuck sensor.
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
LARGEST_READING = 1e3  # [rad or m] but of no more than this
SLIP = 1.25  # allowed difference of the spacing within a chain [samples],
SPACING_SLACK = 0.2  # or this fraction of it
LONGEST_SPACING = 16.0  # holds of one sample further apart form no chain [samples]
BREAKS = 3  # this many changes in a row without a hold end the recognition
HELD = 2  # unchanged readings: it was held, or the joint stands
LEAP = 2.0  # counts in one sample, between two holds: no counter moves like this,
LEAPS = 4  # and as many are enough,
ALONE = 4  # or three if the holds are equally long
FAST = 5.0  # counts: more than noise that repeats at every second sample,
QUICK = 3  # and a fourth is enough
MISSING = 10.0  # counts: a steady motion without these has stopped, or the sensor is stuck;
STEADY = 16  # it is steady after as many changes in one direction,
SLOWER = 1.2  # if the last counts took at most this many times as long as before,
SLOWEST = 4.0  # and no longer than this [samples a count]
RESIDUE = 1e3  # times the smallest change: that was none
FORGETS = 1.02  # from one leap to the next: the smallest change may be a stray reading's
SAME = 0.99  # two changes of a count are alike but for this
LONGER = 2.0  # times the longest hold of a chain: irregular ones may be as long


@record
class Holds:
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
    leaps: int  # changes between two holds that no counter makes
    longest_leap: int  # unchanged readings before one of them, at most
    changed_ns: int  # stamp of the newest change; 0: none is known
    unchanged: int  # readings since then
    grain: float  # smallest change so far [rad]; 0: none
    counts: bool  # two changes were alike
    leap: float  # what the reading may have moved at once after a hold [rad]; else 0
    held: float  # in this time, at least [s]
    sense: float  # the newest change [rad]
    steady: int  # changes of this sense in a row
    count_time: float  # mean time of the newest counts [samples],
    mean_count_time: float  # and of more of them
    missing: bool  # at the newest reading `MISSING` counts have not come
    joined: bool  # it came at once after another: the joint moves, and this is no leap
    apart: bool  # so was the change before: the joint does not start here


def is_repeated(
    holds: Holds,
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
    if holds.most > 0:
        if measurement == reading:
            holds.length += 1
            drop = holds.length <= holds.most
            # one more than the pattern has means that the joint is at rest: a new reading
            holds.length = holds.length if drop else 0
            holds.alone = not drop
            holds.changes = 0
            return drop
        change_in_pattern(holds, passed_ns, wrap(measurement - reading, period))
        return False
    if reading != earlier:
        follow_hold(holds, stamp_ns, reading, earlier, mean_dt, period)
        return holds.most > 0
    if holds.length == 1:
        holds.length = 2
    return False


def begin_holds(holds: Holds) -> None:
    """Forget the pattern; what is known of the counts stays."""
    changed_ns, grain = holds.changed_ns, holds.grain
    blank = Holds()
    holds.take(blank)
    holds.changed_ns, holds.grain = changed_ns, grain


def note_reading(
    holds: Holds, stamp_ns: int, change: float, pace: float, size: float, quantum: float
) -> None:
    """Take a reading that is used, and find whether the joint moves on or was held.

    Parameters
    ----------
    change : of the reading [rad or m]. pace : mean sample time [s].
    size : of the reading [rad or m]. quantum : as given [rad or m]; 0: not known.
    """
    moved, grain = abs(change), holds.grain
    if moved <= LEAST_CHANGE + LEAST_RELATIVE_CHANGE * min(size, LARGEST_READING):
        holds.unchanged += 1
        holds.missing = (
            holds.unchanged == int(MISSING * holds.count_time) + 1
            and holds.counts
            and holds.steady >= STEADY
            and holds.count_time < min(SLOWER * holds.mean_count_time, SLOWEST)
        )
        return
    stands = holds.unchanged >= HELD
    if grain == 0.0:
        holds.grain = quantum if quantum > 0.0 else moved
    elif moved < SAME * grain:
        holds.grain, holds.counts, holds.steady = moved, False, 0
    elif SAME * moved <= grain:
        holds.counts = True
    elif stands:
        # a stray reading may have shown it, or residue of rounding
        holds.grain = moved if moved > RESIDUE * grain else min(FORGETS * grain, moved)
    follow_count_time(holds, moved if change > 0.0 else -moved)
    holds.held = (stamp_ns - holds.changed_ns) * 1e-9 - pace  # at any time within a sample
    holds.apart = stands and holds.leap > 0.0
    holds.leap = 0.0
    if stands and not holds.joined and (not holds.counts or moved >= LEAP * grain):
        holds.leap = moved
    holds.joined = not stands
    holds.changed_ns, holds.unchanged, holds.missing = stamp_ns, 0, False


def follow_count_time(holds: Holds, change: float) -> None:
    """Follow how many samples a count takes, where the reading changed [rad or m]."""
    samples = float(holds.unchanged + 1) * holds.grain / abs(change)
    if change * holds.sense <= 0.0:
        holds.steady = 0
    holds.sense = change
    holds.steady = min(holds.steady + 1, STEADY)
    holds.count_time += (samples - holds.count_time) / min(holds.steady, 4)
    holds.mean_count_time += (samples - holds.mean_count_time) / min(holds.steady, 8)


def most_speed(holds: Holds, stamp_ns: int) -> float:
    """Return the largest speed that the readings show since a leap [rad/s or m/s]; inf: any."""
    if holds.leap == 0.0 or not (holds.apart or holds.unchanged > 0):
        return math.inf
    hold = max((stamp_ns - holds.changed_ns) * 1e-9, holds.held)
    return holds.leap / hold if hold > 0.0 else math.inf


def shown_speed(holds: Holds, stamp_ns: int, velocity: float) -> float:
    """Return a velocity [rad/s or m/s] within what the readings show since a leap."""
    most = most_speed(holds, stamp_ns)
    return most if velocity > most else -most if velocity < -most else velocity


def unshown_speed(holds: Holds, stamp_ns: int, velocity: float) -> float:
    """Return the part of a published velocity that no reading shows [rad/s]: a deviation covers it.

    A joint at this speed would have changed the reading by now, or came to it at once after a hold.
    """
    most = most_speed(holds, stamp_ns)
    if most < math.inf:
        return most
    if holds.unchanged == 0:
        return 0.0
    return abs(velocity) - LEAP * holds.grain / ((stamp_ns - holds.changed_ns) * 1e-9)


def follow_hold(
    holds: Holds, stamp_ns: int, reading: float, earlier: float, mean_dt: float, period: float
) -> None:
    """Take a reading that is repeated and had changed, without a pattern so far.

    Parameters
    ----------
    stamp_ns : stamp of the repeated reading.
    reading, earlier : the repeated reading, and the one before it [rad or m].
    """
    change = wrap(reading - earlier, period)
    last, value, length = holds.change, holds.value, holds.length
    size, pace = abs(change), 1e9 * mean_dt
    spacing_ns = stamp_ns - holds.hold_ns
    slip = abs(spacing_ns - holds.spacing_ns)
    follows = earlier == value  # one change since the last hold
    even = float(slip) <= max(SLIP * pace, SPACING_SLACK * spacing_ns)
    # a single change between two holds that are no chance
    alone = follows and float(min(spacing_ns, holds.spacing_ns)) > (HELD + 0.5) * pace
    regular = even and (follows or (length == 1 and float(spacing_ns) < LONGEST_SPACING * pace))
    rounding = LEAST_CHANGE + LEAST_RELATIVE_CHANGE * (abs(reading) + abs(earlier))
    holds.length = 1
    holds.hold_ns = stamp_ns
    holds.spacing_ns = spacing_ns
    holds.change = change
    holds.value = reading
    forward = change * last > 0.0 and reading != value
    differs = abs(change - last) > DIFFERENT * size + rounding
    leaps = alone and differs and size >= LEAP * holds.grain
    if leaps and forward:
        holds.leaps += 1
        holds.longest_leap = max(holds.longest_leap, int(spacing_ns / pace + 0.5) - 1)
    else:
        holds.leaps = holds.longest_leap = 0
        if alone and holds.counts:
            holds.score = 0
    if holds.leaps >= LEAPS and not even:
        recognise(holds, int(LONGER * holds.longest_leap), BREAKS, pace)
        return
    if not regular or size <= rounding:
        holds.least, holds.second = size, math.inf
        holds.score = holds.alike = holds.differences = holds.longest = 0
        return
    held = int(spacing_ns / pace + 0.5) - 1 if follows else 1
    holds.longest = max(holds.longest, max(held, 1))
    if size < holds.least:
        holds.second = holds.least
        holds.least = size
    elif size < holds.second:
        holds.second = size
    holds.alike += 1
    if float(slip) > 0.5 * pace:
        holds.alike = holds.differences = 0
    if forward:
        if leaps:
            holds.score += ALONE
        elif follows and differs and size >= FAST * holds.grain:
            holds.score += QUICK
        elif size >= MOTION_RATIO * holds.second:
            holds.score += 1 if held == 1 else 2
        if differs:
            holds.differences += 1
    if holds.score >= SCORE or (holds.alike >= EVEN_HOLDS and holds.differences >= DIFFERENCES):
        patience = BREAKS if follows else BREAKS + 2 * int(spacing_ns / pace + 0.5)
        recognise(holds, holds.longest, patience, pace)


def recognise(holds: Holds, most: int, patience: int, pace: float) -> None:
    """Drop up to `most` equal readings in a row from now on; pace of the messages [ns]."""
    holds.most, holds.patience, holds.message_period = most, patience, pace
    holds.alone = False
    holds.score = holds.alike = holds.differences = holds.longest = holds.changes = 0
    holds.leaps = holds.longest_leap = 0


def change_in_pattern(holds: Holds, passed_ns: int, change: float) -> None:
    """Take a reading that changed in a pattern; too many without a hold end the recognition.

    Parameters
    ----------
    passed_ns : time since the last used sample.
    change : change of the reading [rad or m].
    """
    holds.changes = (
        holds.changes + 1
        if holds.length == 0 and float(passed_ns) < 1.5 * holds.message_period
        else 0
    )
    if holds.changes >= holds.patience:
        begin_holds(holds)
        return
    if (
        holds.alone
        and holds.length == 0
        and change * holds.change > 0.0
        and abs(change) >= MOTION_RATIO * holds.second
        and abs(holds.change) >= 0.5 * abs(change)
    ):
        holds.most += 1  # what was taken for a reading at rest was in the midst of the motion
    holds.alone = False
    holds.length = 0
    holds.change = change


def note_on_repeats(times: int, period: float) -> str:
    """Return a note for the status on readings repeated so often in a row; '' for 0.

    Parameters
    ----------
    period : between new readings [s].
    """
    if times == 0:
        return ''
    return (
        f'the stream repeats its readings (up to {times} times each): the repeated ones are '
        f'dropped, {1.0 / period:.3g} a second are new'
    )
