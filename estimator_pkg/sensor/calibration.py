# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The scale of an observer's standard deviation, from the readings that came later.

An observer's standard deviation contains the noise behind it, but not its lag. Two instants later a
speed is known better: the readings at five instants, `SPACING_NS` apart, give the speed at the
middle one by the derivative of the polynomial through them (Fornberg 1988, five points). Its error
is known: the noise of the readings, as their differences show it. What the published speed differs
by beyond that is its own error. The mean square of this error, in published standard
deviations, scales the next ones. docs/evidence.md derives it.

Most samples pass without any work: a sample is an instant when it is `due`.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.circle import wrap
from estimator_pkg.estimate import TRACKING, Deviation, Estimate
from estimator_pkg.record import record
from estimator_pkg.sensor.guard import Limits

SPACING_NS = 10_000_000  # of the instants [ns], or a sample time; where the reading rests,
LONGEST_NS = 256_000_000  # until it changes, but no longer than this [ns]
ERROR_MEMORY = 24.0  # errors over which their mean square is taken
CHANCE_VARIANCE = 0.25  # of the published variance, which chance adds to the mean square
LARGEST_SQUARE = 9.0  # of its mean, for the square of one error
LEAST_MEAN_SQUARE = 0.5  # least mean square
LARGEST_MEAN_SQUARE = 1e6  # largest mean square
NOISE_MEMORY = 96.0  # differences of which the noise is the mean; neighbours share readings
HOLE_RATIO = 2.5  # an interval that is longer by this factor than its neighbour is a hole
OF_DERIVATIVE = 130.0 / 144.0  # (1 + 64 + 64 + 1)/12^2: variance of the derivative, of the noise's
OF_SECOND = 6.0  # 1 + 4 + 1: variance of a second difference, of the noise's
OF_FOURTH = 70.0  # 1 + 16 + 36 + 16 + 1: variance of the fourth difference, of the noise's
LEAST_SIGMA = 1e-100  # a smaller standard deviation cannot be scaled

BROKEN = -1  # due: the instants before the next sample are void


@record
class Instants:
    """The newest instants."""

    count: int
    t1: int  # their stamps, the newest first [ns]
    t2: int
    t3: int
    t4: int
    last: float  # reading at the newest instant [rad]
    rate: float  # divided differences of orders 1 to 3 at it
    second: float
    third: float
    v1: float  # speed and its standard deviation at the newest instant, as published [rad/s]
    s1: float
    v2: float  # the same at the instant before
    s2: float


@record
class Calibration:
    """The scale of a standard deviation, and how it is learnt."""

    due_ns: int  # stamp from which the next sample is an instant; BROKEN
    scale: float  # of the standard deviation
    mean: float  # mean square of the errors [published variances]
    # variance of the readings' noise by fourth differences of instants, and by second differences
    # of samples [rad^2]: both contain motion
    fourths: float
    seconds: float
    fourths_known: float  # differences that have shown it, at most `NOISE_MEMORY`
    seconds_known: float
    chain: Instants


def begin_calibration(calibration: Calibration) -> None:
    """Set the calibration before the first sample."""
    blank = Calibration()
    calibration.take(blank)
    calibration.due_ns = BROKEN
    calibration.scale = calibration.mean = 1.0


def calibrate(
    observer: Any,
    track: Any,
    design: Any,
    limits: Limits,
    stamp_ns: int,
    measurement: float,
    known_input: float,
) -> None:
    """Take a sample that is due.

    Parameters
    ----------
    track : after the sample, but with the readings before it. measurement : its reading [rad].
    """
    calibration, chain = track.calibration, track.calibration.chain
    broken = calibration.due_ns == BROKEN
    calibration.due_ns = stamp_ns + SPACING_NS - track.clock.dt_ns // 2  # the sample next to it
    rests = chain.count > 0 and measurement == chain.last and stamp_ns - chain.t1 < LONGEST_NS
    if rests and not broken:
        return
    now = Estimate()
    sigma = Deviation()
    observer.estimate(
        observer, now, track.state, track.coefficients, design, measurement, known_input
    )
    observer.deviation(observer, sigma, track.state, track.coefficients, design, 1.0)
    known = now.status == TRACKING and LEAST_SIGMA < sigma.velocity < math.inf
    if broken or not known:
        blank = Instants()
        chain.take(blank)
    if known:
        if measurement != track.reading or track.reading != track.earlier:
            bent = wrap(measurement - 2.0 * track.reading + track.earlier, limits.period)
            calibration.seconds_known = min(calibration.seconds_known + 1.0, NOISE_MEMORY)
            square = bent * bent / OF_SECOND
            calibration.seconds += (square - calibration.seconds) / calibration.seconds_known
        take_instant(
            calibration, stamp_ns, measurement, now.velocity, sigma.velocity, limits.period
        )


