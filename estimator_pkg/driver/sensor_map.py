# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sensor errors that repeat each turn: learnt, and taken out of the readings (`sensor_map: learn`).

An eccentric magnet, misplaced Hall sensors and bad encoder lines make the readings wrong by an
error that depends on the angle alone. The turn is divided by marks: the edges of a coarse sensor,
or 32 to 64 angles of a fine one. A shaft that turns steadily passes a mark too late or too early
by its error. The time of a whole turn has no such error, because it begins and ends at the same
mark. So the speed between two marks is taken from the turn around them, and

    error of a mark = sum over the marks before it of (speed x time between marks - their distance)

with mean 0 over the turn. The errors are averaged over turns. An edge that comes late by a constant
time has an error in proportion to the speed, so each edge of a coarse sensor has two numbers per
direction: error = a + b (speed - that of the first turn).

Each turn is first predicted from those before it. Its readings are corrected only where this leaves
less than half of the mean square error, in several turns in a row. Noise does not repeat and never
passes; neither does a joint that does not turn. The corrections come and go over a turn, mark by
mark on the far side of the shaft, so that the corrected reading does not jump.

A cogging torque makes the speed itself repeat each turn. At one speed it cannot be
distinguished from an error of the sensor. But it shrinks with the square of the speed. So what was
learnt from it predicts no faster turn, and is dropped there. Slower turns are not learnt from.

What repeats in slower turns of a coarse sensor beyond these errors is a ripple of the speed. No
filter can follow it: it is over before its edges have shown it. But the time in each cell is as
long as that in the cell a period before. With cells as much larger as the shaft takes longer for
them the motion is steady, and easy to follow:

    time in a cell = (1 + r) x mean time in a cell,   speed = speed of the steady motion / (1 + r)

The period is the divisor of the marks of a turn that predicts best, and it must predict the newest
cells with less than half of the mean square error that they have without it.

The functions are those of `track` for a joint with a map, whose track has two fields more: `place`
is what each sample needs, and the memory of `sensor_marks`. Angles are in rad, times in s.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.guard import DUPLICATE, USED
from estimator_pkg.driver.sensor_marks import (
    CELL,
    COARSE,
    FORESEEN,
    GIVEN,
    HEADING,
    IN_USE,
    KIND,
    LAG,
    MARKS,
    QUANTUM,
    RUN,
    SHARE,
    SPEED,
    TURN,
    UNIT,
    USED_A,
    USED_B,
    A,
    B,
    Memory,
    begin,
    blank_memory,
    follow,
    interrupt,
    marks_of,
    refined,
    ripple_before,
    turned,
)
from estimator_pkg.driver.track import Track, TrackFunctions, newest
from estimator_pkg.observers.circle import wrap

LARGEST = 1e9  # [rad] no reading is larger
NEAR = 0.1  # of a turn: so near to its interval's end is a reading that wraps
SMALLEST = 0.25  # of its usual time: a ripple makes no cell shorter
FADING = 0.1  # part of the ripple's correction that is put back at each mark
FIELDS = len(Track._fields)  # of a track without a map

# direction in which the cell was entered; what is taken out at that edge [rad]; by how much longer
# than usual the shaft takes for this cell: all of it, and its motion alone, without its edges
Ripple = tuple[float, float, float, float]
# low: lower end of the cell between two marks that contains the reading; size of the cell; error at
# its lower end, and slope over it; the newest reading, and its correction; interval of readings
# that wrap; by how much the angles of the reading reach further than a quantum, above 0: at its
# upper end; the ripple
Place = tuple[float, float, float, float, float, float, float, float, float, Ripple]
STEADY: Ripple = (0.0, 0.0, 0.0, 0.0)
NOWHERE: Place = (0.0, 0.0, 0.0, 0.0, math.nan, 0.0, -math.inf, math.inf, 0.0, STEADY)


def parted(whole: tuple) -> tuple[tuple, Place, Memory]:
    """Return (track without the map, place, memory) of a track with a map."""
    inner, (place, memory) = whole[:FIELDS], whole[FIELDS:]
    return inner, place, memory


def error_of(memory: Memory, cell: int, heading: int, size: float) -> tuple[float, float, float]:
    """Return the error at the lower end of a cell, its slope, and how much it makes it larger.

    A coarse sensor's reading has the error of the edge that brought it.
    """
    course, pace, _, _, tables, _, _, _ = memory
    kind, marks = course[KIND], course[MARKS]
    if marks == 0:
        return 0.0, 0.0, 0.0
    here, beyond = cell % marks, (cell + 1) % marks
    if kind == COARSE:
        table = 1 if heading < 0 else 0
        speed = pace[SPEED] / pace[UNIT] - 1.0 if pace[UNIT] > 0.0 else 0.0
        lower = tables[table, USED_A, here] + speed * tables[table, USED_B, here]
        upper = tables[table, USED_A, beyond] + speed * tables[table, USED_B, beyond]
        return float(upper if heading < 0 else lower), 0.0, float(upper - lower)
    lower = float(tables[0, USED_A, here])
    slope = (float(tables[0, USED_A, beyond]) - lower) / size
    quantum = float(pace[QUANTUM])
    return lower, slope, slope * quantum if quantum < math.inf else 0.0


