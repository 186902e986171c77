# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of an encoder that its readings alone show: readings that no joint can make.

A step of the reading that the motion so far does not explain begins a suspicion: what follows is
compared with the line of the motion before. If the joint goes on at its speed, a reading was wrong;
if it goes on at another speed, a force acted: an impact, a strike, a gripper that closes. Readings
that stop are those of a stop or of a stuck sensor, and mostly nobody can know until they move
again. Until it is decided the deviation covers both.

Most readings cost a few comparisons: `look` is called where a step changes more than steps did so
far, for a reading equal to the last one in motion, once a block, in a window of readings in which
the bits of the counter are examined, and while there is a suspicion. Steps are changes from one
reading to the next [rad or m], and only steps after regular sample times are looked at.
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

NONE = -1
STOPPED, STUCK, CHANNEL, HELD, LOST, JUMP, GLITCH, ZERO, REVERSED, TOGGLE, BIT = range(11)
KINDS = (  # name, text with (size, speed before)
    ('stopped', 'the readings stopped at {1:.3g} rad/s within a sample: a stop, or a stuck sensor'),
    ('stuck', 'the reading is stuck since it moved at {1:.3g} rad/s'),
    ('channel', 'the reading toggles by a count since it moved at {1:.3g} rad/s: a lost channel'),
    ('held', 'the reading was held for {0:.0f} samples at {1:.3g} rad/s, and caught up'),
    ('lost', 'a way of {0:.3g} rad was not counted at {1:.3g} rad/s'),
    ('jump', 'the reading jumped by {0:.3g} rad at {1:.3g} rad/s before and after'),
    ('glitch', 'a reading was {0:.3g} rad off the motion before and after it'),
    ('zero', 'the reading is {0:.6g} rad now and then, off the motion before and after'),
    ('reversed', 'the direction reversed within a sample at {1:.3g} rad/s, and the speed stayed'),
    ('toggle', 'the reading alternates by a count ({0:.3g} rad)'),
    ('bit', 'bit {0:.0f} of the counter is stuck: the joint passed it at {1:.3g} rad/s'),
)
SHOWN_NS = 5_000_000_000  # time for which a fault stays in the status [ns]

RESIDUE = 1e-6  # of a step: rounding
FINEST = 1e-4  # [rad or m] smaller steps are compared with it
BLOCK = 16  # readings over which the mean step is taken
WARM = 32  # readings before the first suspicion
FORGET = 1.0 / 128.0  # weight of a block where the largest bend is forgotten
CALM = 3  # steps in a row that show how the joint goes on
PATIENCE = 12  # readings after which a suspicion ends
AWAY = 8  # equal readings away from the motion: the sensor is stuck there
CHANCE = 0.05  # a stop looks like a stuck sensor less often than this, or it is not reported
WINDOW = 64  # readings in which each bit that they pass changes
SOON_NS = 900_000_000  # after this time a window with a fault has ended [ns]
WINDOWS = 4  # before a bit is judged: the counter is known
MOST_COUNTS = 1e6
TOGGLES = 160  # readings in which each step is on the other side of the mean
SHORTEST = 0.05  # equal readings for this time are judged [s]
AGAIN_NS = 1_000_000_000  # lost counts within this time are less likely stops [ns]
DOUBT = 10.0  # time for which a stop may be a stuck sensor [s]
COVER = 32  # readings after a fault in which an observer may follow what was wrong
ABSURD = 1e5  # no joint accelerates like this [rad/s^2 or m/s^2]

MOVING, AWAY_FROM, STILL, RELEASED = range(4)  # phases of a suspicion


