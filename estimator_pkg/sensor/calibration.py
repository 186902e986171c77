# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The scale of an observer's standard deviation, from the readings that came later.

An observer's standard deviation contains the noise behind it, but not its lag. Two instants later a
speed is known better: the readings at five instants, `spacing` apart, give the speed at the middle
one by the derivative of the polynomial through them (Fornberg 1988, five points). Its error is
known: the noise of the readings. What the published speed differs by beyond that is its own error.
The mean square of this error, in published standard deviations, scales the next ones.

The spacing is a compromise. Doubled, it quarters the noise's variance; too long, it does not
resolve the motion. It is doubled while the noise hides the error, and halved where the fourth
difference of the readings exceeds their noise. A vibration looks like noise at a long spacing, so
the shortest one gets a look now and then, and is kept while it shows larger errors than the
noise explains. docs/evidence.md derives it.

Most samples pass without any work: a sample is an instant when it is `due`.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.circle import wrap
from estimator_pkg.estimate import TRACKING, Deviation, Estimate
from estimator_pkg.record import record
from estimator_pkg.sensor.guard import Limits

SHORTEST_SPACING_NS = 4_000_000  # spacing of the instants [ns], at least
LONGEST_SPACING_NS = 256_000_000  # and at most
ERROR_MEMORY = 24.0  # errors over which their mean square is taken
CHANCE_VARIANCE = 0.25  # of the published variance, which chance adds to the mean square
LARGEST_SQUARE = 9.0  # of its mean, for the square of one error
LEAST_MEAN_SQUARE = 0.5  # least mean square
LARGEST_MEAN_SQUARE = 1e6  # largest mean square
HIDES = 0.3  # the noise hides an error: its variance exceeds this part of the published one
DOUBLED_AFTER = 8  # instants that the spacing lasts before it is doubled, ...
PROBED_AFTER = 32  # ... and until the shortest one gets a look
FOUND = 1.5  # of the expected mean square at this spacing: a larger one is worth staying for
LARGEST_CREEP = 4.0  # quanta; a larger change after a rest is no creep
CHANGED_INTERVALS = 3  # of the four intervals, in which the reading has changed
SECONDS_MEMORY = 32.0  # pairs of steps over which the noise is averaged
FOURTHS_MEMORY = 96.0  # the same by fourth differences; neighbours share four of five readings
HOLE_RATIO = 2.5  # a step of time, or between instants, longer by this factor is a hole
LEAST_DIFFERENCE = 1e-9  # [rad] smaller differences are rounding, as are
LEAST_RELATIVE_DIFFERENCE = 2.0**-22  # those below this part of the reading
OF_DERIVATIVE = 130.0 / 144.0  # (1 + 64 + 64 + 1)/12^2: variance of the derivative, of the noise's
OF_FOURTH = 70.0  # 1 + 16 + 36 + 16 + 1: variance of the fourth difference, of the noise's
SHAKES = 2.0  # times that by fourth differences: a larger variance by second ones has motion in it
RESOLVED = 10.0 * OF_FOURTH  # a square of it beyond this is motion
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
    fourth: float  # fourth difference over the spacing [rad/s]
    c1: int  # 1 where the reading changed, in the three newest intervals
    c2: int
    c3: int
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
    spacing_ns: int  # of the instants
    waited: int  # instants since the spacing changed
    level: float  # their mean square, noise included
    still: int  # instants at rest
    variance: float  # of the noise, by second differences [rad^2]
    fourths: float  # the same by fourth differences
    quantum: float  # smallest step [rad]
    chain: Instants


def begin_calibration(calibration: Calibration) -> None:
    """Set the calibration before the first sample."""
    blank = Calibration()
    calibration.take(blank)
    calibration.due_ns = BROKEN
    calibration.scale = calibration.mean = 1.0
    calibration.spacing_ns = SHORTEST_SPACING_NS
    calibration.quantum = math.inf


