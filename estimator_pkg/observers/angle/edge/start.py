# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How the edge-aware observer comes to know a speed: at a start, and where a shaft has rested.

The covariance is right for motions like those before, and knows nothing of one that has just begun.
So the first changed reading after a rest, a reading far outside the noise of a rest, and a gap put
the speed in doubt: the published variance gets what the readings since then leave open.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.bandwidth import STEADY, Band, begin_band
from estimator_pkg.observers.angle.edge.clock import Clock
from estimator_pkg.observers.angle.edge.constants import BLUR, CALM, LONGEST, PLAIN, RESTED
from estimator_pkg.observers.angle.edge.covariance import Covariance
from estimator_pkg.observers.angle.edge.preference import ALIKE
from estimator_pkg.observers.angle.edge.quantum import FIRST_STEPS, Steps, follow_steps, quantum_of
from estimator_pkg.observers.angle.edge.sensor import Sensor, first_step, paced
from estimator_pkg.observers.contract import INITIALISING

SWERVE = 0.1  # half turns per sample by which a starting speed may change at most in a sample
VAGUE = 100.0  # the same in quanta, where there is no turn

SETTLES = 2.0  # changed readings after which a speed in doubt is known
UNSURE = 3.0  # the same when the first has just come: the next one may be a line's second point
RECENT = 0.25  # [s] a start lasts: so long a change of its acceleration may not be seen
RESTS = 0.1  # [s] without motion: a rest. In noise: without leaving a quantum and the noise
# outside the cell, in standard deviations of the noise: slack of the sum, a sum that shows that a
# start is likely, and a reading that shows it alone
UNMOVED, FAR, SURELY = 1.0, 1.5, 4.0
LAG = 0.2  # of the speed error at the end of a ramp, see `unseen`: so that five of it cover it

Motion = tuple[float, float, float, float]
# (variance of the speed, in addition to the covariance's [(rad/s)^2]; changed readings until it is
# settled, above 0 while anything is in doubt; time since the first motion of all, and since the
# last start [s]; sum of the readings of a rest in noise, and its run time; see `doubted_in_noise`)
Doubt = tuple[float, float, float, float, float, float]

LAST = 0.5  # in place of the changed readings, where `RECENT` alone has not passed
PERHAPS = 0.75  # the same, where noise alone may have looked like a start
START: Doubt = (0.0, LAST, 0.0, 0.0, 0.0, 0.0)


