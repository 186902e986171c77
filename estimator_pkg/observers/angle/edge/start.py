# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How the edge-aware observer comes to know a speed: at a start, and where a shaft has rested.

The covariance is right for motions like those before, and knows nothing of one that has just begun.
So the first changed reading after a rest, a reading far outside the noise of a rest, and a gap put
the speed in doubt: the published variance gets what the readings since then leave open.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.observers.angle.edge import bandwidth, preference
from estimator_pkg.observers.angle.edge.constants import CONFIRMED, LEAST_JERK_DENSITY, SIGMAS
from estimator_pkg.record import record
from estimator_pkg.sensor import noise as sensing

START_SPEED_CHANGES = 8.0  # changes of the reading: so unknown is a starting speed
SETTLES = 2.0  # changed readings after which a speed in doubt is known
FIRST_EDGE = 3.0  # the same when the first has just come: the next one may be a line's second point
START_DURATION = 0.25  # [s] a start lasts: so long a change of its acceleration may not be seen
RESTS = 0.1  # [s] without motion: a rest. In noise: without leaving a quantum and the noise
# outside the cell, in standard deviations of the noise: slack of the sum, a sum that shows that a
# start is likely, and the largest sum, which CONFIRMED readings inside the cell take back
UNMOVED = 1.0
FAR = 1.5
CERTAIN_START = CONFIRMED * UNMOVED
RAMP_END_PART = 0.2  # of the speed error at a ramp's end (`start_variance`): five cover it
DURATION_ALONE = 0.5  # changed readings, where `START_DURATION` alone has not passed
PERHAPS = 0.75  # the same, where noise alone may have looked like a start


@record
class StartUncertainty:
    """Uncertainty of the speed that the covariance does not have."""

    variance: float  # of the speed, in addition to the covariance's [(rad/s)^2]
    edges_to_settle: float  # above 0 while the speed is uncertain
    time_since_first_motion: float  # [s]
    age: float  # time since the last start [s]; 0: this is one
    total: float  # cumulative sum in a rest with noise, see `doubt_in_noise`
    run_time: float  # its run time [s]


def set_start_uncertainty(
    uncertainty: StartUncertainty, variance: float, edges_to_settle: float, since: float, age: float
) -> None:
    """Set the uncertainty of a start; its cumulative sum is zero."""
    uncertainty.variance, uncertainty.edges_to_settle = variance, edges_to_settle
    uncertainty.time_since_first_motion, uncertainty.age = since, age
    uncertainty.total = uncertainty.run_time = 0.0


def doubt_speed(state: Any, change: float, dt: float, since: float, age: float) -> None:
    """Doubt the speed at the first reading after a rest that changed, by `change` [rad]."""
    size = max(state.sensor.quantum, abs(change))
    set_start_uncertainty(state.uncertainty, unknown_speed(size, dt), FIRST_EDGE, since, age)


def unknown_speed(size: float, dt: float) -> float:
    """Return the variance [(rad/s)^2] of a speed that one reading alone shows."""
    return START_SPEED_CHANGES * START_SPEED_CHANGES * size * size / (dt * dt)


def begin_line(state: Any) -> None:
    """Begin with the line through this reading and the one before.

    Third differences across the start are neither noise nor vibration, so the sensor's means start
    again.
    """
    motion, p, sensor, uncertainty = state.motion, state.p, state.sensor, state.uncertainty
    change, dt, quantum = state.reading.change, state.reading.passed, sensor.quantum
    rests, pace = uncertainty.edges_to_settle == FIRST_EDGE, sensor.mean_sample_time
    if rests:
        sensing.first_step(sensor, quantum, change, dt)
        sensor.mean_sample_time = pace
    rate = 1.0 / dt
    floor = quantum * quantum / 12.0 + sensor.noise
    size = max(quantum, abs(change))
    bend = (
        START_SPEED_CHANGES * START_SPEED_CHANGES * size * size / 3.0
    )  # what an unknown speed adds in one sample
    motion.angle, motion.velocity = state.reading.angle, change * rate
    motion.acceleration = motion.idle = 0.0
    p.p00, p.p01, p.p02 = floor, floor * rate, 0.0
    p.p11 = (2.0 * floor + 0.25 * bend) * rate * rate
    p.p12 = 0.5 * bend * rate * rate * rate
    p.p22 = bend * rate * rate * rate * rate
    bandwidth.reset_process_noise(state.process_noise, LEAST_JERK_DENSITY * quantum * quantum)
    if rests:
        set_start_uncertainty(
            uncertainty, 0.0, SETTLES, uncertainty.time_since_first_motion, uncertainty.age
        )
    state.tracking.count += 1.0
    state.tracking.off = 0.0
    bandwidth.reset_velocity_walk(state.velocity_walk)
    preference.reset_second_filter(state.second)


