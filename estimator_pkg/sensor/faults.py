# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of an encoder that its readings alone show: readings that no joint can make.

A step (change from one reading to the next [rad or m]) that differs from the mean step by more than
steps did so far begins a suspicion. The readings after it are compared with the line of the motion
before. If the joint goes on at its speed, a reading was wrong; if it goes on at another speed, a
force acted: an impact, a strike, a gripper that closes. Readings that stop are those of a stop or
of a stuck sensor, and mostly nobody can know until they move again. Until it is decided the
deviation covers both.

Most readings cost two comparisons. `examine_step` is called for an unusual step, after a start,
during a suspicion, and for a window of readings a second, in which the bits of the counter are
examined.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import wrap
from estimator_pkg.estimate import Deviation
from estimator_pkg.record import record
from estimator_pkg.sensor.clock import Clock
from estimator_pkg.sensor.holds import Holds

NO_FAULT = -1
STOPPED, STUCK_AT, HELD_AT, LOST_WAY, OFFSET_JUMP, GLITCH, REVERSED, TOGGLE, STUCK_BIT = range(9)
KINDS = (  # name, text with (size, speed before, reading)
    ('stopped', 'the readings stopped at {1:.3g} rad/s within a sample: a stop, or a stuck sensor'),
    ('stuck', 'the reading is stuck within a count of {2:.6g} rad since it moved at {1:.3g} rad/s'),
    ('held', 'the reading was held for {0:.0f} samples at {1:.3g} rad/s, and jumped on'),
    ('lost', 'a way of {0:.3g} rad was not counted at {1:.3g} rad/s'),
    ('jump', 'the reading jumped by {0:.3g} rad at {1:.3g} rad/s before and after'),
    ('glitch', 'a reading of {2:.6g} rad was {0:.3g} rad off the motion before and after it'),
    ('reversed', 'the direction reversed within a sample at {1:.3g} rad/s, and the speed stayed'),
    ('toggle', 'the reading alternates by a count ({0:.3g} rad)'),
    ('bit', 'bit {0:.0f} of the counter is stuck: the joint passed it at {1:.3g} rad/s'),
)
LASTING = (REVERSED, TOGGLE, STUCK_BIT)  # the counter is wrong until it is repaired
SHOWN_NS = 5_000_000_000  # time for which a fault stays in the status [ns],
LASTING_NS = 60_000_000_000  # and one of LASTING [ns]

PAUSE_NS = 300_000_000  # time without a look after an irregular sample time [ns]
REARMED_AFTER = 8  # readings before a suspicion after it
SLOPE_WEIGHT = 0.25  # of the newest step in the mean
STEP_ROUNDING = 1e-6  # of a step: rounding
ROUNDED_STEP = 1e-4  # [rad or m] smaller steps are compared with it
QUANTISED = 1.05  # grains by which a uniform motion's step differs from their mean
BIT_WINDOW = 32  # readings in which each passed bit changes; before the first suspicion, too
TOGGLES = 128  # readings that show a count on every second one
SOON_NS = 900_000_000  # time from one window to the end of the next [ns]
SETTLED_WINDOWS = 4  # before a bit is judged: the counter is known
FORGETTING = 2.5e-4  # [s] over the sample time: part of the deviation that a window forgets,
MOST_FORGOTTEN = 0.25  # but no more
MOST_COUNTS = 1e6
RESUMED_AFTER = 3  # steps in a row that show how the joint goes on
LONGEST_SUSPICION = 12  # readings after which a suspicion ends
WRONG_AFTER = 8  # equal or reversed readings away from the motion: the sensor is wrong
STUCK_CHANCE = 0.05  # a stop looks like a stuck sensor less often than this, or it is not reported
SHORTEST_REST = 0.05  # equal readings for this time are judged [s]
LONGEST_STOP = 10.0  # time for which a stop may be a stuck sensor [s]
INFLATED_AFTER = BIT_WINDOW  # readings after a fault in which an observer may follow what was wrong
ABSURD = 2.5e4  # no joint accelerates and brakes like this [rad/s^2 or m/s^2]


