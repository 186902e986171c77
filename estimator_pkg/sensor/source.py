# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A rate from another sensor beside the angle: its bias, ratio and delay, and what it tells.

    v(t) = r w(t + d) + b,   x(t) = x0 + r I(t) + b t + g w(t),   I' = w,   g = r d

w is the source's value: the integral of what it says is the angle, but for four unknowns, in which
the angle is linear. A Kalman filter of (x, b, r, g) finds them; x walks by the source's noise, b
slowly by itself. The innovation is white while the source agrees with the angle. Cumulative sums
of it (Page 1954) tell when it does not.
"""

from __future__ import annotations

import math
from typing import Annotated

from estimator_pkg.circle import wrap
from estimator_pkg.record import record
from estimator_pkg.sensor.scatter import Scatter, begin_scatter, follow_scatter, resume_scatter

X, BIAS, RATIO, SHIFT = 0, 1, 2, 3  # places in the filter: x [rad], b [rad/s], r, g = r d [s]
UNKNOWN_BIAS, UNKNOWN_RATIO, UNKNOWN_DELAY = 1.0, 10.0, 0.02  # deviations before the first value
WALK = 1e-4  # of the bias [rad/s per square root of a second]
READINGS = 0.01  # weight of one reading in the mean square of what readings and estimates differ
SLACK, ALARM = 1.0, 12.0  # of the cumulative sums [deviations]: a false one in 10^10 readings
HOLE = 3.0  # sample times, after which values were lost
APART = 25.0  # squared deviations between two speeds that do not agree


@record
class Source:
    """What is known of a source, and its newest value."""

    ratio: float  # as given; 0: learnt
    delay: float  # as given [s]; below 0: learnt
    known: Annotated[list[float], 4]  # x [rad], b [rad/s], r, g [s]
    p: Annotated[list[list[float]], 4, 4]  # their covariance
    scatter: Scatter  # of the values
    value: float  # w, the newest [its own unit]
    variance: float  # of its noise
    slope: float  # w' [per second]
    stamp_ns: int  # of it; 0: none yet
    dt: float  # between the last two values [s]
    readings: float  # mean square of what readings and estimates differ [rad^2]
    up: float  # cumulative sums of the innovations [deviations]
    down: float
    news: bool  # a value has come since the last reading
    h: Annotated[list[float], 4]  # the direction in which an angle sees x, b, r, g
    c: Annotated[list[float], 4]  # their covariance with it


def begin_source(source: Source, ratio: float, delay: float) -> None:
    """Begin without a value."""
    blank = Source()
    source.take(blank)
    source.ratio, source.delay = ratio, delay


def forget_source(source: Source, angle: float) -> None:
    """Begin to learn at this angle [rad]; what a user gave stays."""
    ratio, delay = source.ratio, source.delay
    for i in range(4):
        for j in range(4):
            source.p[i][j] = 0.0
    source.known[BIAS] = 0.0
    source.known[RATIO] = ratio if ratio != 0.0 else 1.0
    source.known[SHIFT] = source.known[RATIO] * delay if delay > 0.0 else 0.0
    source.p[BIAS][BIAS] = UNKNOWN_BIAS * UNKNOWN_BIAS
    source.p[RATIO][RATIO] = UNKNOWN_RATIO * UNKNOWN_RATIO if ratio == 0.0 else 0.0
    source.p[SHIFT][SHIFT] = UNKNOWN_DELAY * UNKNOWN_DELAY if delay < 0.0 else 0.0
    resume_source(source, angle)


def follow_source(
    source: Source, stamp_ns: int, value: float, moved: float, variance: float
) -> None:
    """Take a value: the angle moves by its integral.

    Parameters
    ----------
    moved : since the value before [of the value, times s]; nan: the integral of the two.
    variance : of the value; 0: it follows from the values.
    """
    dt = (stamp_ns - source.stamp_ns) * 1e-9
    if source.stamp_ns == 0:
        begin_scatter(source.scatter, value)
        dt = 0.0
    else:
        follow_scatter(source.scatter, value, dt, math.inf)
        if math.isnan(moved):
            moved = 0.5 * (source.value + value) * dt
        source.known[X] += source.known[RATIO] * moved + source.known[BIAS] * dt
        for j in range(4):
            source.p[X][j] += dt * source.p[BIAS][j] + moved * source.p[RATIO][j]
        for i in range(4):
            source.p[i][X] += dt * source.p[i][BIAS] + moved * source.p[i][RATIO]
        source.p[BIAS][BIAS] += WALK * WALK * dt
        source.slope = (value - source.value) / dt
        if source.dt > 0.0 and dt > HOLE * source.dt:  # what happened meanwhile is not known
            source.p[X][X] += moved * moved * source.known[RATIO] * source.known[RATIO]
            resume_scatter(source.scatter, value)
            dt = source.dt
    source.variance = source.scatter.variance if variance == 0.0 else variance
    source.p[X][X] += white(source) * dt * dt
    source.value, source.stamp_ns, source.dt, source.news = value, stamp_ns, dt, True


def resume_source(source: Source, angle: float) -> None:
    """Go on at another angle [rad], after a hole or where the source did not agree."""
    known, p, w = source.known, source.p, source.value
    known[X] = angle - w * known[SHIFT]
    for i in range(4):
        p[X][i] = p[i][X] = -w * p[SHIFT][i]
    p[X][X] = source.readings + w * w * p[SHIFT][SHIFT]
    source.up = source.down = 0.0


def white(source: Source) -> float:
    """Return the variance of a value's noise, as a speed [(rad/s)^2]."""
    return source.known[RATIO] * source.known[RATIO] * source.variance