def follow_ripple(
    ripple: Ripple, memory: Memory, crossed: int, heading: int, size: float, larger: float
) -> Ripple:
    """Return the ripple in the next cell of a coarse sensor, as that of a period ago shows it.

    Edges that come late by turns make cells long and short by turns. A mean of three cells, with
    weights 1, 2, 1, has none of that: it is the shaft's motion.

    Parameters
    ----------
    crossed : marks crossed. heading : direction of the motion.
    larger : by how much the errors of the sensor make the cell larger [rad].
    """
    course, pace, _, _, _, _, _, _ = memory
    way, taken, rise, _ = ripple
    if heading == way:
        taken += heading * size * rise - FADING * taken
    run, lag, share = course[RUN], course[LAG], pace[SHARE]
    if crossed != heading:
        taken = 0.0
    if crossed != heading or heading != course[HEADING] or lag == 0 or run < marks_of(lag):
        return float(heading), taken, 0.0, 0.0
    here = ripple_before(memory, run, lag)
    beside = ripple_before(memory, run - 1, lag) + ripple_before(memory, run + 1, lag)
    rise, motion = share * (here - larger / size), share * (0.5 * here + 0.25 * beside)
    return float(heading), taken, max(rise, SMALLEST - 1.0), max(motion, SMALLEST - 1.0)


def interval(reading: float, before: float, period: float) -> tuple[float, float]:
    """Return the interval of readings that wrap, as two of them show it that lie a turn apart."""
    least = min(reading, before)
    for bottom in (-0.5 * period, 0.0):
        if abs(least - bottom) < NEAR * period:
            return bottom, bottom + period
    return -math.inf, math.inf


def make_mapped(
    bare: TrackFunctions, period: float, quantum: float, foresees: bool
) -> TrackFunctions:
    """Return the driver's functions with the sensor's errors taken out of the readings.

    The observer's known input is by how much more a reading changed than the corrected one; for an
    unchanged one by how much the angles of the reading reach further than a quantum. The speed's
    ripple is taken out of the readings, too, and put back into the estimates.

    Parameters
    ----------
    bare : those without. period : wrap period [rad]. quantum : as given [rad]; 0: not known.
    foresees : the observer takes edges as times, and gains by a ripple that is foreseen.
    """
    half = 0.5 * period
    bare_blank, bare_advance, bare_read, bare_deviation = bare

    def blank(design: tuple) -> tuple:
        """Return a track before its first sample."""
        return bare_blank(design) + (NOWHERE, blank_memory(quantum, foresees))

    def advance(
        track: tuple,
        design: tuple,
        limits: tuple,
        stamp_ns: int,
        measurement: float,
        known_input: float,
    ) -> tuple[tuple, int]:
        """Return (track, verdict) after one sample, like that of `make_track`."""
        inner, before, memory = parted(track)
        low, size, error, slope, reading, corrected_by, bottom, top, further, ripple = before
        correction, cell, heading, offset = corrected_by, 0, 0, measurement - low
        inside = 0.0 <= offset < size
        if inside:
            if measurement != reading:
                correction = error + slope * offset
        elif not -LARGEST < measurement < LARGEST:
            corrected_by = correction = 0.0  # the guard drops it
        elif size == 0.0:
            low, size = begin(memory, measurement, stamp_ns, period, memory[1][GIVEN])
        else:
            course, _, _, _, _, _, _, _ = memory
            if not -half <= offset < half:
                offset = wrap(offset, period)
            if not -half <= measurement - reading < half:
                bottom, top = interval(measurement, reading, period)
            crossed = math.floor(offset / size)
            low = measurement - (offset - crossed * size)
            cell = int(course[CELL]) + crossed
            heading = turned(memory, cell) if crossed != 0 else int(course[HEADING])
            error, slope, larger = error_of(memory, cell, heading, size)
            if course[KIND] == COARSE:
                ripple = follow_ripple(ripple, memory, crossed, heading, size, larger)
                _, taken, rise, _ = ripple
                error += taken
                larger += size * rise - heading * FADING * taken
            further = heading * larger if larger > 0.0 else 0.0
            correction = error + slope * (measurement - low)
        corrected = measurement + correction
        if corrected < bottom:
            corrected += period
        elif corrected >= top:
            corrected -= period
        last_ns, _, _ = newest(inner)
        known = further if measurement == reading else corrected_by - correction
        inner, verdict = bare_advance(inner, design, limits, stamp_ns, corrected, known)
        if verdict >= DUPLICATE:
            return inner + (before, memory), verdict
        place = (low, size, error, slope, measurement, correction, bottom, top, further, ripple)
        if verdict != USED:
            interrupt(memory, verdict)
            if not inside:
                memory[0][CELL] = cell
        elif not inside:
            change = wrap(measurement - reading, period)
            at = (low, size, measurement)
            follow(memory, cell, heading, at, change, last_ns, stamp_ns)
            if refined(memory, period):
                low, size = begin(memory, measurement, stamp_ns, period, memory[1][QUANTUM])
                place = (low, size, 0.0, 0.0, measurement, 0.0, bottom, top, 0.0, STEADY)
        return inner + (place, memory), verdict

    def read(
        track: tuple, design: tuple, limits: tuple, measurement: float, known_input: float
    ) -> tuple:
        """Return the newest estimate, like that of `make_track`."""
        inner, (_, _, _, _, _, correction, bottom, top, further, ripple), _ = parted(track)
        _, taken, _, motion = ripple
        position, velocity, acceleration, status = bare_read(
            inner, design, limits, measurement + correction, further
        )
        if taken == 0.0 and motion == 0.0:
            return position, velocity, acceleration, status
        shaft = position - taken
        if shaft < bottom <= position:
            shaft += period
        elif shaft >= top > position:
            shaft -= period
        faster = 1.0 / (1.0 + motion)
        return shaft, faster * velocity, faster * acceleration, status

    def deviation(track: tuple, design: tuple) -> tuple[float, float]:
        """Return one standard deviation of position and velocity."""
        inner, _, _ = parted(track)
        return bare_deviation(inner, design)

    return TrackFunctions(blank, advance, read, deviation)