@record
class EncoderFaults:
    """What the readings of one joint have shown."""

    last: float  # newest reading [rad or m]
    slope: float  # mean step; in a suspicion: before it
    usual: float  # a larger difference of a step is looked at; negative: each reading is
    due_ns: int  # stamp of the next window
    warm: int  # readings before a suspicion may begin
    step: float  # newest step that was looked at
    dt: float  # mean sample time [s]
    now_ns: int  # newest stamp that was looked at
    grain: float  # smallest step, or change of a step
    tolerance: float  # largest difference of a step from the mean, beyond that of counting
    doubted: bool  # the joint may still move as before
    inflated: int  # readings for which the deviation covers the motion before
    age: int  # readings of the suspicion; 0: none
    offset: float  # distance from the line of the motion before,
    first_offset: float  # and the first, where it moves
    moved_reading: float  # the reading there
    soft: int  # readings on the way from there to the line
    worst: float  # largest change of a step in it
    resting: int  # readings from its beginning that rest
    decided: bool  # the rest is reported already
    resumed_steps: int  # newest steps in a row as before it,
    reversed_steps: int  # that go backwards,
    steady_steps: int  # that are alike,
    zero_steps: int  # and zero
    moving_steps: int  # steps that are not
    unusual: bool  # a step was, since the last window
    window: int  # readings of the window so far; 0: none
    settled: int  # windows since the grain is as now
    code: int  # newest reading in grains
    changed: int  # bits of it that changed in this window,
    bits_seen: int  # and in the windows before
    travelled: float  # sum of the ordinary steps of the window
    turned: bool  # one of its steps went back
    entered: float  # mean step at its begin
    moves: int  # its readings in which the joint neither rests nor moves uniformly
    swing: float  # sum of the changes of the steps, every second one negative,
    changes: float  # and of their sizes
    newest: int  # kind of the newest event
    newest_ns: int  # its stamp
    counts: Annotated[list[int], 9]  # of events by kind
    size: Annotated[list[float], 9]  # of the newest by kind
    rate: Annotated[list[float], 9]  # speed before the newest by kind [rad/s or m/s]
    reading: Annotated[list[float], 9]  # of the newest by kind [rad or m]


def begin_faults(faults: EncoderFaults) -> None:
    """Set everything before the first sample; what was found is kept."""
    faults.warm = BIT_WINDOW
    forget_motion(faults, 0.0)
    faults.settled = faults.bits_seen = faults.due_ns = 0
    faults.tolerance = 0.0
    faults.grain = math.inf
    faults.newest = NO_FAULT


def forget_motion(faults: EncoderFaults, reading: float) -> None:
    """Take a reading whose step from the one before is not known."""
    faults.inflated = faults.age = faults.window = 0
    faults.warm = max(faults.warm, REARMED_AFTER)
    faults.doubted = False
    faults.slope, faults.usual, faults.last = math.nan, -1.0, reading


def inflate(faults: EncoderFaults, deviation: Deviation, velocity: float) -> None:
    """Widen a deviation so that it covers the motion before, too; velocity as published."""
    off = abs(velocity - faults.slope / faults.dt)
    if deviation.velocity < off:
        deviation.velocity = off


def text_of(faults: EncoderFaults, kind: int) -> str:
    """Return the newest fault of a kind as text."""
    return KINDS[kind][1].format(faults.size[kind], faults.rate[kind], faults.reading[kind])


def note_on_faults(faults: EncoderFaults, stamp_ns: int) -> str:
    """Return the newest fault as a note for the status, while it is new or lasts; else ''."""
    lasts = faults.age > 0 and faults.decided
    if faults.newest == NO_FAULT or not (lasts or stamp_ns - faults.newest_ns < SHOWN_NS):
        return ''
    return text_of(faults, faults.newest)


def is_usual(faults: EncoderFaults, reading: float, stamp_ns: int) -> bool:
    """Return False if a reading that was used is to be looked at; else take it."""
    off = reading - faults.last - faults.slope
    if abs(off) <= faults.usual and stamp_ns < faults.due_ns:
        faults.last = reading
        faults.slope += SLOPE_WEIGHT * off
        return True
    return False