@record
class Faults:
    """What the readings of one joint have shown."""

    last: float  # newest reading [rad or m]
    step: float  # newest step, not wrapped
    left: int  # readings to the end of the block
    usual: float  # a larger change of a step is looked at; negative: each reading is
    still: float  # 0: equal readings are looked at; negative: the joint rests, they are not
    ready: int  # readings looked at since the start or an irregular sample time
    dt: float  # mean sample time [s]
    now_ns: int  # newest stamp that was looked at
    anchor: float  # reading at the beginning of the block
    slope: float  # mean step; in a suspicion: before it
    latest: float  # step before the zeros
    zeros: int  # steps of zero in a row
    grain: float  # smallest step
    bend: float  # largest change of a step, beyond that of counting
    rough: float  # mean change of a step in the newest window
    fastest: float  # largest mean step
    phase: int  # of a suspicion
    doubted: bool  # the joint may still move as before
    cover: int  # readings for which the deviation covers the motion before
    age: int  # readings since the suspicion began
    start: float  # reading that began it [rad or m]
    off: float  # distance from the line of the motion before,
    first: float  # the first,
    far: float  # and the largest
    sharp: bool  # it began and ended within one step each
    worst: float  # largest change of a step in it
    calm: int  # newest steps in a row as before it,
    mirrored: int  # that go backwards,
    steady: int  # that are alike
    abrupt: bool  # the first step of it is no part of a stop
    back: float  # way since the readings stopped
    equal: int  # equal readings in a row,
    held: int  # and before the newest step
    flips: int  # changes by one count while the reading stays
    decided: bool  # it is reported already
    place: float  # reading of the newest glitch
    held_ns: int  # stamp of the newest hold
    holds: int  # holds close to each other
    lost_ns: int  # stamp when counts were lost, or the joint stopped and went on,
    losses: int  # such close to each other
    due_ns: int  # stamp of the next window
    window: int  # readings of it so far; 0: none
    settled: int  # windows since the smallest step is as now
    code: int  # newest reading in counts
    changed: int  # bits of it that changed in this window,
    ever: int  # and in the windows before
    way: float  # sum of the steps of the window
    moves: int  # its readings in which the joint neither rests nor moves uniformly
    swing: float  # sum of the changes of the steps, every second one negative,
    changes: float  # and of their sizes
    newest: int  # kind of the newest event
    newest_ns: int  # its stamp
    counts: Annotated[list[int], 11]  # of events by kind
    size: Annotated[list[float], 11]  # of the newest by kind
    rate: Annotated[list[float], 11]  # speed before the newest by kind [rad/s or m/s]


def begin_faults(faults: Faults) -> None:
    """Set everything before the first sample; what was found is kept."""
    faults.ready = faults.cover = faults.zeros = faults.window = faults.settled = faults.ever = 0
    faults.phase, faults.doubted = MOVING, False
    faults.slope = faults.bend = faults.rough = faults.fastest = 0.0
    faults.due_ns = 0
    faults.usual = faults.still = -1.0
    faults.grain = math.inf
    faults.newest, faults.place = NONE, math.nan


def forget_motion(faults: Faults, reading: float) -> None:
    """Take a reading whose step from the one before is not known."""
    faults.ready = faults.left = 0
    faults.last = reading


def cover(faults: Faults, deviation: Deviation, velocity: float) -> None:
    """Widen a deviation so that it covers the motion before, too; velocity as published."""
    off = abs(velocity - faults.slope / faults.dt)
    if deviation.velocity < off:
        deviation.velocity = off


def text_of(kind: int, size: float, rate: float) -> str:
    """Return a fault as text."""
    return KINDS[kind][1].format(size, rate)


def note_on_faults(faults: Faults, stamp_ns: int) -> str:
    """Return the newest fault as a note for the status, while it is new or lasts; else ''."""
    kind = faults.newest
    lasts = faults.phase == STILL and faults.decided and faults.doubted
    if kind == NONE or not (lasts or stamp_ns - faults.newest_ns < SHOWN_NS):
        return ''
    return text_of(kind, faults.size[kind], faults.rate[kind])


def follow_faults(faults: Faults, reading: float, clock: Clock, period: float) -> int:
    """Take a reading that was used; return the kind of a fault that it decides, or NONE.

    Parameters
    ----------
    period : wrap period [rad]; 0: none.
    """
    step = reading - faults.last
    change = step - faults.step
    faults.last = reading
    faults.step = step
    faults.left -= 1
    if faults.left > 0 and abs(change) <= faults.usual and abs(step) > faults.still:
        return NONE
    return look(faults, wrap(step, period), wrap(change, period), clock, period)


