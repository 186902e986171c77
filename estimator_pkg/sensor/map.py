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

Both are learnt from blocks of samples (see `learner`), and are taken out from the next block
on. New maps begin without a jump: an offset makes up for it, and fades within two turns. Angles are
in rad, times in s.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from estimator_pkg.circle import LARGEST, wrap
from estimator_pkg.record import record
from estimator_pkg.sensor.guard import AFTER_GAP, AFTER_STRAY_STAMP, DUPLICATE, USED
from estimator_pkg.sensor.learner import Learner

FADING = 0.1  # part of the ripple's correction that is put back at each mark
FADED = 2.0  # turns after which an offset has faded
GONE = 1e-4  # of a cell: a smaller correction of the ripple is none
FORWARD = 0  # rows of the tables
BACKWARD = 1
RISES = 2
MOTIONS = 3


@record
class Place:
    """Where the shaft is among its marks, and what is taken out there."""

    reading: float  # the newest reading [rad]
    correction: float  # what is added to it [rad]
    low: float  # lower end of the cell between two marks that contains the reading [rad]
    size: float  # of the cell [rad]; 0: nothing is taken out
    error: float  # at its lower end [rad]
    slope: float  # of the error over the cell
    further: float  # the angles of a reading reach further than a quantum, above 0: upwards [rad]
    bottom: float  # interval of readings that wrap [rad]
    top: float
    cell: int  # index of the cell
    offset: float  # [rad]
    fade: float  # by how much the offset fades at each mark [rad]
    heading: int  # direction in which the cell was entered
    taken: float  # ripple taken out at the edge that brought the reading [rad]
    rise: float  # by how much longer than usual the shaft takes for this cell: in all,
    motion: float  # and by its motion


@record
class SensorMap:
    """What is taken out of the readings of one joint.

    The tables have for each mark its error in either direction [rad], and by how much longer than
    usual the shaft takes for each cell: all of it but the sensor's errors, and its motion alone.
    """

    active: bool  # there is one
    period: float  # wrap period [rad]
    place: Place
    coarse: bool  # the marks are edges
    quantum: float  # [rad]; 0: not known
    doubt: float  # 1: it may be motion, no other speed has shown it yet; 0: it is the sensor's
    way: int  # direction in which a ripple is foreseen; 0: none
    marks: int  # of a turn
    tables: Annotated[list[list[float]], 4, 128]


def leave_place(place: Place, reading: float) -> None:
    """Take nothing out until a next map is set."""
    place.reading, place.correction = reading, 0.0
    place.low = place.size = place.error = place.slope = place.further = 0.0
    place.bottom, place.top = -math.inf, math.inf
    place.cell, place.offset, place.fade = 0, 0.0, 0.0
    set_ripple(place, 1, 0.0, 0.0, 0.0)


def set_ripple(place: Place, heading: int, taken: float, rise: float, motion: float) -> None:
    """Set what is foreseen of a ripple in this cell."""
    place.heading, place.taken, place.rise, place.motion = heading, taken, rise, motion


def set_map(sensor: SensorMap, learner: Learner) -> None:
    """Use what is learnt now; no map where nothing is taken out."""
    shaft, place = learner.shaft, sensor.place
    maps = shaft.maps()
    if not sensor.active:
        leave_place(place, 0.0)
    marks, size = maps.tables.shape[1], maps.size
    settled = place.offset == 0.0 and abs(place.taken) < GONE * size
    if marks == 0 or (not shaft.active and settled):
        learner.applied = sensor.active = False
        return
    used = sensor.way != 0 or any(any(row[: sensor.marks]) for row in sensor.tables)
    if learner.applied and not shaft.active and not used:
        return
    learner.applied = sensor.active = True
    cell, heading = math.floor(shaft.at), shaft.heading or 1
    inside = (shaft.at - cell) * size
    table = maps.tables[BACKWARD if maps.coarse and heading < 0 else FORWARD]
    lower, upper = float(table[cell % marks]), float(table[(cell + 1) % marks])
    place.slope = 0.0 if maps.coarse else (upper - lower) / size
    place.error = place.correction - place.slope * inside
    place.offset = place.error - place.taken - (upper if maps.coarse and heading < 0 else lower)
    place.fade = max(place.fade, abs(place.offset) / (FADED * marks))
    place.reading, place.low, place.size = shaft.reading, shaft.reading - inside, size
    place.bottom, place.top = shaft.bottom, shaft.top
    place.cell, place.heading = cell, heading
    sensor.coarse, sensor.quantum, sensor.doubt = bool(maps.coarse), maps.quantum, maps.doubt
    sensor.way, sensor.marks = maps.way, marks
    for row, values in zip(sensor.tables, maps.tables.tolist()):
        row[:marks] = values


