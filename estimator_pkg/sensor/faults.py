# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of an encoder that its readings alone show: readings that no joint can make.

A step of the reading that the motion so far does not explain begins a suspicion: the line of the
motion before is kept, and what follows is compared with it. If the joint goes on at its speed, a
reading was wrong; if it goes on at another speed, a force acted on it: an impact, a strike, a
gripper that closes. Readings that stop are those of a stop or of a stuck sensor, and mostly nobody
can know until they move again. Until it is decided the deviation covers both.

Steps are changes from one reading to the next [rad or m]. Compared are steps after regular sample
times only.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import wrap
from estimator_pkg.estimate import Deviation
from estimator_pkg.record import record

NONE = -1
# Kinds
STOPPED = 0
STUCK = 1
CHANNEL = 2
HELD = 3
REPEATING = 4
LOST = 5
JUMP = 6
GLITCH = 7
ZERO = 8
REVERSED = 9
TOGGLE = 10
BIT = 11
NAMES = (
    *('stopped', 'stuck', 'channel', 'held', 'repeating', 'lost'),
    *('jump', 'glitch', 'zero', 'reversed', 'toggle', 'bit'),
)
TEXTS = (  # size, speed before
    'the readings stopped at {1:.3g} rad/s within a sample: a stop, or a stuck sensor',
    'the reading is stuck since it moved at {1:.3g} rad/s',
    'the reading toggles by a count since it moved at {1:.3g} rad/s: a channel is lost',
    'the reading was held for {0:.0f} samples at {1:.3g} rad/s, and caught up',
    'each reading comes {2} times at {1:.3g} rad/s',
    'a way of {0:.3g} rad was not counted at {1:.3g} rad/s',
    'the reading jumped by {0:.3g} rad within a sample, at {1:.3g} rad/s before and after',
    'a reading was {0:.3g} rad off the motion before and after it',
    'the reading is {0:.6g} rad now and then, off the motion before and after',
    'the direction reversed within a sample at {1:.3g} rad/s, and the speed stayed',
    'the reading alternates by a count ({0:.3g} rad)',
    'bit {0:.0f} of the counter is stuck: the joint passed it at {1:.3g} rad/s without a change',
)
SHOWN_NS = 5_000_000_000  # time for which a fault stays in the status [ns]

RESIDUE = 1e-6  # of a step: rounding
FINEST = 1e-4  # [rad or m] smaller steps are compared with it
WARM = 32  # readings before the first suspicion
FORGET = 1.0 / 2048.0  # weight of a reading where the largest bend is forgotten
CALM = 3  # steps in a row that show how the joint goes on
PATIENCE = 12  # readings after which a suspicion ends
AWAY = 8  # equal readings away from the motion: the sensor is stuck there
CHANCE = 0.05  # a stop looks like a stuck sensor less often than this, or it is not reported
RUNS = 10  # changes in a row after as many equal readings: they repeat
HOLDS = 4  # holds close to each other: the readings repeat
WINDOW = 64  # readings in which each bit that they pass changes
WINDOWS = 4  # before one is judged: the counter is known
MOST_COUNTS = 1e6
TOGGLES = 96  # alternating steps in a row
NOISY = 0.15  # of the largest bend: changes that alternate, as noise does
QUIET = 8  # equal readings in a row where there was noise
SHORTEST = 0.05  # equal readings for this time are judged [s]
AGAIN = 1.0  # lost counts within this time are less likely stops [s]
DOUBT = 10.0  # time for which a stop may be a stuck sensor [s]
COVER = 32  # readings after a fault in which an observer may follow what was wrong
ABSURD = 1e5  # no joint accelerates like this [rad/s^2 or m/s^2]

MOVING, AWAY_FROM, STILL, RELEASED = 0, 1, 2, 3  # phases of a suspicion