def correction_of(track: tuple) -> float:
    """Return what is added to the newest reading [rad]: the sensor's error there, no ripple."""
    if len(track) == FIELDS:
        return 0.0
    _, (_, _, _, _, _, correction, _, _, _, (_, taken, _, _)), _ = parted(track)
    return correction - taken


Errors = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]


def errors_of(track: tuple, heading: int) -> Errors:
    """Return the errors taken out now: (angles as read, speeds) -> those of the marks [rad].

    Both are arrays of shape (n,) [rad, rad/s], and so is what the function returns: the error of
    the mark next to each angle, 0 without a map.

    Parameters
    ----------
    heading : direction of the motion, 1 or -1.
    """

    def nothing(angles: NDArray[np.float64], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.zeros(len(angles))

    if len(track) == FIELDS:
        return nothing
    _, (low, size, _, _, _, _, _, _, _, _), (course, pace, _, _, tables, _, _, _) = parted(track)
    marks, cell, unit = int(course[MARKS]), int(course[CELL]), float(size * pace[UNIT])
    if marks == 0:
        return nothing
    table = tables[1 if course[KIND] == COARSE and heading < 0 else 0].copy()

    def errors(angles: NDArray[np.float64], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
        at = (np.rint((angles - low) / size).astype(np.int64) + cell) % marks
        found: NDArray[np.float64] = table[USED_A, at]
        return found + (np.abs(speeds) / unit - 1.0) * table[USED_B, at] if unit > 0.0 else found

    return errors


def what_is_learnt(track: tuple) -> str:
    """Return what the status of a joint reports of its sensor; '' if nothing is corrected."""
    if len(track) == FIELDS:
        return ''
    _, (low, size, *_), (course, pace, _, _, tables, proofs, _, _) = parted(track)
    marks, ripple = int(course[MARKS]), ''
    if course[FORESEEN] > 0:
        period = math.degrees(size * course[FORESEEN])
        ripple = f'a ripple of the speed that repeats each {period:.4g} deg is foreseen'
    used = [table for table in (0, 1) if proofs[table, IN_USE] > 0.0]
    if not used:
        return ripple
    speed = pace[SPEED] / pace[UNIT] - 1.0 if pace[UNIT] > 0.0 else 0.0
    errors = np.abs(tables[used, A, :marks] + speed * tables[used, B, :marks])
    largest = int(np.argmax(errors.max(axis=0)))
    at = math.degrees((low + (largest - course[CELL]) * size) % (size * marks))
    turn = 'turn' if marks == course[TURN] else f'{math.degrees(size * marks):.4g} deg'
    # coarsely, because a status that changes is published and logged
    taken = (
        f'sensor errors of up to {math.degrees(errors.max()):.1g} deg that repeat each {turn} '
        f'are taken out (largest near {10.0 * round(0.1 * at):.0f} deg)'
    )
    return f'{taken}; {ripple}' if ripple else taken