def first_state(
    measurement: float, sensor: Sensor, steps: Steps, convention: tuple, doubt: Doubt, clock: Clock
) -> tuple:
    """Return the state of a start at this measurement [rad], with this knowledge of the sensor."""
    quantum, _, _, _, _, _, _, _, _, _, _ = sensor
    return (
        (measurement, 0.0, 0.0, 0.0),
        (quantum * quantum / 12.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        begin_band(0.0),
        sensor,
        steps,
        convention,
        (INITIALISING, 1.0, 0.0),
        STEADY,
        doubt,
        clock,
        ALIKE,
    )


def started(
    measurement: float, change: float, dt: float, quantum: float, noise: float, period: float
) -> tuple[Motion, Covariance, Band]:
    """Return the line through two readings, `change` [rad] and `dt` [s] after each other.

    Parameters
    ----------
    noise : variance of a reading, without the quantum's own [rad^2].
    """
    rate = 1.0 / dt
    floor = quantum * quantum / 12.0 + noise
    bend = swerve(quantum, period)
    return (
        (measurement, change * rate, 0.0, 0.0),
        (
            floor,
            floor * rate,
            0.0,
            (2.0 * floor + 0.25 * bend) * rate * rate,
            0.5 * bend * rate * rate * rate,
            bend * rate * rate * rate * rate,
        ),
        begin_band(CALM * quantum * quantum),
    )


def swerve(quantum: float, period: float) -> float:
    """Return the variance [rad^2] of what an unknown speed adds in one sample."""
    bend = max(VAGUE * quantum, SWERVE * 0.5 * period)
    return bend * bend / 3.0


def doubted(quantum: float, dt: float, period: float, since: float, age: float) -> Doubt:
    """Return the doubt at the first changed reading after a rest: no speed is known.

    Parameters
    ----------
    since : time since the first motion of all [s].
    age : time since the last start [s]; 0: this is one.
    """
    variance = (quantum * quantum / 6.0 + 0.25 * swerve(quantum, period)) / (dt * dt)
    return variance, UNSURE, since, age, 0.0, 0.0


def doubted_in_noise(
    doubt: Doubt, off: float, v: float, quantum: float, noise: float, dt: float, period: float
) -> Doubt:
    """Return the doubt after a reading in which noise hides single edges.

    The joint rests if it would not leave the noise and a quantum within `RESTS`. It may have
    started where the cumulative sum (Page 1954) of the readings' distances from its cell is above
    `FAR`: since the sum began to run. It has not where the sum is 0 again.

    Parameters
    ----------
    off : of the reading from the predicted angle [rad].
    v : predicted speed [rad/s].
    noise : variance of a reading, without the quantum's own [rad^2].
    """
    before, to_settle, since, age, total, ran = doubt
    sigma = math.sqrt(noise)
    if RESTS * abs(v) > sigma + quantum:
        return doubt
    beyond = (abs(off) - 0.5 * quantum) / sigma  # outside the cell
    if beyond > SURELY:
        variance, _, _, _, _, _ = doubted(quantum, dt, period, since, 0.0)
        return variance, SETTLES, since, dt, math.copysign(SURELY, off), dt
    if beyond > 0.0:
        z = math.copysign(beyond, off)
        total = z if total * z < 0.0 and abs(total) < beyond else total + z
    size = min(abs(total) - UNMOVED, SURELY)
    total = math.copysign(size, total) if size > 0.0 else 0.0
    ran = 0.0 if total == 0.0 else dt if beyond > UNMOVED + FAR else ran + dt
    if to_settle < 1.0:
        if to_settle == PERHAPS:
            if total == 0.0:
                return 0.0, LAST, since, RECENT, total, ran
            age = min(age, ran)
        elif size > FAR:
            return 0.0, PERHAPS, since, ran, math.copysign(SURELY, total), ran
    return before, to_settle, since, age, total, ran


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


def settled(
    doubt: Doubt, v: float, change: float, rested: float, dt: float, square: float, noise: float
) -> Doubt:
    """Return the doubt after one more changed reading.

    The speed may be off by as much as it differs from the mean since the reading changed last, and
    by what that mean leaves open: either end is an edge, known to a sample's way, or to a cell.

    Parameters
    ----------
    v : estimated speed [rad/s].
    change : of the reading [rad], after it had not changed for `rested` [s].
    square : of the quantum [rad^2].
    noise : variance of the reading, without the quantum's own [rad^2].
    """
    before, to_settle, since, age, total, ran = doubt
    if to_settle < 1.0:
        return doubt
    rate = 1.0 / (rested + dt)
    secant = change * rate
    beyond = secant - v
    way = secant * secant * dt * dt
    variance = beyond * beyond + ((way if way < square else square) + 12.0 * noise) * rate * rate
    to_settle -= 1.0
    if to_settle <= 0.0:
        return 0.0, LAST if since < RECENT or age < RECENT else 0.0, since, age, total, ran
    if to_settle < SETTLES - 1.0:
        variance = 0.5 * (variance + before)
    return variance, to_settle, since, age, total, ran


def motion_began(doubt: Doubt, dt: float) -> Doubt:
    """Return the doubt where the fast law found a manoeuvre of a joint that rested."""
    variance, to_settle, since, age, total, ran = doubt
    if to_settle >= 1.0:
        return doubt
    return variance, LAST, since, dt, total, ran


def overdue(doubt: Doubt, slower: float) -> Doubt:
    """Return the doubt where an edge that did not come made the speed lower by `slower` [rad/s].

    The joint may have stopped, and its speed be wrong by more: in all by as much as it was made
    lower since the last changed reading, as a standard deviation. The next one ends it (0).
    """
    variance, to_settle, since, age, total, ran = doubt
    if to_settle >= 1.0:
        return doubt
    sigma = 0.0 if slower == 0.0 else math.sqrt(variance) + abs(slower)
    return sigma * sigma, to_settle, since, age, total, ran


def later(doubt: Doubt, dt: float) -> Doubt:
    """Return the doubt a sample of `dt` [s] later."""
    variance, to_settle, since, age, total, ran = doubt
    since += dt
    age += dt
    if since >= RECENT and age >= RECENT and to_settle < 1.0:
        to_settle = 0.0
    return variance, to_settle, since, age, total, ran


def stood(quantum: float) -> tuple[Covariance, Band]:
    """Return what is known of a shaft that has stood for long, and is at an edge.

    A straight line through an angle of its cell, `LONGEST` [s] ago, and the edge.
    """
    rate = 1.0 / LONGEST
    floor = quantum * quantum / 12.0
    square = rate * rate
    return (
        (BLUR * BLUR * quantum * quantum, 0.0, 0.0, floor * square, 0.0, floor * square * square),
        begin_band(CALM * quantum * quantum),
    )


def after_jump(
    jump: float, last: float, dt: float, given: float, period: float
) -> tuple[Motion, Covariance, Band, Sensor, Steps, Doubt]:
    """Return what is known where a `jump` [rad] was confirmed: all before it was residue.

    Parameters
    ----------
    last : the reading after the jump [rad].
    given : quantum as the user gave it [rad]; 0: not known.
    """
    steps = follow_steps(FIRST_STEPS, jump, 0.0, dt, 0.0, given, math.inf)
    quantum = quantum_of(steps, given)
    p, band = stood(quantum)
    return (
        (last - 0.5 * jump, 0.0, 0.0, 0.0),  # at the edge
        p,
        band,
        first_step(quantum, jump, dt),
        steps,
        doubted(quantum, dt, period, 0.0, 0.0),
    )


def stirred(
    doubt: Doubt,
    sensor: Sensor,
    p: Covariance,
    rested: float,
    dt: float,
    first: bool,
    period: float,
) -> tuple[Doubt, bool]:
    """Return the doubt at the first changed reading after `rested` [s], and whether it is a start.

    It is none where noise hides single edges (see `doubted_in_noise`), and where the angle is known
    too well: an edge came meanwhile, that noise took back.

    Parameters
    ----------
    first : this is the first motion of all.
    """
    quantum, noise, _, _, _, _, _, _, _, _, _ = sensor
    _, _, since, age, _, _ = doubt
    p00, _, _, _, _, _ = p
    square = quantum * quantum
    if noise <= PLAIN * square and (first or 12.0 * p00 > RESTED * square):
        since, age = 0.0 if first else since, age if rested < RESTS else 0.0
        return doubted(quantum, dt, period, since, age), True
    return doubt, False


def straight_line(
    measurement: float,
    change: float,
    dt: float,
    sensor: Sensor,
    period: float,
    band: Band,
    doubt: Doubt,
) -> tuple[Motion, Covariance, Band, Sensor, Doubt]:
    """Return what two readings show, `change` [rad] and `dt` [s] after each other.

    Only the bandwidth stays, where the joint started from a rest. Third differences across the
    start are neither noise nor vibration, so the sensor's means start again.
    """
    quantum, noise, _, _, _, _, _, _, _, _, pace = sensor
    was, _, _, _, _, _, _, _, _ = band
    _, to_settle, since, age, _, _ = doubt
    if to_settle == UNSURE:
        sensor = paced(first_step(quantum, change, dt), pace)
        _, noise, _, _, _, _, _, _, _, _, _ = sensor
    motion, p, band = started(measurement, change, dt, quantum, noise, period)
    if to_settle == UNSURE:
        density, low, variance, up, down, up_time, down_time, squares, quiet = band
        density = was if was > density else density
        band = (density, low, variance, up, down, up_time, down_time, squares, quiet)
        doubt = (0.0, SETTLES, since, age, 0.0, 0.0)
    return motion, p, band, sensor, doubt


def rescaled(
    p: Covariance, band: Band, sensor: Sensor, quantum: float, first: bool
) -> tuple[Covariance, Band, Sensor]:
    """Return covariance, band and sensor where the quantum in use becomes `quantum` [rad].

    They stay as they were in quanta, but a finer quantum makes no estimate surer.

    Parameters
    ----------
    first : this is the first step of all, and everything was relative to `UNIT`.
    """
    used, noise, scatter, residual, step, dt, change, since, bend, lasting, pace = sensor
    density, low, variance, up, down, up_time, down_time, squares, quiet = band
    scale = quantum * quantum / (used * used)
    if noise > PLAIN * used * used:  # what is known stays as it was in noise
        scale = (quantum * quantum + 12.0 * noise) / (used * used + 12.0 * noise)
    band = (density * scale, low, variance, up, down, up_time, down_time, squares, quiet)
    if first:
        noise *= scale
        lasting *= scale
        sensor = (used, noise, scatter, residual, step, dt, change, since, bend, lasting, pace)
    if scale > 1.0 or first:
        p00, p01, p02, p11, p12, p22 = p
        p = (scale * p00, scale * p01, scale * p02, scale * p11, scale * p12, scale * p22)
    return p, band, sensor