@record
class Faults:
    """What the readings of one joint have shown."""

    ready: int  # readings after regular sample times in a row
    last_ns: int
    last: float  # newest reading [rad or m]
    dt: float  # its mean sample time [s]
    step: float  # the newest step
    zeros: int  # steps of zero in a row
    run: int  # zeros before the newest change
    runs: int  # changes in a row after as many
    speed: float  # mean step
    change: float  # of the step
    jerk: float  # of that
    latest: float  # mean step to the newest change
    grain: float  # smallest step
    bend: float  # largest change of a step, beyond that of counting
    rough: float  # mean change of a step, of those that alternate
    fastest: float  # largest step
    toggles: int  # alternating steps in a row
    phase: int  # of a suspicion
    age: int  # readings since it began
    slope: float  # step before it
    off: float  # distance from the line of the motion before
    first: float  # the first
    far: float  # the largest
    sharp: int  # 1: it began and ended within one step each
    worst: float  # largest change of a step in it
    calm: int  # newest steps in a row as before it
    at_once: int  # 1: the first step of it is no part of a stop
    mirrored: int  # newest steps in a row that go backwards
    back: float  # sum of these
    steady: int  # newest steps in a row that are alike
    held: int  # of these before the newest step
    equal: int  # equal readings in a row
    flips: int  # changes by one count while the reading stays
    decided: int  # it is reported already
    cover: int  # readings for which the deviation covers the motion before
    start: float  # reading that began the suspicion [rad or m]
    place: float  # that of the newest glitch
    since_hold: int  # readings since the newest hold
    holds: int  # holds close to each other
    since_loss: int  # readings since counts were lost, or the joint stopped and went on
    losses: int  # such close to each other
    settled: int  # windows since the smallest step is as now
    code: int  # newest reading in counts
    changed: int  # bits of it that changed in this window
    ever: int  # and in the windows before
    way: float  # sum of its steps
    window: int  # readings of it,
    moves: int  # and those of them in which the joint neither rests nor moves uniformly
    newest: int  # kind of the newest event
    newest_ns: int  # its stamp
    counts: Annotated[list[int], 12]  # of events by kind
    size: Annotated[list[float], 12]  # of the newest by kind
    rate: Annotated[list[float], 12]  # speed before the newest by kind [rad/s or m/s]


def begin_faults(faults: Faults) -> None:
    """Set everything before the first sample; what was found is kept."""
    faults.ready = faults.age = faults.cover = faults.zeros = faults.toggles = 0
    faults.phase = MOVING
    faults.speed = faults.step = faults.bend = faults.rough = faults.fastest = 0.0
    faults.grain = math.inf
    faults.newest, faults.place = NONE, math.nan


def doubted(faults: Faults) -> bool:
    """Return True while the joint may still move as before a suspicion."""
    if faults.phase == MOVING:
        return faults.cover > 0
    surely = faults.phase != STILL or faults.newest == STUCK or faults.newest == CHANNEL
    return surely or faults.age * faults.dt < DOUBT


def cover(faults: Faults, deviation: Deviation, velocity: float) -> None:
    """Widen a deviation so that it covers the motion before, too; velocity as published."""
    before = faults.speed if faults.phase == MOVING else faults.slope
    off = abs(velocity - before / faults.dt)
    if deviation.velocity < off:
        deviation.velocity = off


def text_of(kind: int, size: float, rate: float) -> str:
    """Return a fault as text."""
    return TEXTS[kind].format(size, rate, round(size) + 1)


def note_on_faults(faults: Faults) -> str:
    """Return the newest fault as a note for the status, while it is new or lasts; else ''."""
    kind = faults.newest
    lasts = faults.phase == STILL and faults.decided > 0 and doubted(faults)
    if kind == NONE or not (lasts or faults.last_ns - faults.newest_ns < SHOWN_NS):
        return ''
    return text_of(kind, faults.size[kind], faults.rate[kind])