def look(faults: Faults, step: float, change: float, clock: Clock, period: float) -> int:
    """Look at a reading; return the kind of a fault that it decides, or NONE."""
    passed = 1e-9 * clock.dt_ns
    faults.now_ns, faults.dt = clock.last_ns, clock.mean_dt
    if not 0.5 * faults.dt < passed < 1.5 * faults.dt:
        faults.ready = 0
    faults.ready += 1
    if faults.ready <= 2:  # neither the step nor its change is known
        faults.phase, faults.doubted, faults.usual = MOVING, False, -1.0
        faults.cover = faults.window = faults.zeros = 0
        faults.slope = 0.0
        begin_block(faults)
        return NONE
    size, bent = abs(step), abs(change)
    for each in (size, bent):
        if RESIDUE * (size + FINEST) < each < faults.grain:
            faults.grain = each
            faults.ever = faults.settled = 0
    faults.cover = max(faults.cover - 1, 0)
    limit = 2.0 * faults.bend + 2.2 * faults.grain
    kind = NONE
    if faults.window > 0 or faults.now_ns >= faults.due_ns:
        kind = examine(faults, step, change)
    if kind != NONE:
        end(faults, NONE, 0.0)
    elif faults.phase != MOVING:
        faults.age += 1
        faults.off += step - faults.slope
        faults.worst = max(faults.worst, bent)
        if faults.phase == AWAY_FROM:
            kind = follow_away(faults, step, change, limit)
        elif faults.phase == STILL:
            kind = follow_still(faults, step, limit)
        else:
            kind = follow_released(faults, step, change, limit)
    elif faults.ready <= WARM or not suspects(faults, step, change, limit, period):
        go_on(faults, step, change, period)
    stays = faults.phase == STILL and (faults.decided or faults.age * faults.dt < DOUBT)
    faults.doubted = faults.cover > 0 or stays or faults.phase % 2 == 1
    busy = faults.ready <= WARM or faults.window + faults.zeros + faults.cover > 0
    faults.usual = -1.0 if busy or faults.phase != MOVING else faults.bend + 1.5 * faults.grain
    if faults.grain == math.inf:
        faults.usual = 0.0
    return kind


def begin_block(faults: Faults) -> None:
    """Begin a block at the newest reading."""
    faults.anchor, faults.left = faults.last, BLOCK
    faults.still = 0.0 if abs(faults.slope) > 1.2 * faults.grain else -1.0


def go_on(faults: Faults, step: float, change: float, period: float) -> None:
    """Take an ordinary step."""
    faults.bend = max(faults.bend, abs(change) - 1.5 * faults.grain)
    if step != 0.0:
        faults.zeros = 0
    elif faults.zeros >= BLOCK:
        faults.zeros = 0
        faults.slope = 0.0
        begin_block(faults)
    if faults.left <= 0 and faults.zeros == 0:
        count = BLOCK - faults.left
        faults.slope = mean_step(faults, step, faults.last, count, period)
        faults.fastest = max(faults.fastest, abs(faults.slope))
        faults.bend *= 1.0 - FORGET
        begin_block(faults)


def mean_step(faults: Faults, step: float, reading: float, count: int, period: float) -> float:
    """Return the mean step from the beginning of the block to a reading; `step`: the newest."""
    way = reading - faults.anchor
    return step + wrap(way - count * step, period) / count


def examine(faults: Faults, step: float, change: float) -> int:
    """Take a reading of a window; return TOGGLE, BIT or NONE."""
    if faults.window == 0:
        faults.changed = faults.moves = 0
        faults.way = faults.swing = faults.changes = 0.0
    faults.window += 1
    faults.swing = change - faults.swing
    faults.changes += abs(change)
    faults.way += step
    follow_code(faults)
    if step != 0.0 and abs(change) > 0.5 * faults.grain:
        faults.moves += 1
    if faults.window % WINDOW > 0 and faults.window != TOGGLES:
        return NONE
    mean = faults.changes / faults.window
    alternates = abs(faults.swing) > 0.75 * faults.changes
    alternates = alternates and 1.5 * faults.grain < mean < 6.0 * faults.grain
    if faults.window == WINDOW:
        faults.rough = mean
        bit = stuck_bit(faults)
        faults.ever |= faults.changed
        faults.settled += 1
        if bit >= 0:
            faults.window = 0
            return note(faults, BIT, float(bit), abs(faults.slope))
    if alternates and faults.window < TOGGLES:
        return NONE
    faults.window = 0
    if faults.ready > WINDOWS * WINDOW:
        faults.due_ns = faults.now_ns + SOON_NS - round(2e9 * WINDOW * faults.dt)
    return note(faults, TOGGLE, faults.grain, abs(faults.slope)) if alternates else NONE


def follow_code(faults: Faults) -> None:
    """Follow the bits of the counter that change."""
    exact = faults.last / faults.grain
    if not abs(exact) < MOST_COUNTS:  # the last digits of a float
        faults.ever = faults.settled = 0
        return
    code = round(exact)
    if abs(exact - code) > 0.1:
        faults.ever = faults.settled = 0
    if faults.window > 1:
        faults.changed |= (code | faults.code) - (code & faults.code)  # exclusive or
    faults.code = code


def stuck_bit(faults: Faults) -> int:
    """Return a bit of the counter that does not change any more while the motion passes it, or -1.

    A mean step that is nearly a multiple of what the bit repeats after may leave it as it is.
    """
    passed = faults.ever - (faults.ever & faults.changed)
    if passed == 0 or faults.settled <= WINDOWS or 4 * faults.moves <= WINDOW:
        return NONE
    mean = faults.way / (WINDOW * faults.grain)
    k, size = 0, 1
    while 4.0 * size * faults.grain <= abs(faults.way):
        if passed & size != 0 and abs(wrap(mean, 2.0 * size)) > 0.1 * size:
            return k
        k += 1
        size *= 2
    return NONE


