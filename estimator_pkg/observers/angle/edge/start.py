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

from estimator_pkg.observers.angle.edge import bandwidth, covariance, preference
from estimator_pkg.observers.angle.edge.constants import BLUR, CALM, CONFIRMED, LONGEST, SIGMAS
from estimator_pkg.record import record
from estimator_pkg.sensor import noise as sensing

UNKNOWN = 8.0  # changes of the reading: so unknown is a starting speed
SETTLES = 2.0  # changed readings after which a speed in doubt is known
UNSURE = 3.0  # the same when the first has just come: the next one may be a line's second point
RECENT = 0.25  # [s] a start lasts: so long a change of its acceleration may not be seen
RESTS = 0.1  # [s] without motion: a rest. In noise: without leaving a quantum and the noise
# outside the cell, in standard deviations of the noise: slack of the sum, a sum that shows that a
# start is likely, and a reading that shows it alone
UNMOVED = 1.0
FAR = 1.5
SURELY = CONFIRMED * UNMOVED  # which as many readings inside the cell take back
LAG = 0.2  # of the speed error at the end of a ramp, see `unseen`: so that five of it cover it
LAST = 0.5  # in place of the changed readings, where `RECENT` alone has not passed
PERHAPS = 0.75  # the same, where noise alone may have looked like a start


@record
class Doubt:
    """What the covariance does not know of the speed."""

    variance: float  # of the speed, in addition to the covariance's [(rad/s)^2]
    to_settle: float  # changed readings until it is settled; above 0 while anything is in doubt
    since: float  # time since the first motion of all [s]
    age: float  # time since the last start [s]; 0: this is one
    total: float  # sum of the readings of a rest in noise, see `doubt_in_noise`
    ran: float  # its run time [s]


def set_doubt(doubt: Doubt, variance: float, to_settle: float, since: float, age: float) -> None:
    """Set the doubt; nothing is summed up."""
    doubt.variance, doubt.to_settle, doubt.since, doubt.age = variance, to_settle, since, age
    doubt.total = doubt.ran = 0.0


def doubt_speed(state: Any, change: float, dt: float, since: float, age: float) -> None:
    """Doubt the speed at the first reading after a rest that changed, by `change` [rad]."""
    size = max(state.sensor.quantum, abs(change))
    set_doubt(state.doubt, unknown_speed(size, dt), UNSURE, since, age)


def unknown_speed(size: float, dt: float) -> float:
    """Return the variance [(rad/s)^2] of a speed that one reading alone shows."""
    return UNKNOWN * UNKNOWN * size * size / (dt * dt)


def begin_line(state: Any) -> None:
    """Begin with the line through this reading and the one before.

    Third differences across the
    start are neither noise nor vibration, so the sensor's means start again.
    """
    motion, p, sensor, doubt = state.motion, state.p, state.sensor, state.doubt
    change, dt, quantum = state.reading.change, state.reading.passed, sensor.quantum
    rests, pace = doubt.to_settle == UNSURE, sensor.mean_sample_time
    if rests:
        sensing.first_step(sensor, quantum, change, dt)
        sensor.mean_sample_time = pace
    rate = 1.0 / dt
    floor = quantum * quantum / 12.0 + sensor.noise
    size = max(quantum, abs(change))
    bend = UNKNOWN * UNKNOWN * size * size / 3.0  # what an unknown speed adds in one sample
    motion.angle, motion.velocity = state.reading.angle, change * rate
    motion.acceleration = motion.idle = 0.0
    p.p00, p.p01, p.p02 = floor, floor * rate, 0.0
    p.p11 = (2.0 * floor + 0.25 * bend) * rate * rate
    p.p12 = 0.5 * bend * rate * rate * rate
    p.p22 = bend * rate * rate * rate * rate
    bandwidth.begin_band(state.band, CALM * quantum * quantum)
    if rests:
        set_doubt(doubt, 0.0, SETTLES, doubt.since, doubt.age)
    state.lock.count += 1.0
    bandwidth.forget_sway(state.sway)
    preference.set_alike(state.other)


def stand(state: Any, quantum: float) -> None:
    """Set what is known of a shaft that has stood for long, and is at an edge.

    A straight line through an angle of its cell, `LONGEST` [s] ago, and the edge.
    """
    rate = 1.0 / LONGEST
    floor = quantum * quantum / 12.0
    square = rate * rate
    covariance.set_covariance(
        state.p,
        BLUR * BLUR * quantum * quantum,
        0.0,
        0.0,
        floor * square,
        0.0,
        floor * square * square,
    )
    bandwidth.begin_band(state.band, CALM * quantum * quantum)