def follow_faults(
    faults: Faults, stamp_ns: int, reading: float, period: float, mean_dt: float
) -> int:
    """Take a reading that was used; return the kind of a fault that it decides, or NONE.

    Parameters
    ----------
    period : wrap period [rad]; 0: none. mean_dt : mean sample time [s].
    """
    passed = 1e-9 * (stamp_ns - faults.last_ns)
    step = wrap(reading - faults.last, period)
    faults.last_ns, faults.last = stamp_ns, reading
    if faults.ready == 0 or not 0.5 * mean_dt < passed < 1.5 * mean_dt:
        faults.ready, faults.phase, faults.age, faults.zeros = 1, MOVING, 0, 0
        faults.toggles = faults.cover = 0
        faults.step = faults.speed = 0.0
        return NONE
    faults.dt = mean_dt
    faults.ready += 1
    faults.since_hold += 1
    faults.since_loss += 1
    change = step - faults.step
    if toggles(faults, step, change):
        return note(faults, TOGGLE, faults.grain, abs(faults.speed))
    bit = stuck_bit(faults, reading, step)
    if bit >= 0:
        return note(faults, BIT, float(bit), abs(faults.speed))
    faults.step = step
    faults.change = change
    size = abs(step)
    for each in (size, abs(change)):
        if RESIDUE * (size + FINEST) < each < faults.grain:
            faults.grain = each
            faults.ever = faults.settled = 0
    limit = 2.0 * faults.bend + 2.2 * faults.grain
    if faults.cover > 0:
        faults.cover -= 1
    if faults.phase == MOVING:
        if step == 0.0:
            faults.zeros += 1
        if faults.ready > WARM and suspects(faults, step, abs(change), limit):
            return NONE
        return go_on(faults, step, change)
    faults.age += 1
    faults.off += step - faults.slope
    faults.worst = max(faults.worst, abs(change))
    if faults.phase == AWAY_FROM:
        return follow_away(faults, step, change, limit)
    if faults.phase == STILL:
        return follow_still(faults, step, limit)
    return follow_released(faults, step, change, limit)


def go_on(faults: Faults, step: float, change: float) -> int:
    """Take an ordinary step."""
    over = abs(change) - 1.5 * faults.grain
    faults.bend = max(faults.bend * (1.0 - FORGET), over)
    faults.fastest = max(faults.fastest, abs(step))
    if faults.zeros < 2:
        alternates = change * (change - faults.jerk) < 0.0
        faults.rough += ((abs(change) if alternates else 0.0) - faults.rough) / 64.0
    if step != 0.0:
        alike = faults.zeros > 0 and faults.zeros == faults.run
        alike = alike and abs(faults.speed) > 1.5 * faults.grain
        faults.runs = faults.runs + 1 if alike else 0
        faults.run = faults.zeros
        mean = step / (faults.zeros + 1)
        faults.latest = mean
        weight = 1.0 if abs(mean) > 8.0 * (faults.grain + faults.bend) else 0.125
        faults.speed += weight * (mean - faults.speed)
        faults.zeros = 0
        if faults.runs >= RUNS:
            faults.runs = 0
            return note(faults, REPEATING, float(faults.run), abs(faults.speed))
    elif (
        faults.zeros > QUIET
        and faults.zeros * abs(faults.speed) > 4.0 * faults.grain + 2.0 * faults.bend
    ):
        faults.speed = 0.0
    return NONE


def toggles(faults: Faults, step: float, change: float) -> bool:
    """Return True once the readings alternate by a count: noise changes its sign less often."""
    jerk = change - faults.change
    product, square = jerk * faults.jerk, faults.grain * faults.grain
    faults.jerk = jerk
    if product > -2.0 * square or abs(jerk) > 8.0 * faults.grain or step == 0.0:
        faults.toggles = max(faults.toggles - 6, 0)
    elif product < -6.0 * square:
        faults.toggles += 1
    if faults.toggles < TOGGLES:
        return False
    faults.toggles = 0
    return True


def stuck_bit(faults: Faults, reading: float, step: float) -> int:
    """Return a bit of the counter that does not change any more while the motion passes it, or -1.

    A mean step that is nearly a multiple of what the bit repeats after may leave it as it is.
    """
    exact = reading / faults.grain
    if not abs(exact) < MOST_COUNTS:  # the last digits of a float
        return -1
    code = round(exact)
    if abs(exact - code) > 0.1:
        faults.ever = faults.settled = 0
        return -1
    faults.changed |= (code | faults.code) - (code & faults.code)  # exclusive or
    faults.code = code
    faults.way += step
    if step != 0.0 and abs(faults.jerk) > 0.5 * faults.grain:
        faults.moves += 1
    faults.window += 1
    if faults.window < WINDOW:
        return -1
    passed = faults.ever - (faults.ever & faults.changed)
    mean, bit, size = faults.way / (WINDOW * faults.grain), -1, 1
    faults.settled += 1
    if passed != 0 and faults.settled > WINDOWS and 4 * faults.moves > WINDOW:
        k = 0
        while 4.0 * size * faults.grain <= abs(faults.way) and bit < 0:
            part = abs(wrap(mean, 2.0 * size)) / size
            if passed & size != 0 and part > 0.1:
                bit = k
            k += 1
            size *= 2
    faults.ever |= faults.changed
    faults.changed = faults.window = faults.moves = 0
    faults.way = 0.0
    return bit