def examine_step(faults: EncoderFaults, reading: float, clock: Clock, period: float) -> int:
    """Take a reading by looking at it; return the kind of a fault that it decides, or NO_FAULT.

    Parameters
    ----------
    period : wrap period [rad]; 0: none.
    """
    faults.now_ns, faults.dt = clock.last_ns, clock.mean_dt
    consecutive = faults.usual < 0.0
    before = faults.step if consecutive else faults.slope
    step = wrap(reading - faults.last, period)
    faults.last, faults.step = reading, step
    passed = 1e-9 * clock.dt_ns
    regular = 0.5 * faults.dt < passed < 1.5 * faults.dt
    if math.isnan(faults.slope) or not regular:
        forget_motion(faults, faults.last)
        faults.slope = step * faults.dt / passed
        if not regular:
            faults.usual = math.inf
            faults.due_ns = max(faults.due_ns, faults.now_ns + PAUSE_NS)
        return NO_FAULT
    change, off = step - before, step - faults.slope
    if abs(change) + abs(off) > 0.5 * period:
        change, off = wrap(change, period), wrap(off, period)
    for each in (abs(step), abs(change)):
        if consecutive and STEP_ROUNDING * (abs(step) + ROUNDED_STEP) < each < faults.grain:
            faults.grain = each
            faults.bits_seen = faults.settled = 0
    faults.warm = max(faults.warm - 1, 0)
    faults.inflated = max(faults.inflated - 1, 0)
    limit = 2.0 * faults.tolerance + 2.2 * faults.grain
    odd, most = abs(off) > limit, faults.tolerance + QUANTISED * faults.grain
    faults.unusual = faults.unusual or abs(off) > most
    kind = NO_FAULT
    if faults.window > 0 or faults.now_ns >= faults.due_ns:
        kind = examine_window(faults, step, change, odd)
    stops = step == 0.0 and abs(off) > most + 0.95 * faults.grain
    if faults.age > 0 or (faults.warm == 0 and (odd or stops)):
        kind = max(kind, follow_suspicion(faults, step, change, limit))
    else:
        faults.tolerance = max(faults.tolerance, abs(off) - QUANTISED * faults.grain)
        faults.slope += SLOPE_WEIGHT * off
    faults.doubted = faults.age + faults.inflated > 0
    busy = faults.warm + faults.window + faults.age + faults.inflated > 0
    faults.usual = -1.0 if busy else faults.tolerance + QUANTISED * faults.grain
    return kind


def examine_window(faults: EncoderFaults, step: float, change: float, odd: bool) -> int:
    """Take a reading of a window; return TOGGLE, STUCK_BIT or NO_FAULT."""
    if faults.window == 0:
        known = faults.settled > SETTLED_WINDOWS and faults.counts[TOGGLE] == 0
        if step == 0.0 or (known and not faults.unusual):
            schedule_window(faults, SOON_NS)
            return NO_FAULT
        faults.unusual = False
        faults.changed = faults.moves = 0
        faults.turned, faults.entered = False, faults.slope
        faults.travelled = faults.swing = faults.changes = 0.0
    faults.window += 1
    faults.swing = change - faults.swing
    faults.changes += abs(change)
    exact = faults.last / faults.grain
    code = round(exact) if abs(exact) < MOST_COUNTS else 0
    counts = abs(exact - code) <= 0.1
    if not counts:
        faults.bits_seen = faults.settled = 0
    if faults.window > 1:
        faults.changed |= (code | faults.code) - (code & faults.code)  # exclusive or
    faults.code = code
    faults.turned = faults.turned or step * faults.travelled < 0.0
    if not odd:
        faults.travelled += step
        faults.moves += 1 if step != 0.0 and abs(change) > 0.5 * faults.grain else 0
    if faults.window < BIT_WINDOW:
        return NO_FAULT
    mean, swing = faults.changes / faults.window, abs(faults.swing) / faults.window
    alternates = swing > 0.8 * mean and abs(swing - 2.0 * faults.grain) < 0.5 * faults.grain
    if alternates and faults.window < TOGGLES:
        return NO_FAULT
    if faults.settled > SETTLED_WINDOWS or faults.moves == 0 or not counts:
        schedule_window(faults, SOON_NS - round(2e9 * BIT_WINDOW * faults.dt))
    bit = stuck_bit(faults)
    faults.bits_seen |= faults.changed
    faults.settled += 1 if faults.moves > 0 else 0
    faults.window = 0
    if bit >= 0:
        return count_fault(faults, STUCK_BIT, float(bit))
    kind = TOGGLE if alternates and faults.settled > 1 else NO_FAULT
    return count_fault(faults, kind, faults.grain)


def schedule_window(faults: EncoderFaults, time_ns: int) -> None:
    """Set when the next window begins; until then large deviations are forgotten."""
    faults.due_ns = faults.now_ns + time_ns
    faults.tolerance *= 1.0 - min(FORGETTING / faults.dt, MOST_FORGOTTEN)