def meet_angle(
    source: Source,
    stamp_ns: int,
    reading: float,
    angle: float,
    step: float,
    r: float,
    period: float,
) -> bool:
    """Learn from an angle since the newest value; return False if the source does not agree.

    Parameters
    ----------
    reading : [rad]. angle : as readings alone estimate it [rad]. step : what the joint moves
        between two readings [rad]; where that is more than a count, errors of readings are white,
        and the estimate's lag would pass for a delay.
    r : variance of the estimate [rad^2]. period : wrap period [rad]; 0: none.
    """
    off, ahead = reading - angle, (stamp_ns - source.stamp_ns) * 1e-9
    h, c, known, p = source.h, source.c, source.known, source.p
    h[X], h[BIAS], h[SHIFT] = 1.0, ahead, source.value
    h[RATIO] = (source.value + 0.5 * source.slope * ahead) * ahead
    s, nu = source.readings + r, reading if step * step > 12.0 * source.readings else angle
    for i in range(4):
        c[i] = 0.0
        for j in range(4):
            c[i] += p[i][j] * h[j]
        s += h[i] * c[i]
        nu -= h[i] * known[i]
    if period > 0.0:
        nu, off = wrap(nu, period), wrap(off, period)
    source.readings += READINGS * (off * off - source.readings)
    for i in range(4):
        known[i] += c[i] * nu / s
        for j in range(4):
            p[i][j] -= c[i] * c[j] / s
    z = nu / math.sqrt(s)
    source.up = max(0.0, source.up + z - SLACK)
    source.down = max(0.0, source.down - z - SLACK)
    source.news = False
    return source.up < ALARM and source.down < ALARM


def speed_of(source: Source, ahead: float, acceleration: float) -> float:
    """Return the speed that the newest value tells [rad/s].

    Parameters
    ----------
    ahead : time since the value [s]; its delay is added. acceleration : meanwhile [rad/s^2].
    """
    known = source.known
    told = known[RATIO] * source.value + known[BIAS]
    return told + acceleration * ahead + acceleration * known[SHIFT] / known[RATIO]


def variance_of_speed(source: Source) -> float:
    """Return the variance of that speed [(rad/s)^2]: noise, bias and ratio."""
    p, w = source.p, source.value
    return white(source) + p[BIAS][BIAS] + w * (2.0 * p[BIAS][RATIO] + w * p[RATIO][RATIO])


def agree(one: float, other: float, variance: float) -> bool:
    """Return True if two speeds [rad/s] may be the same, with the variance of their difference."""
    return (one - other) * (one - other) < APART * variance
