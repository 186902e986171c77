# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A start: the time after a shaft at rest began to move, or after a gap.

The core still carries the old speed, so it errs by more than noise explains until its errors have
decayed. `deviation` is what this adds to the standard deviation of the speed; docs/evidence.md
derives it.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.circle import wrap
from estimator_pkg.record import record

REST_SAMPLES = 32.0  # samples over which a rest is averaged, and the power of recent innovations
REST_TIME = 0.12  # [s] within the noise of one angle: the shaft rests, and may start
LASTS = 0.25  # [s] that a start lasts at least, ...
DECAYED = 10.0  # ... and nepers by which the errors of the core must have decayed
TAIL_NEPERS = 1.18  # of these nepers, where the polynomial before the exponential is generous
LEARNT = 6.0  # nepers after which innovations of a start show the noise again
BEGUN = 0.75  # sample times by which motion may have begun after the last reading at rest
FIRST_READING_PART = 0.95  # the same at the first reading, which shows no speed at all
REST_GATE = 10.0  # (3.2)^2: times the power of the innovations; a larger distance is no rest
LARGEST_GAIN = 8.0  # of innovations over readings, in noise power, but for a few first samples
REST_SHOWN_SAMPLES = 12.0  # without a larger distance, after which a rest has shown its noise
SLOW = 4.0  # (2)^2: times the variance of the speed's noise; a faster joint is not at rest
FIVE = 25.0  # (5)^2: five standard deviations cover an error
REST_MARGIN = 1.001  # times the largest distance within a rest: a reading beyond it ends the rest


@record
class Start:
    """A start that is in force, or the rest that it may begin at."""

    # time since the motion began while a start is in force, 0 in motion, and below 0 while the
    # readings stay within the noise of one angle: minus the time at rest until the last change [s]
    clock: float
    anchor: float  # angle of the rest before [rad]
    reach: float  # largest distance from it within the rest [rad]
    decay: float  # nepers by which the errors of the core decayed
    travelled: float  # angle since then [rad]
    changes: float  # at rest: mean square of the changes of the reading [rad^2]
    kept: float  # speed that was kept across a gap [rad/s]


def set_start(
    start: Start,
    clock: float,
    anchor: float,
    reach: float,
    decay: float,
    travelled: float,
    kept: float,
) -> None:
    """Set a start; at rest nothing has travelled, and changes are averaged anew."""
    start.clock, start.anchor, start.reach, start.decay = clock, anchor, reach, decay
    start.travelled, start.changes, start.kept = travelled, 0.0, kept


def rest(
    observer: Any,
    start: Start,
    core: Any,
    coefficients: Any,
    design: Any,
    measurement: float,
    moved: float,
    since: float,
    power: float,
    dt: float,
) -> None:
    """Take a reading that changed while no start is in force: the shaft rests, moves, or starts.

    Parameters
    ----------
    moved : change of the reading [rad], unchanged for `since` [s] before.
    power : recent one of the innovations [rad^2].
    """
    period = design.shared.period
    half = 0.5 * period if period > 0.0 else math.inf
    clock = start.clock
    if clock == 0.0:
        start.anchor, start.reach, start.changes = measurement - moved, abs(moved), 0.0
    distance = measurement - start.anchor
    if not -half <= distance < half:
        distance = wrap(distance, period)
    square, band, rested = distance * distance, REST_GATE * power, since - clock
    changes = start.changes
    changes += (moved * moved - changes) / (REST_SAMPLES if changes > 0.0 else 1.0)
    beyond = abs(distance) > REST_MARGIN * start.reach
    reach = max(start.reach, abs(distance))
    begins = False
    if rested < REST_TIME or rested < REST_SHOWN_SAMPLES * dt:
        # white noise of variance R changes by 2 R; innovations may be those of a lag
        if square > band or square > REST_GATE * 0.5 * changes:
            set_start(start, 0.0, measurement, 0.0, 0.0, 0.0, 0.0)
            return
        if beyond:
            rested = 0.0
    elif beyond:
        begins = True
    # of noise alone the innovations have more power than the readings
    elif LARGEST_GAIN * square > band:
        of_position, of_velocity, of_innovation = observer.noise_gains(core, coefficients, design)
        begins = square * of_innovation > band
    if begins:
        set_start(start, dt, start.anchor, reach, 0.0, distance, 0.0)
        return
    start.clock, start.reach, start.changes = -rested - dt, reach, changes
    start.anchor += distance / REST_SAMPLES
    start.decay = start.kept = 0.0


