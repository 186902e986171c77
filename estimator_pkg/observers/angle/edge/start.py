# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How the edge-aware observer comes to know a speed: at a start, and where a shaft has rested.

The covariance is right for motions like those before, and knows nothing of one that has just begun.
So the first changed reading after a rest, a reading far outside the noise of a rest, and a gap put
the speed in doubt: the published variance gets what the readings since then leave open.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.bandwidth import Band, begin_band
from estimator_pkg.observers.angle.edge.constants import BLUR, CALM, LONGEST
from estimator_pkg.observers.angle.edge.covariance import set_covariance
from estimator_pkg.observers.angle.edge.motion import Motion
from estimator_pkg.observers.maths.covariance import Covariance
from estimator_pkg.record import record

UNKNOWN = 8.0  # changes of the reading: so unknown is a starting speed


SETTLES = 2.0  # changed readings after which a speed in doubt is known
UNSURE = 3.0  # the same when the first has just come: the next one may be a line's second point
RECENT = 0.25  # [s] a start lasts: so long a change of its acceleration may not be seen
RESTS = 0.1  # [s] without motion: a rest. In noise: without leaving a quantum and the noise
# outside the cell, in standard deviations of the noise: slack of the sum, a sum that shows that a
# start is likely, and a reading that shows it alone
UNMOVED = 1.0
FAR = 1.5
SURELY = 4.0
LAG = 0.2  # of the speed error at the end of a ramp, see `unseen`: so that five of it cover it
LAST = 0.5  # in place of the changed readings, where `RECENT` alone has not passed
PERHAPS = 0.75  # the same, where noise alone may have looked like a start


@record
class Doubt:
    """What the covariance does not know of the speed."""

    variance: float  # of the speed, in addition to the covariance's [(rad/s)^2]
    to_settle: float  # changed readings until it is settled; above 0 while anything is in doubt
    since: float  # time since the first motion of all [s]
    age: float  # time since the last start [s]
    total: float  # sum of the readings of a rest in noise, see `doubt_in_noise`
    ran: float  # its run time [s]


def set_doubt(doubt: Doubt, variance: float, to_settle: float, since: float, age: float) -> None:
    """Set the doubt; nothing is summed up."""
    doubt.variance, doubt.to_settle, doubt.since, doubt.age = variance, to_settle, since, age
    doubt.total = doubt.ran = 0.0


def begin_line(
    motion: Motion,
    p: Covariance,
    band: Band,
    measurement: float,
    change: float,
    dt: float,
    quantum: float,
    noise: float,
) -> None:
    """Set the line through two readings, `change` [rad] and `dt` [s] after each other.

    Parameters
    ----------
    noise : variance of a reading, without the quantum's own [rad^2].
    """
    rate = 1.0 / dt
    floor = quantum * quantum / 12.0 + noise
    bend = swerve(max(quantum, abs(change)))
    motion.angle, motion.velocity = measurement, change * rate
    motion.acceleration = motion.idle = 0.0
    p.p00, p.p01, p.p02 = floor, floor * rate, 0.0
    p.p11 = (2.0 * floor + 0.25 * bend) * rate * rate
    p.p12 = 0.5 * bend * rate * rate * rate
    p.p22 = bend * rate * rate * rate * rate
    begin_band(band, CALM * quantum * quantum)


def swerve(size: float) -> float:
    """Return the variance [rad^2] of what an unknown speed adds in one sample."""
    return UNKNOWN * UNKNOWN * size * size / 3.0


def unknown_speed(size: float, dt: float) -> float:
    """Return the variance [(rad/s)^2] of a speed that one reading alone shows."""
    return UNKNOWN * UNKNOWN * size * size / (dt * dt)


def doubt_speed(doubt: Doubt, size: float, dt: float, since: float, age: float) -> None:
    """Doubt the speed at the first changed reading after a rest: none is known.

    Parameters
    ----------
    since : time since the first motion of all [s].
    age : time since the last start [s]; 0: this is one.
    """
    set_doubt(doubt, unknown_speed(size, dt), UNSURE, since, age)


def doubt_in_noise(
    doubt: Doubt, off: float, v: float, quantum: float, noise: float, dt: float
) -> None:
    """Take a reading in which noise hides single edges.

    The joint rests if it would not leave the noise and a quantum within `RESTS`. It may have
    started where the cumulative sum (Page 1954) of the readings' distances from its cell is above
    `FAR`: since the sum began to run. It has not where the sum is 0 again.

    Parameters
    ----------
    off : of the reading from the predicted angle [rad].
    v : predicted speed [rad/s].
    noise : variance of a reading, without the quantum's own [rad^2].
    """
    sigma = math.sqrt(noise)
    if RESTS * abs(v) > sigma + quantum:
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


def unseen(a: float, quantum: float, noise: float, dt: float, age: float) -> float:
    """Return the variance of the speed [(rad/s)^2] that no reading of a start can show yet.

    A parabola that stays within one quantum of a line for `age` [s] ends steeper than the line by
    at most 4 quanta in that time; half of its square is the variance. Where an acceleration ends,
    the speed is wrong by sqrt(2 a w) before the angle is wrong by w, and by 2 a dt more until two
    samples have shown it.

    Parameters
    ----------
    a : estimated acceleration [rad/s^2].
    noise : variance of a reading, without the quantum's own [rad^2].
    """
    size = abs(a)
    hidden = quantum + 3.0 * math.sqrt(noise)
    ends = LAG * (math.sqrt(2.0 * size * hidden) + 2.0 * size * dt)
    return 8.0 * (quantum * quantum + 12.0 * noise) / (age * age) + ends * ends


def settle(
    doubt: Doubt, v: float, change: float, rested: float, dt: float, square: float, noise: float
) -> None:
    """Take one more changed reading of a start.

    The speed may be off by as much as it differs from the mean since the reading changed last, and
    by what that mean leaves open: either end is an edge, known to a sample's way, or to a cell.

    Parameters
    ----------
    v : estimated speed [rad/s].
    change : of the reading [rad], after it had not changed for `rested` [s].
    square : of the quantum [rad^2].
    noise : variance of the reading, without the quantum's own [rad^2].
    """
    if doubt.to_settle < 1.0:
        return
    rate = 1.0 / (rested + dt)
    secant = change * rate
    beyond = secant - v
    way = secant * secant * dt * dt
    variance = beyond * beyond + ((way if way < square else square) + 12.0 * noise) * rate * rate
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


def stand(p: Covariance, band: Band, quantum: float) -> None:
    """Set what is known of a shaft that has stood for long, and is at an edge.

    A straight line through an angle of its cell, `LONGEST` [s] ago, and the edge.
    """
    rate = 1.0 / LONGEST
    floor = quantum * quantum / 12.0
    square = rate * rate
    set_covariance(
        p, BLUR * BLUR * quantum * quantum, 0.0, 0.0, floor * square, 0.0, floor * square * square
    )
    begin_band(band, CALM * quantum * quantum)