def doubt_in_noise(state: Any, dt: float) -> None:
    """Take a reading in which noise hides single edges.

    The joint rests if it would not leave the noise and a quantum within `RESTS`. It may have
    started where the cumulative sum (Page 1954) of the readings' distances from its cell is above
    `FAR`: since the sum began to run. It has not where the sum is 0 again.
    """
    uncertainty, quantum = state.uncertainty, state.sensor.quantum
    innovation = state.reading.innovation
    sigma = math.sqrt(state.sensor.noise)
    if RESTS * abs(state.motion.velocity) > sigma + quantum:
        return
    beyond = (abs(innovation) - 0.5 * quantum) / sigma  # outside the cell
    total = uncertainty.total
    if beyond > 0.0:
        z = math.copysign(beyond, innovation)
        total = z if total * z < 0.0 and abs(total) < beyond else total + z
    size = min(abs(total) - UNMOVED, CERTAIN_START)
    total = math.copysign(size, total) if size > 0.0 else 0.0
    uncertainty.run_time = (
        0.0 if total == 0.0 else dt if beyond > UNMOVED + FAR else uncertainty.run_time + dt
    )
    uncertainty.total = total
    if uncertainty.edges_to_settle == PERHAPS:
        if total == 0.0:
            uncertainty.variance, uncertainty.edges_to_settle, uncertainty.age = (
                0.0,
                DURATION_ALONE,
                START_DURATION,
            )
        else:
            uncertainty.age = min(uncertainty.age, uncertainty.run_time)
    elif uncertainty.edges_to_settle < 1.0 and size > FAR:
        uncertainty.variance, uncertainty.edges_to_settle = 0.0, PERHAPS
        uncertainty.age = uncertainty.run_time
        uncertainty.total = math.copysign(CERTAIN_START, total)


def start_variance(state: Any, dt: float) -> float:
    """Return the variance of the speed [(rad/s)^2] that no reading of a start can show yet.

    A parabola that stays within one quantum of a line for `age` [s] ends steeper than the line by
    at most 4 quanta in that time; half of its square is the variance. Where an acceleration ends,
    the speed is wrong by sqrt(2 a w) before the angle is wrong by w, and by 2 a dt more until two
    samples have shown it.
    """
    quantum, noise, age = state.sensor.quantum, state.sensor.noise, state.uncertainty.age
    size = abs(state.motion.acceleration)
    hidden = quantum + SIGMAS * math.sqrt(noise)
    ends = RAMP_END_PART * (math.sqrt(2.0 * size * hidden) + 2.0 * size * dt)
    return 8.0 * (quantum * quantum + 12.0 * noise) / (age * age) + ends * ends


def settle(state: Any, noise: float, dt: float) -> None:
    """Take one more changed reading of a start.

    The speed may be off by as much as it differs from the mean since the reading changed last, and
    by what that mean leaves open: either end is an edge, known to a sample's way, or to a cell.

    Parameters
    ----------
    noise : variance of the reading when it came, without the quantum's own [rad^2].
    """
    uncertainty, quantum = state.uncertainty, state.sensor.quantum
    if uncertainty.edges_to_settle < 1.0:
        return
    square = quantum * quantum
    rate = 1.0 / (state.reading.rested + dt)
    secant = state.reading.change * rate
    beyond = secant - state.motion.velocity
    way = secant * secant * dt * dt
    variance = (way if way < square else square) + 12.0 * noise
    variance = beyond * beyond + variance * rate * rate
    uncertainty.edges_to_settle -= 1.0
    if uncertainty.edges_to_settle <= 0.0:
        uncertainty.variance = 0.0
        recent = (
            uncertainty.time_since_first_motion < START_DURATION or uncertainty.age < START_DURATION
        )
        uncertainty.edges_to_settle = DURATION_ALONE if recent else 0.0
    elif uncertainty.edges_to_settle < SETTLES - 1.0:
        uncertainty.variance = 0.5 * (variance + uncertainty.variance)
    else:
        uncertainty.variance = variance


def inflate_for_missing_edge(uncertainty: StartUncertainty, slower: float) -> None:
    """An edge that did not come made the speed lower by `slower` [rad/s].

    The joint may have stopped, and its speed be wrong by more: in all by as much as it was made
    lower since the last changed reading, as a standard deviation. The next one ends it (0).
    """
    if uncertainty.edges_to_settle < 1.0:
        sigma = 0.0 if slower == 0.0 else math.sqrt(uncertainty.variance) + abs(slower)
        uncertainty.variance = sigma * sigma


def pass_time(uncertainty: StartUncertainty, dt: float) -> None:
    """Let `dt` [s] pass."""
    uncertainty.time_since_first_motion += dt
    uncertainty.age += dt
    recent = (
        uncertainty.time_since_first_motion < START_DURATION or uncertainty.age < START_DURATION
    )
    if not recent and uncertainty.edges_to_settle < 1.0:
        uncertainty.edges_to_settle = 0.0