def follow_start(
    observer: Any,
    start: Start,
    core: Any,
    coefficients: Any,
    design: Any,
    moved: float,
    since: float,
    power: float,
    dt: float,
) -> None:
    """Take a reading while a start is in force.

    It is over when it is old and the errors have decayed, when the shaft rests again, and when it
    only swayed. While the reading is back in the noise of the rest, though the speed is not, the
    motion may begin at any time. Parameters as of `rest`.
    """
    before = start.travelled
    travelled, pace = before + moved, observer.pace(observer, core, coefficients, design, dt)
    if start.kept == 0.0:
        within = math.sqrt(REST_GATE * power)
        if abs(travelled) <= within:  # back where it was ...
            of_position, of_velocity, of_innovation = observer.noise_gains(
                core, coefficients, design
            )
            speed = core.velocity
            if moved == 0.0 or speed * speed * of_innovation <= SLOW * power * of_velocity:
                set_start(start, -REST_TIME, start.anchor, start.reach, 0.0, 0.0, 0.0)
                return
            if start.decay < 1.0:
                decay = start.decay + pace * dt
                set_start(start, 2.0 * dt, start.anchor, start.reach, decay, travelled, 0.0)
                return
        elif abs(before) <= within and start.decay < 1.0:
            set_start(start, dt, start.anchor, start.reach, 0.0, travelled, 0.0)
            return
    if moved == 0.0 and since >= REST_TIME and start.decay >= LEARNT:
        set_start(start, 0.0, start.anchor, 0.0, 0.0, 0.0, 0.0)
        return
    start.clock += dt
    start.decay += pace * dt
    start.travelled = travelled
    if start.clock >= LASTS and start.decay >= DECAYED:
        set_start(start, 0.0, start.anchor, 0.0, 0.0, 0.0, 0.0)


def start_deviation(start: Start, speed: float, dt: float, quantum: float, lag: float) -> float:
    """Return the standard deviation of the speed that a start adds [rad/s].

    Parameters
    ----------
    speed : of the core [rad/s].
    lag : standard deviation of the velocity error at the begin and the end of a ramp of speed, in
        acceleration/pace: a fifth of the error itself, so that five cover it.
    """
    clock, decay = start.clock, start.decay
    mean = start.travelled / (clock - (BEGUN if clock > dt else FIRST_READING_PART) * dt)
    scale = 2.0 * abs(mean)
    if start.kept > scale:
        scale = start.kept
    # docs/evidence.md (1): what is left of a step of the speed
    left = 0.5 * scale * (1.0 + decay * (1.0 + decay)) * math.exp(-TAIL_NEPERS * decay)
    # docs/evidence.md (2): what a ramp of the speed leaves
    change = abs(speed - mean)
    if decay > LEARNT:  # the first term no longer covers a motion that began earlier
        change += abs(mean) * BEGUN * dt / clock
    bend = 2.0 * lag * change
    if decay > 1.0:
        bend /= decay
    square = left * left + bend * bend
    # docs/evidence.md (5): a ramp through a whole number of quanta per sample
    if decay > LEARNT and quantum > 0.0:
        repeats, pace = 4.0 * quantum * change / clock, quantum * decay / clock
        if repeats < pace * pace:
            beyond = wrap(speed, quantum / dt)
            if beyond * beyond < repeats:
                square += repeats / FIVE
    return math.sqrt(square)