def stuck_bit(faults: EncoderFaults) -> int:
    """Return a bit of the counter that does not change any more while the motion passes it, or -1.

    A bit need not change if the motion turns, or the mean step at the begin, at the end or in
    between is nearly a multiple of its period.
    """
    passed = faults.bits_seen - (faults.bits_seen & faults.changed)
    if (
        passed == 0
        or faults.travelled == 0.0
        or faults.turned
        or faults.settled <= SETTLED_WINDOWS
        or 2 * faults.moves <= faults.window
    ):
        return -1
    if not 0.5 < faults.slope * faults.window / faults.travelled < 2.0:  # it stops, or starts
        return -1
    mean = faults.travelled / (faults.window * faults.grain)
    entered, left = faults.entered / faults.grain, faults.slope / faults.grain
    k, size = 0, 1
    while 4.0 * size * faults.grain <= abs(faults.travelled):
        period, least = 2.0 * size, 0.1 * size
        passes = abs(wrap(mean, period)) > least and abs(wrap(entered, period)) > least
        if passed & size != 0 and passes and abs(wrap(left, period)) > least:
            return k
        k += 1
        size *= 2
    return -1


def follow_suspicion(faults: EncoderFaults, step: float, change: float, limit: float) -> int:
    """Take a reading of a suspicion; return the kind of a fault that it decides, or NO_FAULT."""
    slope, grain = faults.slope, faults.grain
    if faults.age == 0:
        faults.offset = faults.worst = 0.0
        faults.resting = faults.resumed_steps = faults.reversed_steps = 0
        faults.steady_steps = faults.zero_steps = faults.moving_steps = faults.soft = 0
        faults.decided = False
    faults.age += 1
    faults.offset += step - slope
    faults.worst = max(faults.worst, abs(change))
    faults.moving_steps += 1 if step != 0.0 else 0
    off, fast = faults.offset, abs(slope)
    if faults.resting == faults.age - 1:
        if abs(off + faults.age * slope) <= 1.5 * grain:
            faults.resting = faults.age
            return follow_rest(faults)
        faults.first_offset, faults.moved_reading = off, faults.last
    first, since = faults.first_offset, faults.age - faults.resting
    near = limit + min(0.05 * fast, (faults.tolerance + grain) * faults.age)
    as_before = abs(step - slope) <= near and (step != 0.0 or fast <= 2.0 * grain)
    faults.resumed_steps = faults.resumed_steps + 1 if as_before else 0
    faults.steady_steps = faults.steady_steps + 1 if abs(change) <= near else 0
    faults.zero_steps = faults.zero_steps + 1 if step == 0.0 else 0
    abrupt = abs(first + 2.0 * slope) <= limit or abs(first) > limit + 4.0 * fast
    way = fast * (since - 1)
    back = abs(off - first + 2.0 * slope * (since - 1)) <= limit + 0.05 * way
    faults.reversed_steps = faults.reversed_steps + 1 if abrupt and back else 0
    if 0.2 * abs(first) < abs(off) < 0.5 * abs(first) or abs(off) > 2.0 * abs(first):
        faults.soft += 1
    if faults.resting > 0 and faults.moving_steps == since:
        caught_up = abs(off) <= limit + 0.3 * abs(step) and abs(step) > 1.5 * fast
        leap = abs(first + (faults.resting + 1) * slope)
        far = faults.resting > 1 and leap > limit + 2.0 * max(fast, abs(step))
        if (since == 1 and caught_up) or (since == 2 and far):
            return end_hold(faults, limit)
    return judge_suspicion(faults, limit)


def name_rest(faults: EncoderFaults, holds: Holds, stamp_ns: int) -> None:
    """Name a rest where counts are missing that one step alone does not show."""
    if faults.age == 0 and faults.warm == 0 and faults.slope == faults.slope:
        faults.newest, faults.newest_ns = STOPPED, stamp_ns
        faults.counts[STOPPED] += 1
        faults.size[STOPPED] = float(holds.unchanged) * faults.dt
        faults.rate[STOPPED] = holds.grain / (holds.count_time * faults.dt)
        faults.reading[STOPPED] = faults.last


