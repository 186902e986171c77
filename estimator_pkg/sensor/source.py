# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A rate from another sensor of the joint: its bias, ratio and delay, and the joint's speed by it.

    v(t) = r w(t + d) + b,   x(t) = x0 + r I(t) + b t + g w(t),   I' = w,   g = r d

w is the value of the source. The angle x is linear in the unknowns x0, b, r and g; a Kalman filter
of (x, b, r, g) estimates them. The source's noise drives x, and b is a slow random walk. The
innovation is white while the source agrees with the angle; cumulative sums of it (Page 1954)
detect when it does not.
"""

from __future__ import annotations

import math
from typing import Annotated

from estimator_pkg.circle import wrap
from estimator_pkg.record import record
from estimator_pkg.sensor.scatter import Scatter, begin_scatter, follow_scatter, resume_scatter

X, BIAS, SCALE, SHIFT = 0, 1, 2, 3  # places in the filter: x [rad], b [rad/s], r, g = r d [s]
UNKNOWN_BIAS, UNKNOWN_RATIO, UNKNOWN_DELAY = 1.0, 10.0, 0.02  # deviations before the first value
BIAS_WALK = 1e-4  # of the bias [rad/s per square root of a second]
READING_WEIGHT = 0.01  # weight of one reading in the mean square of reading minus estimate
CUSUM_SLACK, CUSUM_ALARM = 1.0, 12.0  # [deviations]: a false alarm in 10^10 readings
VALUES_LOST = 3.0  # sample times, after which values were lost
AGREEMENT_GATE = 25.0  # squared deviations between two speeds that do not agree


@record
class SourceFilter:
    """The unknowns of a source, and its newest value."""

    ratio: float  # set by the user; 0: learnt
    delay: float  # set by the user [s]; below 0: learnt
    known: Annotated[list[float], 4]  # x [rad], b [rad/s], r, g [s]
    p: Annotated[list[list[float]], 4, 4]  # their covariance
    scatter: Scatter  # of the values
    value: float  # w, the newest [its own unit]
    variance: float  # of its noise
    slope: float  # w' [per second]
    stamp_ns: int  # of it; 0: none yet
    dt: float  # between the last two values [s]
    readings: float  # mean square of reading minus estimate [rad^2]
    cusum_positive: float  # cumulative sums of the innovations [deviations]
    cusum_negative: float
    news: bool  # a value has come since the last reading
    h: Annotated[list[float], 4]  # the direction in which an angle sees x, b, r, g
    c: Annotated[list[float], 4]  # their covariance with it


def begin_source(source: SourceFilter, ratio: float, delay: float) -> None:
    """Start without a value."""
    blank = SourceFilter()
    source.take(blank)
    source.ratio, source.delay = ratio, delay


def forget_source(source: SourceFilter, angle: float) -> None:
    """Restart learning at this angle [rad]; ratio and delay that a user set stay."""
    ratio, delay = source.ratio, source.delay
    for i in range(4):
        for j in range(4):
            source.p[i][j] = 0.0
    source.known[BIAS] = 0.0
    source.known[SCALE] = ratio if ratio != 0.0 else 1.0
    source.known[SHIFT] = source.known[SCALE] * delay if delay > 0.0 else 0.0
    source.p[BIAS][BIAS] = UNKNOWN_BIAS * UNKNOWN_BIAS
    source.p[SCALE][SCALE] = UNKNOWN_RATIO * UNKNOWN_RATIO if ratio == 0.0 else 0.0
    source.p[SHIFT][SHIFT] = UNKNOWN_DELAY * UNKNOWN_DELAY if delay < 0.0 else 0.0
    resume_source(source, angle)


def follow_source(
    source: SourceFilter, stamp_ns: int, value: float, moved: float, variance: float
) -> None:
    """Take a value: the angle moves by its integral.

    Parameters
    ----------
    moved : integral since the value before; nan: by the trapezoidal rule.
    variance : of the value; 0: estimated from the values' scatter.
    """
    dt = (stamp_ns - source.stamp_ns) * 1e-9
    if source.stamp_ns == 0:
        begin_scatter(source.scatter, value)
        dt = 0.0
    else:
        follow_scatter(source.scatter, value, dt, math.inf)
        if math.isnan(moved):
            moved = 0.5 * (source.value + value) * dt
        source.known[X] += source.known[SCALE] * moved + source.known[BIAS] * dt
        for j in range(4):
            source.p[X][j] += dt * source.p[BIAS][j] + moved * source.p[SCALE][j]
        for i in range(4):
            source.p[i][X] += dt * source.p[i][BIAS] + moved * source.p[i][SCALE]
        source.p[BIAS][BIAS] += BIAS_WALK * BIAS_WALK * dt
        source.slope = (value - source.value) / dt
        if source.dt > 0.0 and dt > VALUES_LOST * source.dt:  # the motion in between is unknown
            source.p[X][X] += moved * moved * source.known[SCALE] * source.known[SCALE]
            resume_scatter(source.scatter, value)
            dt = source.dt
    source.variance = source.scatter.variance if variance == 0.0 else variance
    source.p[X][X] += noise_variance(source) * dt * dt
    source.value, source.stamp_ns, source.dt, source.news = value, stamp_ns, dt, True


def resume_source(source: SourceFilter, angle: float) -> None:
    """Continue at another angle [rad], after a hole or a disagreement."""
    known, p, w = source.known, source.p, source.value
    known[X] = angle - w * known[SHIFT]
    for i in range(4):
        p[X][i] = p[i][X] = -w * p[SHIFT][i]
    p[X][X] = source.readings + w * w * p[SHIFT][SHIFT]
    source.cusum_positive = source.cusum_negative = 0.0


def noise_variance(source: SourceFilter) -> float:
    """Return the variance of a value's noise, as a speed [(rad/s)^2]."""
    return source.known[SCALE] * source.known[SCALE] * source.variance