def calibrate(
    observer: Any,
    track: Any,
    design: Any,
    limits: Limits,
    stamp_ns: int,
    measurement: float,
    known_input: float,
    before_ns: int,
) -> None:
    """Take a sample that is due.

    Parameters
    ----------
    track : after the sample, but with the readings before it. measurement : its reading [rad].
    before_ns : the sample time before the last one.
    """
    calibration, passed_ns = track.calibration, track.clock.dt_ns
    now = Estimate()
    sigma = Deviation()
    observer.estimate(
        observer, now, track.state, track.coefficients, design, measurement, known_input
    )
    observer.deviation(observer, sigma, track.state, track.coefficients, design, 1.0)
    known = now.status == TRACKING and LEAST_SIGMA < sigma.velocity < math.inf
    if calibration.due_ns == BROKEN or not known:
        blank = Instants()
        calibration.chain.take(blank)
    if known:
        follow_calibration(
            calibration,
            stamp_ns,
            measurement,
            track.reading,
            track.earlier,
            passed_ns,
            before_ns,
            now.velocity,
            sigma.velocity,
            limits.period,
        )
    # the sample next to it
    calibration.due_ns = stamp_ns + calibration.spacing_ns - passed_ns // 2


def follow_reading_noise(
    calibration: Calibration,
    measurement: float,
    moved: float,
    before: float,
    passed_ns: int,
    before_ns: int,
) -> None:
    """Follow the variance of the readings' noise and their smallest step.

    White noise of variance R gives the difference of two steps 6 R, if they take the same time.

    Parameters
    ----------
    moved, before : the newest step and the one before [rad].
    passed_ns, before_ns : the times that they took.
    """
    least = LEAST_DIFFERENCE + LEAST_RELATIVE_DIFFERENCE * abs(measurement)
    size, change = abs(moved), abs(moved - before)
    if least < size < calibration.quantum:
        calibration.quantum = size
    if least < change < calibration.quantum:
        calibration.quantum = change
    ratio = passed_ns / before_ns
    bent = moved - ratio * before
    square = bent * bent / (2.0 + 2.0 * ratio * (1.0 + ratio))
    if calibration.variance == 0.0:
        calibration.variance = square
    else:
        calibration.variance += (square - calibration.variance) / SECONDS_MEMORY


def change(later: float, sooner: float, expected: float, period: float) -> float:
    """Return by how much the angle changed [rad], on the turn next to `expected`."""
    moved = later - sooner
    half = 0.5 * period if period > 0.0 else math.inf
    if -half <= moved - expected < half:
        return moved
    return expected + wrap(moved - expected, period)


def restart_spacing(calibration: Calibration, spacing_ns: int) -> None:
    """Use another spacing from now on."""
    calibration.spacing_ns, calibration.waited, calibration.level = spacing_ns, 0, 0.0


def follow_calibration(
    calibration: Calibration,
    stamp_ns: int,
    measurement: float,
    reading: float,
    earlier: float,
    passed_ns: int,
    before_ns: int,
    speed: float,
    sigma: float,
    period: float,
) -> None:
    """Take one more instant.

    Parameters
    ----------
    measurement, reading, earlier : the newest readings [rad].
    passed_ns, before_ns : the times between them.
    speed, sigma : as published, without the scale [rad/s].
    """
    chain = calibration.chain
    changed = 0
    if chain.count > 0:
        moves = measurement != reading or reading != earlier
        passed, since = float(passed_ns), float(before_ns)
        if moves and HOLE_RATIO * since > passed and HOLE_RATIO * passed > since:
            pace = speed * 1e-9
            moved = change(measurement, reading, pace * passed_ns, period)
            before = change(reading, earlier, pace * before_ns, period)
            follow_reading_noise(calibration, measurement, moved, before, passed_ns, before_ns)
        if measurement != chain.last:
            changed = 1
            quantum = calibration.quantum
            leap = LARGEST_CREEP * quantum if quantum < math.inf else 0.0
            rested = (
                chain.c1 + chain.c2 + chain.c3 == 0 and calibration.spacing_ns > SHORTEST_SPACING_NS
            )
            if rested and not -leap <= measurement - chain.last <= leap:  # a motion begins
                restart_spacing(calibration, SHORTEST_SPACING_NS)
                calibration.still = chain.count = 0
        differentiate(calibration, stamp_ns, measurement, speed, changed, passed_ns, period)
    chain.count += 1
    chain.t4, chain.t3, chain.t2, chain.t1 = chain.t3, chain.t2, chain.t1, stamp_ns
    chain.last = measurement
    chain.c3, chain.c2, chain.c1 = chain.c2, chain.c1, changed
    chain.v2, chain.s2, chain.v1, chain.s1 = chain.v1, chain.s1, speed, sigma