def judge_suspicion(faults: EncoderFaults, limit: float) -> int:
    """Return the kind of a fault that the readings of a suspicion show so far, or NO_FAULT."""
    grain, dt, first, off = faults.grain, faults.dt, faults.first_offset, faults.offset
    fast = abs(faults.slope)
    absurd = faults.resting == 0 and abs(first) > ABSURD * dt * dt
    far = abs(first) > 6.0 * faults.tolerance + 8.0 * grain and (fast > limit or absurd)
    drift = 0.5 * (faults.tolerance + grain) * faults.age
    returned = abs(off) <= max(2.0 * limit + drift, 0.1 * abs(first))
    goes_on = max(faults.resumed_steps, faults.steady_steps) >= RESUMED_AFTER
    if far and returned and faults.soft == 0 and goes_on:
        if faults.resting > 0:
            return end_hold(faults, limit)
        return end_suspicion(faults, GLITCH, abs(first))
    if faults.resumed_steps >= RESUMED_AFTER:
        if returned or not far or abs(first - off) > limit + 0.2 * abs(off):
            return end_suspicion(faults, NO_FAULT, 0.0)
        slipped = off * faults.slope < 0.0 and abs(off) <= 1.5 * fast * max(faults.resting, 1)
        return end_suspicion(faults, LOST_WAY if slipped else OFFSET_JUMP, off)
    way = fast * (faults.age - faults.resting - 1)
    if faults.reversed_steps >= WRONG_AFTER and way > 12.0 * limit and fast > limit:
        return end_suspicion(faults, REVERSED, fast)
    rests = faults.zero_steps > 0 and far and abs(first) > 1.5 * fast and fast > 2.0 * grain
    if rests and faults.zero_steps >= WRONG_AFTER and faults.zero_steps * dt > SHORTEST_REST:
        return end_suspicion(faults, STUCK_AT, off)
    if faults.reversed_steps > 0 or rests:
        return NO_FAULT
    late = faults.moving_steps > LONGEST_SUSPICION and faults.zero_steps == 0
    if late or faults.steady_steps >= RESUMED_AFTER:
        return end_suspicion(faults, NO_FAULT, 0.0)
    return NO_FAULT


def follow_rest(faults: EncoderFaults) -> int:
    """Take a reading that rests since a suspicion began."""
    fast, passed = abs(faults.slope), faults.age * faults.dt
    unclear = faults.grain + faults.tolerance
    if faults.decided or passed <= SHORTEST_REST or faults.age * fast <= 16.0 * unclear:
        rests = faults.decided and passed > LONGEST_STOP and faults.newest == STOPPED
        return end_suspicion(faults, NO_FAULT, 0.0) if rests else NO_FAULT
    faults.decided = True
    faults.moved_reading = faults.last
    kind = STUCK_AT if 2.5 * unclear <= STUCK_CHANCE * fast else STOPPED
    return count_fault(faults, kind, passed)


def end_hold(faults: EncoderFaults, limit: float) -> int:
    """End a suspicion: the reading was held; a single one of a slow joint may be chance."""
    faults.worst = 0.0
    sure = faults.resting > 1 or abs(faults.slope) >= limit
    return end_suspicion(faults, HELD_AT if sure else NO_FAULT, float(faults.resting))


def end_suspicion(faults: EncoderFaults, kind: int, size: float) -> int:
    """End a suspicion; return the kind of the fault, or NO_FAULT if a joint can move like this."""
    count_fault(faults, kind, size)
    faults.age = 0
    if kind == NO_FAULT:
        faults.tolerance = max(faults.tolerance, faults.worst - QUANTISED * faults.grain)
    else:
        faults.inflated = INFLATED_AFTER
    if kind == STUCK_AT:
        faults.slope = 0.0
    elif kind == NO_FAULT or kind == REVERSED:
        faults.slope = faults.step
    return kind


def count_fault(faults: EncoderFaults, kind: int, size: float) -> int:
    """Count a fault if it is one; return its kind."""
    if kind != NO_FAULT:
        faults.newest, faults.newest_ns = kind, faults.now_ns
        faults.counts[kind] += 1
        faults.size[kind] = size
        faults.rate[kind] = abs(faults.slope) / faults.dt
        faults.reading[kind] = faults.moved_reading
    return kind


def find_faults(
    faults: EncoderFaults,
    clock: Clock,
    count: int,
    period: float,
    stamps: NDArray[np.int64],
    readings: NDArray[np.float64],
    kinds: NDArray[np.int64],
) -> None:
    """Set the kind of the fault that each used reading decides, or NO_FAULT; shape (count,) each.

    Parameters
    ----------
    clock : with the mean sample time. period : see `examine_step`.
    """
    for k in range(count):
        clock.dt_ns = stamps[k] - clock.last_ns
        clock.last_ns = stamps[k]
        kinds[k] = NO_FAULT
        if not is_usual(faults, readings[k], stamps[k]):
            kinds[k] = examine_step(faults, readings[k], clock, period)
