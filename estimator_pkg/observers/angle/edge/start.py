# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How the edge-aware observer comes to know a speed: at a start, and where a shaft has rested.

The covariance is right for motions like those before, and knows nothing of one that has just begun.
So the first changed reading after a rest, and a gap, put the speed in doubt: the published variance
gets what the readings since then leave open.
"""

from __future__ import annotations

from estimator_pkg.observers.angle.edge.bandwidth import Band, begin_band
from estimator_pkg.observers.angle.edge.covariance import Covariance

SWERVE = 0.1  # half turns per sample by which a starting speed may change at most in a sample
VAGUE = 100.0  # the same in quanta, where there is no turn

SETTLES = 2.0  # changed readings after which a speed in doubt is known
UNSURE = 3.0  # the same when the first has just come: the next one may be a line's second point
RECENT = 0.3  # [s] after the first motion of all a change of its acceleration is not seen

Motion = tuple[float, float, float, float]
# (variance of the speed, in addition to the covariance's [(rad/s)^2]; changed readings until it is
# settled, above 0 while anything is in doubt; time since the first motion, or the start [s])
Doubt = tuple[float, float, float]

LAST = 0.5  # in place of the changed readings, where `RECENT` alone has not passed
START: Doubt = (0.0, LAST, 0.0)


def started(
    measurement: float,
    change: float,
    dt: float,
    quantum: float,
    noise: float,
    period: float,
    longest: float,
) -> tuple[Motion, Covariance, Band]:
    """Return the line through two readings, `change` [rad] and `dt` [s] after each other.

    Parameters
    ----------
    noise : variance of a reading, without the quantum's own [rad^2].
    longest : memory of the filter that has seen nothing move [s].
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
        begin_band(quantum * quantum / longest**5),
    )


def swerve(quantum: float, period: float) -> float:
    """Return the variance [rad^2] of what an unknown speed adds in one sample."""
    bend = max(VAGUE * quantum, SWERVE * 0.5 * period)
    return bend * bend / 3.0


def doubted(quantum: float, dt: float, period: float, since: float) -> Doubt:
    """Return the doubt at the first changed reading after a rest: no speed is known.

    Parameters
    ----------
    since : time since the first motion of all [s].
    """
    return ((quantum * quantum / 6.0 + 0.25 * swerve(quantum, period)) / (dt * dt), UNSURE, since)


def bent(square: float, since: float) -> float:
    """Return the variance of the speed [(rad/s)^2] that an unseen bend of the motion may hide.

    A parabola that stays within one quantum of a line for `since` [s] ends steeper than the line by
    at most 4 quanta in that time; a uniform error of that size has a third of its square.

    Parameters
    ----------
    square : of the quantum, with 12 times the variance of the noise [rad^2].
    """
    return 16.0 / 3.0 * square / (since * since)


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
    rate = 1.0 / (rested + dt)
    secant = change * rate
    beyond = secant - v
    way = secant * secant * dt * dt
    variance = beyond * beyond + ((way if way < square else square) + 12.0 * noise) * rate * rate
    before, to_settle, since = doubt
    to_settle -= 1.0
    if to_settle <= 0.0:
        return 0.0, LAST if since < RECENT else 0.0, since
    if to_settle < SETTLES - 1.0:
        variance = 0.5 * (variance + before)
    return variance, to_settle, since


def later(doubt: Doubt, dt: float) -> Doubt:
    """Return the doubt a sample of `dt` [s] later."""
    variance, to_settle, since = doubt
    since += dt
    return variance, 0.0 if since >= RECENT and to_settle == LAST else to_settle, since


def stood(quantum: float, blur: float, longest: float) -> tuple[Covariance, Band]:
    """Return what is known of a shaft that has stood for long, and is at an edge.

    A straight line through an angle of its cell, `longest` [s] ago, and the edge.
    """
    rate = 1.0 / longest
    floor = quantum * quantum / 12.0
    square = rate * rate
    return (
        (blur * blur * quantum * quantum, 0.0, 0.0, floor * square, 0.0, floor * square * square),
        begin_band(quantum * quantum / longest**5),
    )