def suspects(faults: Faults, step: float, change: float, limit: float) -> bool:
    """Return True if a step begins a suspicion."""
    speed = faults.speed
    fast = min(abs(speed), 1.4 * abs(faults.latest))
    stops = abs(step) <= 1.5 * faults.grain and fast > limit + 2.0 * faults.grain
    stops = stops or (step == 0.0 and fast > faults.bend + 2.0 * faults.grain)
    if not stops and step == 0.0 and fast > faults.grain:
        need = 4.0 * faults.grain + 2.0 * faults.bend
        noise = faults.rough > NOISY * max(faults.grain, faults.bend)
        if noise and faults.zeros >= QUIET:
            stops = faults.zeros * fast > need and fast > 0.8 * faults.rough
        elif (faults.zeros - 1) * abs(speed) <= need:
            stops = faults.zeros * fast > need and fast > 2.0 * faults.bend
    if not stops and change <= limit:
        return False
    faults.phase = STILL if stops else AWAY_FROM
    faults.age = max(faults.zeros, 1)
    faults.slope = speed
    faults.off = faults.first = faults.far = step - faults.age * speed
    faults.worst = change
    faults.start = faults.last
    faults.calm = faults.mirrored = faults.steady = faults.equal = faults.held = 0
    faults.decided = faults.sharp = 0
    faults.at_once = int(abs(step + speed) <= limit or abs(step) > limit + 3.0 * fast)
    faults.back = step if stops else 0.0
    faults.flips = 1 if stops and step != 0.0 else 0
    return True


def follow_away(faults: Faults, step: float, change: float, limit: float) -> int:
    """Take a reading after one that was off the line of the motion."""
    slope, off = faults.slope, faults.off
    fast = abs(slope)
    before = abs(off - step + slope)  # from the line, one reading ago
    if before > 0.5 * abs(faults.far) and abs(off) < 0.3 * abs(faults.far):
        faults.sharp = int(abs(faults.first) > 0.8 * abs(faults.far))
    if abs(off) > abs(faults.far):
        faults.far = off
    drift = (faults.bend + faults.grain) * faults.age
    near = limit + min(0.05 * fast, drift)
    on = abs(step - slope) <= near and (step != 0.0 or fast <= 2.0 * faults.grain)
    faults.calm = faults.calm + 1 if on else 0
    way = fast * (faults.age - 1)
    back = abs(off - faults.first + 2.0 * slope * (faults.age - 1))
    goes_back = faults.at_once > 0 and back <= limit + 0.12 * way
    faults.mirrored = faults.mirrored + 1 if goes_back else 0
    faults.steady = faults.steady + 1 if abs(change) <= near else 0
    faults.equal = faults.equal + 1 if step == 0.0 else 0
    least = 4.0 * faults.bend + 8.0 * faults.grain
    if faults.calm >= CALM:
        returned = abs(off) <= 2.0 * limit + 0.5 * drift * faults.age
        size = faults.far if returned else off
        absurd = (
            abs(size) > 4.0 * faults.fastest or 4.0 * abs(size) > ABSURD * faults.dt * faults.dt
        )
        if abs(size) <= least or not (fast > limit or absurd):
            return end(faults, NONE, 0.0)
        if not returned:
            if abs(faults.first - off) > 0.2 * abs(off) + near:
                return end(faults, NONE, 0.0)
            slipped = off * slope < 0.0 and abs(off) <= 1.5 * fast
            return end(faults, LOST if slipped else JUMP, off)
        if faults.sharp > 0:
            return end(faults, GLITCH, size)
        return end(faults, NONE, 0.0)
    if faults.mirrored >= 8 and way > 12.0 * limit:
        return end(faults, REVERSED, fast)
    out = abs(faults.first) > least + 1.5 * fast and fast > 2.0 * faults.grain
    if out and faults.equal >= AWAY and faults.equal * faults.dt > SHORTEST:
        return end(faults, STUCK, off)
    if out and faults.held >= 2 and faults.sharp > 0:
        return end(faults, GLITCH, faults.far)
    faults.held = faults.equal
    if faults.steady >= CALM and not (faults.mirrored > 0 or (out and faults.equal > 0)):
        return end(faults, NONE, 0.0)
    if faults.age > PATIENCE and faults.equal == 0 and faults.mirrored == 0:
        return end(faults, NONE, 0.0)
    return NONE


