# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a header of an observer of one angle has: `driver.channel` for one sample.

The engine translates these functions. `export.header` binds the arguments `wrapped` and `counted`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from estimator_pkg.driver.channel import Frame, Track, advance, reset_track, use_frame
from estimator_pkg.estimate import INITIALISING, MISCONFIGURED, Deviation
from estimator_pkg.estimate import Estimate as Motion
from estimator_pkg.record import record
from estimator_pkg.sensor.faults import (
    EncoderFaults,
    begin_faults,
    examine_step,
    forget_motion,
    inflate,
    is_usual,
)
from estimator_pkg.sensor.guard import DUPLICATE, USED_SAMPLE, Limits
from estimator_pkg.sensor.holds import shown_speed, unshown_speed
from estimator_pkg.sensor.turns import Turns, begin_turns, follow_turns, is_news


@record
class Options:
    """What the settings decide."""

    turns: bool  # the joint may go on without a circle


@record
class State:
    """One joint: its clock, its readings, its motion. Call init first."""

    options: Options
    design: observer.Design  # type: ignore[name-defined]  # noqa: F821  (bound by the translation)
    limits: Limits
    track: Track
    turns: Turns  # whether the sensor counts turns
    faults: EncoderFaults  # of the encoder, as its readings show them
    # samples by verdict: used, first, after a gap, clock jump, stray stamp, outage; and dropped:
    # duplicate, late, non-finite, zero stamp, misconfigured, repeated
    counts: Annotated[list[int], 12]


@record
class Estimate:
    """The estimate at the newest sample that was used; NaN: there is none."""

    position: float  # [rad or m], in the convention of the measurement
    velocity: float  # [rad/s or m/s]
    acceleration: float  # [rad/s^2 or m/s^2]; NaN: the observer gives none
    position_stddev: float  # one standard deviation [rad or m]
    velocity_stddev: float  # [rad/s or m/s], calibrated
    status: int  # 0 initialising, 1 tracking, 2 coasting, 5 misconfigured; use 1 and 2


def init(observer: Any, self: State, wrapped: Frame) -> None:
    """Set everything before the first sample."""
    blank = State()
    self.take(blank)
    if self.options.turns:
        begin_turns(self.turns, wrapped.period)
    use_frame(self, wrapped)
    reset_track(observer, self.track, self.design)
    begin_faults(self.faults)


def update(
    observer: Any, self: State, stamp_ns: int, angle: float, wrapped: Frame, counted: Frame
) -> bool:
    """Take one sample; return True if it was used, False if it was dropped and counted.

    Parameters
    ----------
    stamp_ns : when the angle was measured [ns], above 0, of any clock that only moves forward.
    angle : [rad or m].
    """
    if self.options.turns:
        if is_news(self.turns, angle):
            if follow_turns(self.turns, stamp_ns, angle):
                if self.turns.counts:
                    use_frame(self, counted)
                else:
                    use_frame(self, wrapped)
    verdict = advance(observer, self.track, self.design, self.limits, stamp_ns, angle, 0.0)
    if verdict == USED_SAMPLE:
        if not is_usual(self.faults, angle, stamp_ns):
            examine_step(self.faults, angle, self.track.clock, self.limits.period)
    elif verdict < DUPLICATE:
        forget_motion(self.faults, angle)
    self.counts[verdict] += 1
    return verdict < DUPLICATE


def get(observer: Any, self: State, out: Estimate) -> None:
    """Set the estimate at the newest sample that was used."""
    track = self.track
    out.position = out.velocity = out.acceleration = math.nan
    out.position_stddev = out.velocity_stddev = math.nan
    out.status = INITIALISING
    if not track.clock.running:
        return
    deviation = Deviation()
    observer.deviation(
        observer, deviation, track.state, track.coefficients, self.design, track.calibration.scale
    )
    out.position_stddev, out.velocity_stddev = deviation.position, deviation.velocity
    if track.clock.mean_dt > self.limits.longest_dt:
        out.status = MISCONFIGURED
        return
    motion = Motion()
    observer.estimate(
        observer, motion, track.state, track.coefficients, self.design, track.reading, 0.0
    )
    holds, last_ns = track.holds, track.clock.last_ns
    if holds.leap > 0.0:
        motion.velocity = shown_speed(holds, last_ns, motion.velocity)
    if holds.unchanged > 0 or holds.leap > 0.0:
        least = unshown_speed(holds, last_ns, motion.velocity)
        deviation.velocity = max(deviation.velocity, least)
    if self.faults.doubted:
        inflate(self.faults, deviation, motion.velocity)
    out.velocity_stddev = deviation.velocity
    out.position, out.velocity = motion.position, motion.velocity
    out.acceleration, out.status = motion.acceleration, motion.status