def suspects(faults: Faults, step: float, change: float, limit: float, period: float) -> bool:
    """Return True if a step begins a suspicion."""
    odd = abs(change) > limit
    if step == 0.0:
        faults.zeros += 1
    if not odd and faults.zeros == 0:
        return False
    grain, bend = faults.grain, faults.bend
    if faults.zeros < 2:
        faults.latest = step - change
        count = BLOCK - faults.left - 1
        if abs(faults.latest) > 8.0 * (grain + bend):
            faults.slope = faults.latest
        elif count >= AWAY:
            reading = faults.last - faults.step
            faults.slope = mean_step(faults, faults.latest, reading, count, period)
    speed = faults.slope
    fast = min(abs(speed), 1.4 * abs(faults.latest))
    if abs(faults.latest - speed) > limit + 4.0 * bend:  # it brakes
        fast = 0.0
    stops = abs(step) <= 1.5 * grain and fast > limit + 2.0 * grain
    stops = stops or (step == 0.0 and fast > bend + 2.0 * grain)
    if step == 0.0 and fast > grain:
        need = 4.0 * grain + 2.0 * bend
        quiet = faults.zeros >= AWAY and fast > 0.8 * faults.rough  # where there was noise
        stops = stops or (faults.zeros * fast > need and (quiet or fast > 2.0 * bend))
    if not stops and not odd:
        return False
    faults.phase = STILL if stops else AWAY_FROM
    faults.age = max(faults.zeros, 1)
    faults.off = faults.first = faults.far = step - faults.age * speed
    faults.worst = abs(change)
    faults.start = faults.last
    faults.calm = faults.mirrored = faults.steady = faults.equal = faults.held = 0
    faults.decided = faults.sharp = False
    faults.abrupt = abs(step + speed) <= limit or abs(step) > limit + 3.0 * fast
    faults.back = step if stops else 0.0
    faults.flips = 1 if stops and step != 0.0 else 0
    return True


def follow_away(faults: Faults, step: float, change: float, limit: float) -> int:
    """Take a reading after one that was off the line of the motion."""
    slope, off, far = faults.slope, faults.off, abs(faults.far)
    fast = abs(slope)
    if abs(off - step + slope) > 0.5 * far and abs(off) < 0.3 * far:
        faults.sharp = abs(faults.first) > 0.8 * far
    if abs(off) > far:
        faults.far = off
    drift = (faults.bend + faults.grain) * faults.age
    near = limit + min(0.05 * fast, drift)
    on = abs(step - slope) <= near and (step != 0.0 or fast <= 2.0 * faults.grain)
    faults.calm = faults.calm + 1 if on else 0
    way = fast * (faults.age - 1)
    back = abs(off - faults.first + 2.0 * slope * (faults.age - 1))
    mirrors = faults.abrupt and back <= limit + 0.12 * way
    faults.mirrored = faults.mirrored + 1 if mirrors else 0
    faults.steady = faults.steady + 1 if abs(change) <= near else 0
    faults.equal = faults.equal + 1 if step == 0.0 else 0
    least = 4.0 * faults.bend + 8.0 * faults.grain
    if faults.calm >= CALM:
        returned = abs(off) <= 2.0 * limit + 0.5 * drift * faults.age
        size = abs(faults.far) if returned else abs(off)
        absurd = size > 4.0 * faults.fastest or 4.0 * size > ABSURD * faults.dt * faults.dt
        if size <= least or not (fast > limit or absurd):
            return end(faults, NONE, 0.0)
        if returned:
            return end(faults, GLITCH if faults.sharp else NONE, faults.far)
        if abs(faults.first - off) > 0.2 * abs(off) + near:
            return end(faults, NONE, 0.0)
        slipped = off * slope < 0.0 and abs(off) <= 1.5 * fast
        return end(faults, LOST if slipped else JUMP, off)
    if faults.mirrored >= AWAY and way > 12.0 * limit:
        return end(faults, REVERSED, fast)
    out = abs(faults.first) > least + 1.5 * fast and fast > 2.0 * faults.grain
    if out and faults.equal >= AWAY and faults.equal * faults.dt > SHORTEST:
        return end(faults, STUCK, off)
    if out and faults.held >= 2 and faults.sharp:
        return end(faults, GLITCH, faults.far)
    faults.held = faults.equal
    alike = faults.steady >= CALM and not (faults.mirrored > 0 or (out and faults.equal > 0))
    late = faults.age > PATIENCE and faults.equal == 0 and faults.mirrored == 0
    return end(faults, NONE, 0.0) if alike or late else NONE