def follow_still(faults: Faults, step: float, limit: float) -> int:
    """Take a reading after those that stopped at speed."""
    fast = abs(faults.slope)
    faults.back += step
    if abs(faults.back) <= 1.5 * faults.grain:
        if step != 0.0:
            faults.flips += 1
        passed = faults.age * faults.dt
        if faults.decided == 0 and passed > SHORTEST and faults.age * fast > 16.0 * faults.grain:
            faults.decided = 1
            unsure = 2.5 * (faults.grain + faults.bend) > CHANCE * fast
            kind = STOPPED if unsure else (CHANNEL if faults.flips > 4 else STUCK)
            return note(faults, kind, passed, fast)
        return NONE
    held = faults.age - 1
    if faults.flips == 0 and abs(step) > 1.5 * fast:
        if abs(faults.off) <= limit + 0.3 * abs(step):
            return hold(faults, held, limit)
    faults.phase, faults.calm = RELEASED, 0
    faults.equal = held
    faults.far = step
    return NONE


def follow_released(faults: Faults, step: float, change: float, limit: float) -> int:
    """Take a reading after those that stopped and moved again."""
    faults.calm += 1
    if faults.calm == 1:
        return NONE
    fast, now, first = abs(faults.slope), abs(step), faults.far
    moves = now > 3.0 * faults.grain or abs(first) > 4.0 * faults.fastest
    if faults.flips == 0 and abs(change) <= limit + 0.1 * now and moves:
        if abs(first) > limit + 2.0 * max(fast, now):
            return hold(faults, faults.equal, limit)
        near = limit + 0.1 * now
        again = faults.since_loss * faults.dt < AGAIN
        lost = faults.equal > 1 and abs(first - step) <= near
        lost = lost and abs(step - faults.slope) <= near + 0.1 * fast
        if lost:
            faults.losses = faults.losses + 1 if again else 1
            faults.since_loss = 0
            lost = faults.losses * fast > 8.0 * (faults.grain + faults.bend)
        if lost:
            return end(faults, LOST, -faults.equal * faults.slope)
    return end(faults, NONE, 0.0)


def hold(faults: Faults, held: int, limit: float) -> int:
    """End a suspicion: the reading was held."""
    faults.holds = faults.holds + 1 if faults.since_hold <= 4 * (held + 1) else 1
    faults.since_hold = 0
    if faults.holds < HOLDS and held < 2 and abs(faults.slope) < limit:
        return end(faults, NONE, 0.0)
    return end(faults, REPEATING if faults.holds >= HOLDS else HELD, float(held))


def end(faults: Faults, kind: int, size: float) -> int:
    """End a suspicion; return the kind of the fault, or NONE if a joint can move like this."""
    faults.phase = MOVING
    faults.zeros = 0
    fast = abs(faults.slope)
    if kind == NONE:
        faults.bend = max(faults.bend, faults.worst - 1.5 * faults.grain)
        faults.fastest = max(faults.fastest, abs(faults.step))
        faults.speed = faults.step
        return NONE
    faults.cover = COVER
    faults.speed = faults.step if kind == REVERSED else faults.slope
    if kind == STUCK:
        faults.speed = 0.0
    if kind == GLITCH:
        if faults.start == faults.place:
            return note(faults, ZERO, faults.place, fast)
        faults.place = faults.start
    return note(faults, kind, size, fast)


def note(faults: Faults, kind: int, size: float, fast: float) -> int:
    """Count a fault; return its kind."""
    faults.newest, faults.newest_ns = kind, faults.last_ns
    faults.counts[kind] += 1
    faults.size[kind] = size
    faults.rate[kind] = fast / faults.dt
    return kind


def find_faults(
    faults: Faults,
    count: int,
    period: float,
    mean_dt: float,
    stamps: NDArray[np.int64],
    readings: NDArray[np.float64],
    kinds: NDArray[np.int64],
) -> None:
    """Set the kind of the fault that each used reading decides, or NONE; shape (count,) each.

    Parameters
    ----------
    period, mean_dt : see `follow_faults`.
    """
    for k in range(count):
        kinds[k] = follow_faults(faults, stamps[k], readings[k], period, mean_dt)
