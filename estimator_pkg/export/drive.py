# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a header of a drive's observer has: `driver.drive_channel` for one sample."""

from __future__ import annotations

import math
from typing import Annotated, Any

from estimator_pkg.driver.channel import Track, advance, reset_track
from estimator_pkg.driver.drive_channel import LONGEST_COAST
from estimator_pkg.estimate import INITIALISING, MISCONFIGURED, Deviation
from estimator_pkg.estimate import Estimate as Motion
from estimator_pkg.observers.pmsm.drive import DriveSample, Electrical, ElectricalDeviation
from estimator_pkg.record import record
from estimator_pkg.sensor.guard import AFTER_GAP, DUPLICATE, Limits


@record
class State:
    """One drive: its clock, its samples, its motion. Call init first."""

    design: observer.Design  # type: ignore[name-defined]  # noqa: F821  (bound by the translation)
    limits: Limits
    track: Track
    # samples by verdict: used, first, after a gap, clock jump, stray stamp, outage; and dropped:
    # duplicate, late, non-finite, zero stamp, misconfigured, repeated
    counts: Annotated[list[int], 12]
    taken: DriveSample  # the newest sample
    used: DriveSample  # the newest one that was used


@record
class Estimate:
    """The estimate at the newest sample that was used; NaN: there is none."""

    position: float  # mechanical [rad]
    velocity: float  # [rad/s]
    angle: float  # electrical [rad]
    speed: float  # [rad/s]
    flux: float  # flux linkage [Wb]
    position_stddev: float  # one standard deviation of each
    velocity_stddev: float
    angle_stddev: float
    speed_stddev: float
    flux_stddev: float
    status: int  # 0 initialising, 1 tracking, 2 coasting, 4 not observable, 5 misconfigured


def init(observer: Any, self: State, tuned: observer.Design) -> None:  # type: ignore[name-defined]  # noqa: F821
    """Set everything before the first sample."""
    blank = State()
    nothing = DriveSample()
    self.take(blank)
    self.design.take(tuned)
    reset_track(observer, self.track, self.design)
    observer.start(observer, self.track.state, self.design, nothing)


def update(
    observer: Any,
    self: State,
    stamp_ns: int,
    i_alpha: float,
    i_beta: float,
    u_alpha: float,
    u_beta: float,
) -> bool:
    """Take one sample; return True if it was used, False if it was dropped and counted.

    Parameters
    ----------
    stamp_ns : when the current was measured [ns], above 0, of any clock that only moves forward.
    i_alpha, i_beta : current at the stamp [A].
    u_alpha, u_beta : mean voltage over the interval that ends at the stamp [V].
    """
    taken, track = self.taken, self.track
    taken.i_alpha, taken.i_beta, taken.u_alpha, taken.u_beta = i_alpha, i_beta, u_alpha, u_beta
    last_ns = track.clock.last_ns
    verdict = advance(observer, track, self.design, self.limits, stamp_ns, taken, 0.0)
    self.counts[verdict] += 1
    if verdict < DUPLICATE:
        self.used.take(taken)
        if verdict == AFTER_GAP and stamp_ns - last_ns <= LONGEST_COAST:
            observer.coast(track.state, (stamp_ns - last_ns) * 1e-9)
    return verdict < DUPLICATE


def get(observer: Any, self: State, out: Estimate) -> None:
    """Set the estimate at the newest sample that was used."""
    track, design = self.track, self.design
    electrical = Electrical()
    observer.electrical(electrical, track.state, design)
    out.angle, out.speed, out.flux = electrical.angle, electrical.speed, electrical.flux
    out.position = out.velocity = math.nan
    out.position_stddev = out.velocity_stddev = math.nan
    out.angle_stddev = out.speed_stddev = out.flux_stddev = math.nan
    out.status = INITIALISING
    if not track.clock.running:
        return
    deviation = Deviation()
    of_electrical = ElectricalDeviation()
    observer.deviation(observer, deviation, track.state, track.coefficients, design, 1.0)
    observer.electrical_deviation(of_electrical, track.state, track.coefficients, design)
    out.position_stddev, out.velocity_stddev = deviation.position, deviation.velocity
    out.angle_stddev, out.speed_stddev = of_electrical.angle, of_electrical.speed
    out.flux_stddev = of_electrical.flux
    if track.clock.mean_dt > self.limits.longest_dt:
        out.status = MISCONFIGURED
        return
    motion = Motion()
    observer.estimate(observer, motion, track.state, track.coefficients, design, self.used, 0.0)
    out.position, out.velocity, out.status = motion.position, motion.velocity, motion.status
