# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Readings in doubt: one reading alone, far from the prediction, is not believed.

It may be a glitch, a sample that was lost or held, or a blow. Meanwhile the speed is held, and the
next reading that differs from it decides:

- It is back at the prediction: the doubted one was alone, and leaves nothing.
- It is off, too, to the same side: the motion goes on from it, with the line through both. After a
  lost or a held sample that line has the speed of before (the angle slips), after a blow the new
  one.

One equal to the doubted reading decides nothing: a sensor that fails for several samples, or is
read more often than it measures, publishes the same value again.
"""

from __future__ import annotations

from typing import Any

from estimator_pkg.circle import wrap
from estimator_pkg.estimate import COASTING, INITIALISING, TRACKING
from estimator_pkg.observers.angle.edge import bandwidth, preference
from estimator_pkg.observers.angle.edge.constants import ALARM, CONFIRMED, NOISE_SAMPLES
from estimator_pkg.observers.angle.edge.start import RESTS
from estimator_pkg.record import record

AGREES = 0.5  # a reading is off, too, from this part of the doubted one's distance on
MANOEUVRES = 0.25  # square of the acceleration that a blow may leave, over that of the blow


@record
class Tracking:
    """Whether the readings are those of the shaft."""

    status: int
    count: float  # samples since a start, a gap or a doubt
    off: float  # distance of the doubted reading from its prediction [rad]; 0: none is in doubt
    jumped: bool  # it was no stop: against the predicted motion, or beyond it
    waited: float  # time since it came [s]
    spoilt: float  # samples whose third differences contain a wrong reading


def coast(state: Any, dt: float) -> None:
    """Go on with the speed as it was: the reading is not believed."""
    motion, tracking, reading = state.motion, state.tracking, state.reading
    motion.angle = reading.angle - reading.innovation
    motion.velocity -= motion.acceleration * dt
    if tracking.status != INITIALISING:
        tracking.status = COASTING
    tracking.count = 0.0
    if tracking.off == 0.0:
        tracking.off, tracking.waited = reading.innovation, 0.0
        way = reading.predicted_motion
        tracking.jumped = not 0.0 <= reading.change * way <= way * way


def repeats(state: Any) -> bool:
    """Return True if this reading is the doubted one again, of a shaft that has not stopped."""
    return bool(state.tracking.jumped and state.reading.change == 0.0)


def is_spoilt(state: Any, design: Any, dt: float) -> bool:
    """Return True if the last three changes of the reading contain one that was wrong."""
    tracking, reading, motion = state.tracking, state.reading, state.motion
    if tracking.off != 0.0:
        distance = wrap(reading.angle - motion.angle - motion.velocity * dt, design.period)
        slipped = wrap(distance - tracking.off, design.period)
        nearest = min(abs(distance), abs(slipped))  # else it was a blow
        is_wrong = nearest < AGREES * abs(tracking.off) or repeats(state)
        tracking.spoilt = 3.0 if is_wrong else 0.0
    elif tracking.spoilt > 0.0:
        tracking.spoilt -= 1.0
    return tracking.spoilt > 0.0


def decide(state: Any, design: Any, dt: float) -> bool:
    """Take a reading after a doubted one; return True if that is all that it shows."""
    tracking, reading = state.tracking, state.reading
    innovation, off = reading.innovation, tracking.off
    tracking.waited += dt
    if repeats(state) and tracking.waited < RESTS:
        coast(state, dt)
        return True
    tracking.off = 0.0
    if abs(innovation) < AGREES * abs(off):
        bandwidth.reset_sums(state.process_noise)
        return False
    moved = wrap(innovation - off, design.period)
    opposite = (off + moved) * off < 0.0
    # a line needs readings that changed and did not come in a burst
    if reading.change == 0.0 or opposite or 2.0 * dt < state.sensor.mean_sample_time:
        return False
    begin_anew(state, moved, tracking.waited)
    return True


def begin_anew(state: Any, moved: float, dt: float) -> None:
    """Go on with the line through this reading and the doubted one.

    Parameters
    ----------
    moved : from the doubted reading to this one, beyond what the speed explains [rad].
    dt : time between them [s].
    """
    motion, p, process, sensor = state.motion, state.p, state.process_noise, state.sensor
    rate = 1.0 / dt
    jump = moved * rate
    r = sensor.quantum * sensor.quantum / 12.0 + sensor.noise
    motion.angle, motion.idle = state.reading.angle, 0.0
    motion.velocity += jump
    p.p22 += MANOEUVRES * jump * rate * jump * rate
    p.p12 = 0.5 * p.p22 * dt
    p.p11 = 2.0 * r * rate * rate + jump * jump
    p.p00, p.p01, p.p02 = r, r * rate, 0.0
    process.mean_nis += (ALARM * ALARM - process.mean_nis) / NOISE_SAMPLES
    bandwidth.reset_cusum(process)
    bandwidth.reset_velocity_walk(state.velocity_walk)
    preference.reset_second_filter(state.second)
    confirm(state.tracking, p.p11, dt, 12.0 * r)


def confirm(tracking: Tracking, p11: float, dt: float, floor: float) -> None:
    """Count one more believed reading of a start, a gap or a doubt.

    Parameters
    ----------
    p11 : variance of the speed. floor : twelve times the variance of a reading [rad^2].
    """
    tracking.count += 1.0
    if tracking.count >= CONFIRMED and p11 * dt * dt < floor:
        tracking.status = TRACKING