def differentiate(
    calibration: Calibration,
    stamp_ns: int,
    measurement: float,
    speed: float,
    changed: int,
    passed_ns: int,
    period: float,
) -> None:
    """Follow the divided differences, Newton's form; the fifth instant shows an error."""
    chain = calibration.chain
    h, before = (stamp_ns - chain.t1) * 1e-9, (chain.t1 - chain.t2) * 1e-9
    r1, r2, r3 = chain.rate, chain.second, chain.third
    chain.rate = change(measurement, chain.last, 0.5 * (speed + chain.v1) * h, period) / h
    if chain.count > 1 and not (h < HOLE_RATIO * before and before < HOLE_RATIO * h):
        chain.count = 0  # no derivative is known to be so much worse
    if chain.count > 1:
        chain.second = (chain.rate - r1) / ((stamp_ns - chain.t2) * 1e-9)
    if chain.count > 2:
        chain.third = (chain.second - r2) / ((stamp_ns - chain.t3) * 1e-9)
    if chain.count > 3:
        whole = (stamp_ns - chain.t4) * 1e-9
        slope = (chain.third - r3) / whole
        width = 0.25 * whole
        bend = chain.fourth
        chain.fourth = 24.0 * slope * width * width * width
        if changed + chain.c1 + chain.c2 + chain.c3 < CHANGED_INTERVALS:
            calibration.still += 1
            if calibration.still >= DOUBLED_AFTER and calibration.spacing_ns < LONGEST_SPACING_NS:
                calibration.spacing_ns, calibration.still = 2 * calibration.spacing_ns, 0
        else:
            calibration.still = 0
            take_error(calibration, stamp_ns, slope, width, bend, passed_ns)


def take_error(
    calibration: Calibration, stamp_ns: int, slope: float, width: float, bend: float, passed_ns: int
) -> None:
    """Take the error at the instant before the newest one, and choose the spacing.

    Parameters
    ----------
    slope : divided difference of order 4. width : mean spacing of the five instants [s].
    bend : the fourth difference over the spacing, one instant before [rad/s].
    """
    chain = calibration.chain
    if calibration.fourths == 0.0:
        calibration.fourths = SHAKES * calibration.variance  # few readings do not show it
    quantum, variance = calibration.quantum, calibration.variance
    least = quantum * quantum / 12.0 if quantum < math.inf else 0.0
    # both contain motion; q^2/6 is that of single steps
    noise = calibration.fourths if calibration.fourths > 2.0 * least else 2.0 * least
    if variance < SHAKES * noise:
        noise = variance if variance > least else least
    noise /= width * width
    most = RESOLVED * noise
    spacing_ns = calibration.spacing_ns
    shorter = spacing_ns > SHORTEST_SPACING_NS and spacing_ns > passed_ns
    if shorter and (chain.fourth * chain.fourth > most or bend * bend > most):
        restart_spacing(calibration, spacing_ns // 2)
        chain.count = 0
        return
    bent = chain.fourth * width
    calibration.fourths += (bent * bent / OF_FOURTH - calibration.fourths) / FOURTHS_MEMORY
    # the derivative at t2 of the polynomial through the five readings
    to_0, to_1, to_3 = chain.t2 - stamp_ns, chain.t2 - chain.t1, chain.t2 - chain.t3
    of_third = 1e-18 * to_0 * to_1
    later = chain.rate + 1e-9 * (to_0 + to_1) * chain.second
    later += of_third * (chain.third + 1e-9 * to_3 * slope)
    noise *= OF_DERIVATIVE / (chain.s2 * chain.s2)
    error = (chain.v2 - later) / chain.s2
    mean = averaged_square(calibration.mean, error, noise)
    calibration.mean = mean
    calibration.scale = math.sqrt(mean - CHANCE_VARIANCE) if mean > 1.0 + CHANCE_VARIANCE else 1.0
    calibration.waited += 1
    calibration.level += (error * error - calibration.level) / calibration.waited
    hidden = noise > HIDES * mean and calibration.level < FOUND * (noise + mean)
    if calibration.waited >= DOUBLED_AFTER and hidden and spacing_ns < LONGEST_SPACING_NS:
        restart_spacing(calibration, 2 * spacing_ns)
    elif calibration.waited >= PROBED_AFTER and shorter:
        restart_spacing(calibration, SHORTEST_SPACING_NS)
        chain.count = 0


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
