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

A torque that depends on the angle makes the speed itself repeat each turn. At one speed it cannot
be distinguished from an error of a fine sensor. But an eccentric sensor errs with the turn and half
of it, by few degrees, and poles and slots ripple faster. So at one speed only the first two
harmonics are taken out. They must be small, and they must leave less than half of the mean square
error. The standard deviation covers what may be motion. A motion changes with the square of the
speed. So no faster turn is corrected until one has shown that it is predicted. A turn at another
speed that is predicted shows that the errors are the sensor's, and its other harmonics if they are
predicted, too. A faster one that is not shows a motion: from then on nothing is taken out before
two speeds agree. Slower turns are not learnt from.

What repeats in slower turns of a coarse sensor beyond these errors is a ripple of the speed. No
filter can follow it: it is over before its edges have shown it. But the time in each cell is as
long as that in the cell a period before. With cells as much larger as the shaft takes longer for
them the motion is steady, and easy to follow:

    time in a cell = (1 + r) x mean time in a cell,   speed = speed of the steady motion / (1 + r)

The period is the divisor of the marks of a turn that predicts best, and it must predict the newest
cells with less than half of the mean square error that they have without it.

Both are learnt from blocks of samples (see `sensor_blocks`), and are taken out from the next block
on. Only a joint with such errors has the functions of `make_mapped`, and a track with four fields
more: the reading, its correction, its `Place` and the `Maps`. So where nothing is learnt, nothing
changes. New maps begin without a jump: an offset makes up for it, and fades within two turns.
Angles are in rad, times in s.
"""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg.driver.guard import AFTER_GAP, AFTER_STRAY_STAMP, DUPLICATE, USED
from estimator_pkg.driver.sensor_blocks import Learner
from estimator_pkg.driver.sensor_table import BACKWARD, FORWARD, MOTIONS, RISES
from estimator_pkg.driver.track import Track, TrackFunctions
from estimator_pkg.observers.circle import LARGEST, wrap

FADING = 0.1  # part of the ripple's correction that is put back at each mark
FADED = 2.0  # turns after which an offset has faded
GONE = 1e-4  # of a cell: a smaller correction of the ripple is none
FIELDS = len(Track._fields)  # of a track without a map
ANY = (0.0, 0.0, 0.0, math.inf)  # limits of `make_track` that no sample reaches

# direction in which the cell was entered; what is taken out at the edge that brought the reading
# [rad]; by how much longer than usual the shaft takes for this cell: in all, and by its motion
Ripple = tuple[int, float, float, float]
# low: lower end of the cell between two marks that contains the reading; its size, 0: nothing is
# taken out; error at its lower end, and slope over it; by how much the angles of the reading reach
# further than a quantum, above 0: at its upper end; interval of readings that wrap; index of the
# cell; offset, and by how much it fades at each mark; the ripple
Place = tuple[float, float, float, float, float, float, float, int, float, float, Ripple]
STEADY: Ripple = (1, 0.0, 0.0, 0.0)
NOWHERE: Place = (0.0, 0.0, 0.0, 0.0, 0.0, -math.inf, math.inf, 0, 0.0, 0.0, STEADY)


def placed(whole: tuple, learner: Learner) -> tuple:
    """Return the track with what is learnt now; without maps where nothing is taken out."""
    shaft, place, corrected_by = learner.shaft, NOWHERE, 0.0
    maps = shaft.maps()
    if len(whole) > FIELDS:
        _, corrected_by, place, before = whole[FIELDS:]
    _, _, _, _, further, _, _, _, offset, fade, (_, taken, rise, motion) = place
    marks, size = maps.tables.shape[1], maps.size
    if marks == 0 or (not shaft.active and offset == 0.0 and abs(taken) < GONE * size):
        learner.applied = False
        return whole[:FIELDS]
    if learner.applied and not shaft.active and not any(map(np.any, before[4:])):
        return whole
    learner.applied = True
    cell, heading = math.floor(shaft.at), shaft.heading or 1
    inside = (shaft.at - cell) * size
    table = maps.tables[BACKWARD if maps.coarse and heading < 0 else FORWARD]
    lower, upper = float(table[cell % marks]), float(table[(cell + 1) % marks])
    slope = 0.0 if maps.coarse else (upper - lower) / size
    error = corrected_by - slope * inside
    offset = error - taken - (upper if maps.coarse and heading < 0 else lower)
    place = (
        shaft.reading - inside,
        size,
        error,
        slope,
        further,
        shaft.bottom,
        shaft.top,
        cell,
        offset,
        max(fade, abs(offset) / (FADED * marks)),
        (heading, taken, rise, motion),
    )
    return whole[:FIELDS] + (shaft.reading, corrected_by, place, tuple(maps))


def entered(place: Place, maps: tuple, measurement: float, period: float) -> Place:
    """Return the place in another cell. The reading of a coarse sensor has its edge's error."""
    low, size, _, _, _, bottom, top, cell, offset, fade, (heading, taken, rise, _) = place
    coarse, _, quantum, _, way, tables = maps
    shift = measurement - low
    if not -0.5 * period <= shift < 0.5 * period:
        shift = wrap(shift, period)
    crossed, marks = math.floor(shift / size), tables.shape[1]
    low = measurement - (shift - crossed * size)
    cell += crossed
    now = 1 if crossed > 0 else -1
    here, beyond = cell % marks, (cell + 1) % marks
    row = BACKWARD if coarse and now < 0 else FORWARD
    lower, upper = float(tables[row, here]), float(tables[row, beyond])
    faded = max(offset - fade, 0.0) if offset > 0.0 else min(offset + fade, 0.0)
    if not coarse:
        first, last = (offset, faded) if now > 0 else (faded, offset)
        slope = (upper + last - lower - first) / size
        further = now * slope * quantum if slope > 0.0 else 0.0
        error = lower + first
        return low, size, error, slope, further, bottom, top, cell, faded, fade, STEADY
    taken = taken + now * size * rise - FADING * taken if crossed == now == heading else 0.0
    rise = motion = 0.0
    if crossed == now and now == way:
        rise, motion = float(tables[RISES, here]), float(tables[MOTIONS, here])
    error = (upper if now < 0 else lower) + faded + taken
    larger = upper - lower + size * rise - now * FADING * taken
    further = now * larger if larger > 0.0 else 0.0
    ripple = (now, taken, rise, motion)
    return low, size, error, 0.0, further, bottom, top, cell, faded, fade, ripple