def enter(sensor: SensorMap, measurement: float) -> None:
    """Enter another cell. The reading of a coarse sensor has its edge's error."""
    place, marks, period = sensor.place, sensor.marks, sensor.period
    size, offset = place.size, place.offset
    shift = measurement - place.low
    if not -0.5 * period <= shift < 0.5 * period:
        shift = wrap(shift, period)
    crossed = int(math.floor(shift / size))  # noqa: RUF046  (C has a float)
    place.low = measurement - (shift - crossed * size)
    place.cell += crossed
    now = 1 if crossed > 0 else -1
    here, beyond = place.cell % marks, (place.cell + 1) % marks
    row = BACKWARD if sensor.coarse and now < 0 else FORWARD
    lower, upper = sensor.tables[row][here], sensor.tables[row][beyond]
    fade = place.fade
    faded = max(offset - fade, 0.0) if offset > 0.0 else min(offset + fade, 0.0)
    place.offset = faded
    if not sensor.coarse:
        first, last = offset, faded
        if now < 0:
            first, last = faded, offset
        place.slope = (upper + last - lower - first) / size
        place.further = now * place.slope * sensor.quantum if place.slope > 0.0 else 0.0
        place.error = lower + first
        set_ripple(place, 1, 0.0, 0.0, 0.0)
        return
    taken, rise, motion = place.taken, 0.0, 0.0
    if crossed == now and now == place.heading:
        taken = taken + now * size * place.rise - FADING * taken
    else:
        taken = 0.0
    if crossed == now and now == sensor.way:
        rise, motion = sensor.tables[RISES][here], sensor.tables[MOTIONS][here]
    place.error = (upper if now < 0 else lower) + faded + taken
    larger = upper - lower + size * rise - now * FADING * taken
    place.further = now * larger if larger > 0.0 else 0.0
    place.slope = 0.0
    set_ripple(place, now, taken, rise, motion)


def correct_reading(sensor: SensorMap, measurement: float) -> tuple[float, float]:
    """Return a reading without the sensor's errors [rad], and the observer's known input.

    That is by how much more the reading changed than the corrected one; for an unchanged one by how
    much the angles of the reading reach further than a quantum.
    """
    place = sensor.place
    correction, known = place.correction, place.further
    if measurement != place.reading:
        inside = 0.0 <= measurement - place.low < place.size or place.size == 0.0
        if not inside and -LARGEST < measurement < LARGEST:  # else the guard drops it
            enter(sensor, measurement)
        before = correction
        correction = place.error + place.slope * (measurement - place.low)
        known = before - correction
    place.correction = correction
    corrected = measurement + correction
    if corrected < place.bottom:
        corrected += sensor.period
    elif corrected >= place.top:
        corrected -= sensor.period
    return corrected, known


def follow_verdict(place: Place, before: Place, verdict: int, measurement: float) -> None:
    """Keep the place after a sample that was used; a dropped one does not change it."""
    if verdict == USED or verdict == AFTER_GAP or verdict == AFTER_STRAY_STAMP:
        place.reading = measurement
    elif verdict >= DUPLICATE:
        place.take(before)
    else:
        leave_place(place, measurement)


def put_back(sensor: SensorMap, out: Any) -> None:
    """Put the ripple of the speed back into an estimate of the steady motion."""
    place = sensor.place
    if place.taken == 0.0 and place.motion == 0.0:
        return
    position = out.position
    shaft = position - place.taken
    if shaft < place.bottom <= position:
        shaft += sensor.period
    elif shaft >= place.top and place.top > position:
        shaft -= sensor.period
    faster = 1.0 / (1.0 + place.motion)
    out.position = shaft
    out.velocity *= faster
    out.acceleration *= faster


def widen(sensor: SensorMap, out: Any, speed: float) -> None:
    """Widen a deviation by what is taken out and may be motion.

    Parameters
    ----------
    speed : estimated without the sensor's errors [rad/s].
    """
    of_angle = sensor.doubt * sensor.place.correction
    of_speed = sensor.doubt * sensor.place.slope * speed
    out.position = math.sqrt(out.position * out.position + of_angle * of_angle)
    out.velocity = math.sqrt(out.velocity * out.velocity + of_speed * of_speed)
