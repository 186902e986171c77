# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a header of a mechanism's observer has: `driver.mechanism_channel` for one sample."""

from __future__ import annotations

import math
from typing import Annotated, Any

from estimator_pkg.driver.channel import advance
from estimator_pkg.driver.mechanism_channel import Track
from estimator_pkg.estimate import INITIALISING, MISCONFIGURED
from estimator_pkg.models.mechanics import Vector
from estimator_pkg.observers.mechanism.algebra import is_finite
from estimator_pkg.observers.mechanism.core import MechanismEstimate as Motion
from estimator_pkg.observers.mechanism.state import Design
from estimator_pkg.record import record
from estimator_pkg.sensor.guard import DUPLICATE, NON_FINITE, Limits


@record
class State:
    """One mechanism: its clock and its motion. Call init first."""

    design: Design
    limits: Limits
    track: Track
    # samples by verdict: used, first, after a gap, clock jump, stray stamp, outage; and dropped:
    # duplicate, late, non-finite, zero stamp, misconfigured, repeated
    counts: Annotated[list[int], 12]
    measurement: Vector  # the newest positions, used or not [rad or m]
    known_input: Vector  # since the last sample


@record
class Estimate:
    """The estimate at the newest sample that was used; NaN: there is none."""

    position: Vector  # [rad or m], in the convention of the measurement
    velocity: Vector  # [rad/s or m/s]
    status: int  # 0 initialising, 1 tracking, 2 coasting, 4 not observable, 5 misconfigured


def init(observer: Any, self: State, tuned: Design) -> None:
    """Set everything before the first sample."""
    blank = State()
    self.take(blank)
    self.design.take(tuned)
    observer.prepare(self.track.coefficients, self.design, 1e-3)


def update(
    observer: Any, self: State, stamp_ns: int, position: list[float], effort: list[float]
) -> bool:
    """Take one sample; return True if it was used, False if it was dropped and counted.

    Parameters
    ----------
    stamp_ns : when the positions were measured [ns], above 0, of a clock that moves forward.
    position : of each joint of the model [rad or m].
    effort : of each input of the model, mean since the last sample [N m or N]; NaN: not known.
    """
    for i in range(observer.model.JOINTS):
        self.measurement[i] = position[i]
    for i in range(observer.model.INPUTS):
        self.known_input[i] = effort[i]
    verdict = NON_FINITE
    if is_finite(observer.model.JOINTS, self.measurement):
        verdict = advance(
            observer,
            self.track,
            self.design,
            self.limits,
            stamp_ns,
            self.measurement,
            self.known_input,
        )
    self.counts[verdict] += 1
    return verdict < DUPLICATE


def get(observer: Any, self: State, out: Estimate) -> None:
    """Set the estimate at the newest sample that was used."""
    state = self.track.state
    motion = Motion()
    for i in range(observer.model.JOINTS):
        out.position[i] = out.velocity[i] = math.nan
    out.status = INITIALISING
    if not self.track.clock.running:
        return
    if self.track.clock.mean_dt > self.limits.longest_dt:
        out.status = MISCONFIGURED
        return
    observer.estimate(
        observer,
        motion,
        state,
        self.track.coefficients,
        self.design,
        state.before,
        self.known_input,
    )
    for i in range(observer.model.JOINTS):
        out.position[i], out.velocity[i] = motion.position[i], motion.velocity[i]
    out.status = motion.status