def correct_by_angle(
    source: SourceFilter,
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
    reading : [rad]. angle : estimated from readings alone [rad]. step : displacement between two
        readings [rad]; if it exceeds a count, the errors of readings are white and readings are
        used, because the estimate's lag would be learnt as a delay.
    r : variance of the estimate [rad^2]. period : wrap period [rad]; 0: none.
    """
    apart, ahead = reading - angle, (stamp_ns - source.stamp_ns) * 1e-9
    h, c, known, p = source.h, source.c, source.known, source.p
    h[X], h[BIAS], h[SHIFT] = 1.0, ahead, source.value
    h[SCALE] = (source.value + 0.5 * source.slope * ahead) * ahead
    s, nu = source.readings + r, reading if step * step > 12.0 * source.readings else angle
    for i in range(4):
        c[i] = 0.0
        for j in range(4):
            c[i] += p[i][j] * h[j]
        s += h[i] * c[i]
        nu -= h[i] * known[i]
    if period > 0.0:
        nu, apart = wrap(nu, period), wrap(apart, period)
    source.readings += READING_WEIGHT * (apart * apart - source.readings)
    for i in range(4):
        known[i] += c[i] * nu / s
        for j in range(4):
            p[i][j] -= c[i] * c[j] / s
    z = nu / math.sqrt(s)
    source.cusum_positive = max(0.0, source.cusum_positive + z - CUSUM_SLACK)
    source.cusum_negative = max(0.0, source.cusum_negative - z - CUSUM_SLACK)
    source.news = False
    return source.cusum_positive < CUSUM_ALARM and source.cusum_negative < CUSUM_ALARM


def speed_of(source: SourceFilter, ahead: float, acceleration: float) -> float:
    """Return the joint's speed by the newest value [rad/s].

    Parameters
    ----------
    ahead : time since the value [s]; its delay is added. acceleration : of the joint [rad/s^2].
    """
    known = source.known
    speed = known[SCALE] * source.value + known[BIAS]
    return speed + acceleration * ahead + acceleration * known[SHIFT] / known[SCALE]


def variance_of_speed(source: SourceFilter) -> float:
    """Return the variance of that speed [(rad/s)^2]: noise, bias and ratio."""
    p, w = source.p, source.value
    return noise_variance(source) + p[BIAS][BIAS] + w * (2.0 * p[BIAS][SCALE] + w * p[SCALE][SCALE])


def agree(one: float, other: float, variance: float) -> bool:
    """Return True if two speeds [rad/s] may be the same, with the variance of their difference."""
    return (one - other) * (one - other) < AGREEMENT_GATE * variance