def follow_still(faults: Faults, step: float, limit: float) -> int:
    """Take a reading after those that stopped at speed."""
    fast = abs(faults.slope)
    faults.back += step
    if abs(faults.back) <= 1.5 * faults.grain:
        if step != 0.0:
            faults.flips += 1
        passed = faults.age * faults.dt
        if passed > DOUBT and faults.newest == STOPPED:  # it rests
            faults.phase, faults.slope = MOVING, 0.0
            begin_block(faults)
            return NONE
        if faults.decided or passed <= SHORTEST or faults.age * fast <= 16.0 * faults.grain:
            return NONE
        faults.decided = True
        if 2.5 * (faults.grain + faults.bend) > CHANCE * fast:
            return note(faults, STOPPED, passed, fast)
        return note(faults, CHANNEL if faults.flips > 4 else STUCK, passed, fast)
    faults.held = faults.age - 1
    if faults.flips == 0 and abs(step) > 1.5 * fast:
        if abs(faults.off) <= limit + 0.3 * abs(step):
            return hold(faults, limit)
    faults.phase, faults.calm, faults.far = RELEASED, 0, step
    return NONE


def follow_released(faults: Faults, step: float, change: float, limit: float) -> int:
    """Take a reading after those that stopped and moved again."""
    faults.calm += 1
    if faults.calm == 1:
        return NONE
    fast, now, first = abs(faults.slope), abs(step), faults.far
    near = limit + 0.1 * now
    moves = now > 3.0 * faults.grain or abs(first) > 4.0 * faults.fastest
    if faults.flips > 0 or abs(change) > near or not moves:
        return end(faults, NONE, 0.0)
    if abs(first) > limit + 2.0 * max(fast, now):
        return hold(faults, limit)
    alike = abs(first - step) <= near and abs(step - faults.slope) <= near + 0.1 * fast
    if faults.held > 1 and alike:
        again = faults.now_ns - faults.lost_ns < AGAIN_NS
        faults.losses = faults.losses + 1 if again else 1
        faults.lost_ns = faults.now_ns
        if faults.losses * fast > 8.0 * (faults.grain + faults.bend):
            return end(faults, LOST, -faults.held * faults.slope)
    return end(faults, NONE, 0.0)


def hold(faults: Faults, limit: float) -> int:
    """End a suspicion: the reading was held, once more."""
    close_ns = round(4e9 * (faults.held + 1) * faults.dt)
    faults.holds = faults.holds + 1 if faults.now_ns - faults.held_ns <= close_ns else 1
    faults.held_ns = faults.now_ns
    surely = faults.holds > CALM or faults.held > 1 or abs(faults.slope) >= limit
    return end(faults, HELD if surely else NONE, float(faults.held))


def end(faults: Faults, kind: int, size: float) -> int:
    """End a suspicion; return the kind of the fault, or NONE if a joint can move like this."""
    faults.phase, faults.zeros = MOVING, 0
    fast = abs(faults.slope)
    if kind == NONE:
        faults.bend = max(faults.bend, faults.worst - 1.5 * faults.grain)
        faults.fastest = max(faults.fastest, abs(faults.step))
    else:
        faults.cover = COVER
    if kind == STUCK:
        faults.slope = 0.0
    elif kind == NONE or kind == REVERSED:
        faults.slope = faults.step
    begin_block(faults)
    if kind == GLITCH and faults.start == faults.place:
        return note(faults, ZERO, faults.place, fast)
    if kind == GLITCH:
        faults.place = faults.start
    return note(faults, kind, size, fast)


def note(faults: Faults, kind: int, size: float, fast: float) -> int:
    """Count a fault; return its kind."""
    if kind != NONE:
        faults.newest, faults.newest_ns = kind, faults.now_ns
        faults.counts[kind] += 1
        faults.size[kind] = size
        faults.rate[kind] = fast / faults.dt
    return kind


def find_faults(
    faults: Faults,
    clock: Clock,
    count: int,
    period: float,
    stamps: NDArray[np.int64],
    readings: NDArray[np.float64],
    kinds: NDArray[np.int64],
) -> None:
    """Set the kind of the fault that each used reading decides, or NONE; shape (count,) each.

    Parameters
    ----------
    clock : with the mean sample time. period : see `follow_faults`.
    """
    for k in range(count):
        clock.dt_ns = stamps[k] - clock.last_ns
        clock.last_ns = stamps[k]
        kinds[k] = follow_faults(faults, readings[k], clock, period)