def doubt_in_noise(state: Any, dt: float) -> None:
    """Take a reading in which noise hides single edges.

    The joint rests if it would not leave the noise and a quantum within `RESTS`. It may have
    started where the cumulative sum (Page 1954) of the readings' distances from its cell is above
    `FAR`: since the sum began to run. It has not where the sum is 0 again.
    """
    doubt, off, quantum = state.doubt, state.reading.off, state.sensor.quantum
    sigma = math.sqrt(state.sensor.noise)
    if RESTS * abs(state.motion.velocity) > sigma + quantum:
        return
    beyond = (abs(off) - 0.5 * quantum) / sigma  # outside the cell
    if beyond > SURELY:
        set_doubt(doubt, unknown_speed(abs(off), dt), SETTLES, doubt.since, dt)
        doubt.total, doubt.ran = math.copysign(SURELY, off), dt
        return
    total = doubt.total
    if beyond > 0.0:
        z = math.copysign(beyond, off)
        total = z if total * z < 0.0 and abs(total) < beyond else total + z
    size = min(abs(total) - UNMOVED, SURELY)
    total = math.copysign(size, total) if size > 0.0 else 0.0
    doubt.ran = 0.0 if total == 0.0 else dt if beyond > UNMOVED + FAR else doubt.ran + dt
    doubt.total = total
    if doubt.to_settle == PERHAPS:
        if total == 0.0:
            doubt.variance, doubt.to_settle, doubt.age = 0.0, LAST, RECENT
        else:
            doubt.age = min(doubt.age, doubt.ran)
    elif doubt.to_settle < 1.0 and size > FAR:
        doubt.variance, doubt.to_settle, doubt.age = 0.0, PERHAPS, doubt.ran
        doubt.total = math.copysign(SURELY, total)


def unseen(state: Any, dt: float) -> float:
    """Return the variance of the speed [(rad/s)^2] that no reading of a start can show yet.

    A parabola that stays within one quantum of a line for `age` [s] ends steeper than the line by
    at most 4 quanta in that time; half of its square is the variance. Where an acceleration ends,
    the speed is wrong by sqrt(2 a w) before the angle is wrong by w, and by 2 a dt more until two
    samples have shown it.
    """
    quantum, noise, age = state.sensor.quantum, state.sensor.noise, state.doubt.age
    size = abs(state.motion.acceleration)
    hidden = quantum + SIGMAS * math.sqrt(noise)
    ends = LAG * (math.sqrt(2.0 * size * hidden) + 2.0 * size * dt)
    return 8.0 * (quantum * quantum + 12.0 * noise) / (age * age) + ends * ends


def settle(state: Any, noise: float, dt: float) -> None:
    """Take one more changed reading of a start.

    The speed may be off by as much as it differs from the mean since the reading changed last, and
    by what that mean leaves open: either end is an edge, known to a sample's way, or to a cell.

    Parameters
    ----------
    noise : variance of the reading when it came, without the quantum's own [rad^2].
    """
    doubt, quantum = state.doubt, state.sensor.quantum
    if doubt.to_settle < 1.0:
        return
    square = quantum * quantum
    rate = 1.0 / (state.reading.rested + dt)
    secant = state.reading.change * rate
    beyond = secant - state.motion.velocity
    way = secant * secant * dt * dt
    variance = (way if way < square else square) + 12.0 * noise
    variance = beyond * beyond + variance * rate * rate
    doubt.to_settle -= 1.0
    if doubt.to_settle <= 0.0:
        doubt.variance = 0.0
        doubt.to_settle = LAST if doubt.since < RECENT or doubt.age < RECENT else 0.0
    elif doubt.to_settle < SETTLES - 1.0:
        doubt.variance = 0.5 * (variance + doubt.variance)
    else:
        doubt.variance = variance


def doubt_overdue(doubt: Doubt, slower: float) -> None:
    """An edge that did not come made the speed lower by `slower` [rad/s].

    The joint may have stopped, and its speed be wrong by more: in all by as much as it was made
    lower since the last changed reading, as a standard deviation. The next one ends it (0).
    """
    if doubt.to_settle < 1.0:
        sigma = 0.0 if slower == 0.0 else math.sqrt(doubt.variance) + abs(slower)
        doubt.variance = sigma * sigma


def pass_time(doubt: Doubt, dt: float) -> None:
    """Let `dt` [s] pass."""
    doubt.since += dt
    doubt.age += dt
    if doubt.since >= RECENT and doubt.age >= RECENT and doubt.to_settle < 1.0:
        doubt.to_settle = 0.0
