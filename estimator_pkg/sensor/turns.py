# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Whether a sensor counts turns, so that no change of its reading need be wrapped.

`wrap_period` is the angle after which a reading may repeat. On a circle, a change beyond half a
turn in one sample is ambiguous, and one beyond an eighth is doubtful. The readings of a sensor that
wraps never span more than a turn. If they do, the sensor counts turns, and the joint goes on
without a circle. If its counter begins anew (the reading jumps by whole turns), with one again.

Angles are in rad, stamps in ns. Only the samples decide, and those that are dropped count, too.
"""

from __future__ import annotations

import math

from estimator_pkg.circle import is_angle, wrap
from estimator_pkg.record import record

SPAN = 1.25  # turns that readings which wrap never span, noise included
CONFIRMED_TURNS = 8  # readings in a row beyond it: no outliers
NEAR_WHOLE = 0.125  # of a turn, from whole turns: a jump by so much is none of the shaft


@record
class Turns:
    """What the readings have shown so far."""

    period: float  # [rad]
    usual: bool  # a reading between `low` and `high` shows nothing new
    low: float  # lowest and highest reading [rad]
    high: float
    beyond: int  # newest readings in a row that would make the span too large
    counts: bool  # the sensor counts turns
    stamp_ns: int  # newest sample, where it counts turns
    reading: float  # [rad]
    rate: float  # how fast it came [rad/ns]


def begin_turns(turns: Turns, period: float) -> None:
    """Set what is known before the first sample; period 0: nothing will be looked for."""
    turns.period = period
    turns.usual = True
    turns.low = math.inf if period > 0.0 else -math.inf
    turns.high = -turns.low
    turns.beyond = turns.stamp_ns = 0
    turns.counts = False
    turns.reading = turns.rate = math.nan


def is_news(turns: Turns, reading: float) -> bool:
    """Return True if `follow_turns` has to see this reading [rad]."""
    return not (turns.usual and turns.low <= reading <= turns.high)


def follow_turns(turns: Turns, stamp_ns: int, reading: float) -> bool:
    """Take a sample that its observer has not taken yet; return True if `counts` changes."""
    if not is_angle(reading):  # the guard drops it
        return False
    if turns.counts:
        return counter_restarted(turns, stamp_ns, reading)
    low, high = min(turns.low, reading), max(turns.high, reading)
    if high - low <= SPAN * turns.period:
        turns.low, turns.high, turns.beyond, turns.usual = low, high, 0, True
        return False
    turns.usual = False
    turns.beyond += 1
    turns.stamp_ns, turns.reading = stamp_ns, reading
    turns.counts = turns.beyond == CONFIRMED_TURNS
    return turns.counts


def counter_restarted(turns: Turns, stamp_ns: int, reading: float) -> bool:
    """Return True if a counter of turns jumped by whole turns: from now on the sensor wraps."""
    passed, moved = stamp_ns - turns.stamp_ns, reading - turns.reading
    rate = turns.rate
    turns.stamp_ns, turns.reading = stamp_ns, reading
    if passed <= 0:
        turns.rate = math.nan
        return False
    turns.rate = moved / passed
    off, half = moved - rate * passed, 0.5 * turns.period  # from where it was going
    if (
        min(abs(off), abs(moved)) > half
        and abs(wrap(off, turns.period)) < NEAR_WHOLE * turns.period
    ):
        begin_turns(turns, 0.0)
        return True
    return False