def take_instant(
    calibration: Calibration,
    stamp_ns: int,
    measurement: float,
    speed: float,
    sigma: float,
    period: float,
) -> None:
    """Follow the divided differences, Newton's form; the fifth instant shows an error.

    Parameters
    ----------
    speed, sigma : as published, without the scale [rad/s]. period : wrap period [rad]; 0: none.
    """
    chain = calibration.chain
    if chain.count > 0:
        h, before = (stamp_ns - chain.t1) * 1e-9, (chain.t1 - chain.t2) * 1e-9
        r1, r2, r3 = chain.rate, chain.second, chain.third
        usual = 0.5 * (speed + chain.v1) * h  # it may be more than half a turn
        chain.rate = (usual + wrap(measurement - chain.last - usual, period)) / h
        if chain.count > 1 and not (h < HOLE_RATIO * before and before < HOLE_RATIO * h):
            chain.count = 0  # no derivative is known to be so much worse
        if chain.count > 1:
            chain.second = (chain.rate - r1) / ((stamp_ns - chain.t2) * 1e-9)
        if chain.count > 2:
            chain.third = (chain.second - r2) / ((stamp_ns - chain.t3) * 1e-9)
        if chain.count > 3:
            whole = (stamp_ns - chain.t4) * 1e-9
            take_error(calibration, stamp_ns, (chain.third - r3) / whole, 0.25 * whole)
    chain.count += 1
    chain.t4, chain.t3, chain.t2, chain.t1 = chain.t3, chain.t2, chain.t1, stamp_ns
    chain.last = measurement
    chain.v2, chain.s2, chain.v1, chain.s1 = chain.v1, chain.s1, speed, sigma


def take_error(calibration: Calibration, stamp_ns: int, slope: float, width: float) -> None:
    """Take the error at the instant before the newest one.

    Parameters
    ----------
    slope : divided difference of order 4. width : mean spacing of the five instants [s].
    """
    chain = calibration.chain
    fourth = 24.0 * slope * width * width * width * width
    calibration.fourths_known = min(calibration.fourths_known + 1.0, NOISE_MEMORY)
    square = fourth * fourth / OF_FOURTH
    calibration.fourths += (square - calibration.fourths) / calibration.fourths_known
    # the derivative at t2 of the polynomial through the five readings
    to_0, to_1, to_3 = chain.t2 - stamp_ns, chain.t2 - chain.t1, chain.t2 - chain.t3
    later = chain.rate + 1e-9 * (to_0 + to_1) * chain.second
    later += 1e-18 * to_0 * to_1 * (chain.third + 1e-9 * to_3 * slope)
    noise = min(calibration.fourths, calibration.seconds)
    noise *= OF_DERIVATIVE / (width * width * chain.s2 * chain.s2)
    mean = averaged_square(calibration.mean, (chain.v2 - later) / chain.s2, noise)
    calibration.mean = mean
    calibration.scale = math.sqrt(mean - CHANCE_VARIANCE) if mean > 1.0 + CHANCE_VARIANCE else 1.0


def averaged_square(mean: float, error: float, noise: float) -> float:
    """Return the mean square of the errors after one more.

    An error that the noise hides counts less: its square has the variance 2 (mean + noise)^2.

    Parameters
    ----------
    error : of the published speed, as later readings show it [published standard deviations].
    noise : variance of this error's own error, in published variances.
    """
    square, widest = error * error - noise, mean + noise
    if square > LARGEST_SQUARE * widest:
        square = LARGEST_SQUARE * widest
    elif not square > -LARGEST_SQUARE * widest:
        square = -LARGEST_SQUARE * widest
    weight = mean / widest
    mean += weight * weight * (square - mean) / ERROR_MEMORY
    if mean > LEAST_MEAN_SQUARE:
        return mean if mean < LARGEST_MEAN_SQUARE else LARGEST_MEAN_SQUARE
    return LEAST_MEAN_SQUARE  # also where it is nan