def make_mapped(bare: TrackFunctions, period: float) -> TrackFunctions:
    """Return the driver's functions with the sensor's errors taken out of the readings.

    The observer's known input is by how much more a reading changed than the corrected one; for an
    unchanged one by how much the angles of the reading reach further than a quantum. The speed's
    ripple is taken out of the readings, too, and put back into the estimates.

    Parameters
    ----------
    bare : those without. period : wrap period [rad].
    """
    bare_blank, bare_advance, bare_read, bare_deviation = bare

    def advance(
        whole: tuple,
        design: tuple,
        limits: tuple,
        stamp_ns: int,
        measurement: float,
        known_input: float,
    ) -> tuple[tuple, int]:
        """Return (track, verdict) after one sample, like that of `make_track`."""
        reading, corrected_by, place, maps = whole[FIELDS:]
        low, size, error, slope, known, bottom, top, _, _, _, _ = now = place
        correction = corrected_by
        if measurement != reading:
            inside = 0.0 <= measurement - low < size or size == 0.0
            if not inside and -LARGEST < measurement < LARGEST:  # else the guard drops it
                now = entered(place, maps, measurement, period)
                low, _, error, slope, _, _, _, _, _, _, _ = now
            correction = error + slope * (measurement - low)
            known = corrected_by - correction
        corrected = measurement + correction
        if corrected < bottom:
            corrected += period
        elif corrected >= top:
            corrected -= period
        inner, verdict = bare_advance(whole[:FIELDS], design, limits, stamp_ns, corrected, known)
        if verdict == USED or verdict == AFTER_GAP or verdict == AFTER_STRAY_STAMP:
            return inner + (measurement, correction, now, maps), verdict
        if verdict >= DUPLICATE:
            return inner + (reading, corrected_by, place, maps), verdict
        return inner + (measurement, 0.0, NOWHERE, maps), verdict

    def read(
        whole: tuple, design: tuple, limits: tuple, measurement: float, known_input: float
    ) -> tuple:
        """Return the newest estimate, like that of `make_track`."""
        _, correction, place, _ = whole[FIELDS:]
        _, _, _, _, further, bottom, top, _, _, _, (_, taken, _, motion) = place
        position, velocity, acceleration, status = bare_read(
            whole[:FIELDS], design, limits, measurement + correction, further
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

    def deviation(whole: tuple, design: tuple) -> tuple[float, float]:
        """Return one standard deviation of position and velocity.

        What is taken out may be motion while no other speed has shown that it is the sensor's.
        """
        position, velocity = bare_deviation(whole[:FIELDS], design)
        reading, correction, place, (_, _, _, doubt, _, _) = whole[FIELDS:]
        _, _, _, slope, _, _, _, _, _, _, _ = place
        if doubt == 0.0 or slope == 0.0:
            return position, velocity
        _, speed, _, _ = bare_read(whole[:FIELDS], design, ANY, reading + correction, 0.0)
        of_angle, of_speed = doubt * correction, doubt * slope * speed
        return (
            math.sqrt(position * position + of_angle * of_angle),
            math.sqrt(velocity * velocity + of_speed * of_speed),
        )

    return TrackFunctions(bare_blank, advance, read, deviation)


def correction_of(whole: tuple) -> float:
    """Return what is added to the newest reading [rad]: the sensor's error there, no ripple."""
    if len(whole) == FIELDS:
        return 0.0
    _, correction, (_, _, _, _, _, _, _, _, _, _, (_, taken, _, _)), _ = whole[FIELDS:]
    return float(correction - taken)
