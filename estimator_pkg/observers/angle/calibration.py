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
noise explains. docs/coverage.md derives it.

Most samples pass without any work: a sample is an instant when it is `due`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from estimator_pkg.observers.circle import wrap
from estimator_pkg.observers.contract import TRACKING

SHORTEST, LONGEST = 4_000_000, 256_000_000  # spacing of the instants [ns]
MEMORY = 24.0  # errors over which their mean square is taken
CHANCE = 0.25  # of the published variance, which chance adds to the mean square
BOUND = 9.0  # of its mean, for the square of one error
FEWEST, MOST = 0.5, 1e6  # bounds of the mean square
HIDES = 0.3  # the noise hides an error: its variance exceeds this part of the published one
PATIENCE = 8  # instants that the spacing lasts before it is doubled, ...
LOOKS = 32  # ... and until the shortest one gets a look
FOUND = 1.5  # of the expected mean square at this spacing: a larger one is worth staying for
LEAP = 4.0  # quanta; a larger change after a rest is no creep
MOVING = 3  # of the four intervals, in which the reading has changed
READINGS = 32.0  # pairs of steps over which the noise is averaged
FOURTHS = 96.0  # the same by fourth differences; neighbouring ones share four of five readings
UNEVEN = 2.5  # a step of time, or between instants, longer by this factor is a hole
RESIDUE = 1e-9  # [rad] smaller differences are rounding, as are
ROUNDING = 2.0**-22  # those below this part of the reading
OF_DERIVATIVE = 130.0 / 144.0  # (1 + 64 + 64 + 1)/12^2: variance of the derivative, of the noise's
OF_FOURTH = 70.0  # 1 + 16 + 36 + 16 + 1: variance of the fourth difference, of the noise's
SHAKES = 2.0  # times that by fourth differences: a larger variance by second ones has motion in it
RESOLVED = 10.0 * OF_FOURTH  # a square of it beyond this is motion
LEAST = 1e-100  # a smaller standard deviation cannot be scaled

BROKEN = -1  # due: the instants before the next sample are void
NEVER = 1 << 62  # due: there is no calibration

# (instants so far; their stamps [ns], the newest first; the newest reading; the divided differences
# of orders 1 to 3 at it; the fourth difference over the spacing [rad/s]; 1 where the reading
# changed, in the three newest intervals; speed and its standard deviation at the newest instant and
# at the one before)
Chain = tuple[
    int,
    tuple[int, int, int, int],
    float,
    tuple[float, float, float],
    float,
    tuple[int, int, int],
    tuple[float, float, float, float],
]
# (mean square of the errors; spacing [ns]; instants since it changed, and their mean square, noise
# included; instants at rest; variance of the noise by second and by fourth differences [rad^2];
# smallest step [rad])
Learnt = tuple[float, int, int, float, int, float, float, float]
Calibration = tuple[float, Learnt, Chain]  # scale of the standard deviation, ...
Interval = tuple[int, Calibration]  # stamp from which the next sample is due [ns], ...

NO_CHAIN: Chain = (0, (0, 0, 0, 0), 0.0, (0.0, 0.0, 0.0), 0.0, (0, 0, 0), (0.0, 0.0, 0.0, 0.0))
FIRST_INTERVAL: Interval = (BROKEN, (1.0, (1.0, SHORTEST, 0, 0.0, 0, 0.0, 0.0, math.inf), NO_CHAIN))


class Sample(NamedTuple):
    """A sample and the two readings before it: stamp, readings, the times that they took [ns]."""

    stamp_ns: int
    measurement: float
    reading: float
    earlier: float
    passed_ns: int
    before_ns: int


def make_calibrate(
    output: Callable[..., tuple], stddev: Callable[..., tuple], period: float
) -> Callable[..., Interval]:
    """Return the function that calibrates an observer at a sample that is due.

    Parameters
    ----------
    output, stddev : of the observer; see `Functions`.
    period : wrap period [rad]; 0: none.
    """
    follow = _make_follow(period)

    def calibrate(
        interval: Interval,
        sample: tuple,
        state: tuple,
        coefficients: tuple,
        design: tuple,
        known_input: float,
    ) -> Interval:
        """Return the interval after a sample that was due; `sample` has the fields of `Sample`."""
        due_ns, (scale, learnt, chain) = interval
        stamp_ns, measurement, _, _, passed_ns, _ = sample
        _, speed, _, status = output(state, coefficients, design, measurement, known_input)
        _, sigma = stddev(state, coefficients, design)
        known = status == TRACKING and LEAST < sigma < math.inf
        if due_ns == BROKEN or not known:
            chain = NO_CHAIN
        if known:
            scale, learnt, chain = follow(scale, learnt, chain, sample, speed, sigma)
        _, spacing_ns, _, _, _, _, _, _ = learnt
        # the sample next to it
        return stamp_ns + spacing_ns - passed_ns // 2, (scale, learnt, chain)

    return calibrate


def no_calibration(
    interval: Interval,
    sample: tuple,
    state: tuple,
    coefficients: tuple,
    design: tuple,
    known_input: Any,
) -> Interval:
    """Replace `make_calibrate` for measurements that are not a single angle."""
    _, calibration = interval
    return NEVER, calibration


def follow_noise(
    variance: float, quantum: float, sample: tuple, moved: float, before: float
) -> tuple[float, float]:
    """Return (variance of the readings' noise [rad^2], their smallest step [rad]).

    White noise of variance R gives the difference of two steps 6 R, if they take the same time.

    Parameters
    ----------
    sample : the fields of `Sample`. moved, before : the newest step and the one before [rad].
    """
    _, measurement, _, _, passed_ns, before_ns = sample
    least = RESIDUE + ROUNDING * abs(measurement)
    size, change = abs(moved), abs(moved - before)
    if least < size < quantum:
        quantum = size
    if least < change < quantum:
        quantum = change
    ratio = passed_ns / before_ns
    bent = moved - ratio * before
    square = bent * bent / (2.0 + 2.0 * ratio * (1.0 + ratio))
    if variance == 0.0:
        return square, quantum
    return variance + (square - variance) / READINGS, quantum


def _make_follow(period: float) -> Callable[..., Calibration]:
    half = 0.5 * period if period > 0.0 else math.inf

    def change(later: float, sooner: float, expected: float) -> float:
        """Return by how much the angle changed [rad], on the turn next to `expected`."""
        moved = later - sooner
        if -half <= moved - expected < half:
            return moved
        return expected + wrap(moved - expected, period)

    def follow(
        scale: float, learnt: Learnt, chain: Chain, sample: tuple, speed: float, sigma: float
    ) -> Calibration:
        """Return the calibration after one more instant.

        Parameters
        ----------
        sample : the fields of `Sample`.
        speed, sigma : as published, without the scale [rad/s].
        """
        mean, spacing_ns, waited, level, still, variance, fourths, quantum = learnt
        count, (t1, t2, t3, t4), last, (rate, second, third), fourth, (c1, c2, c3), told = chain
        stamp_ns, measurement, reading, earlier, passed_ns, before_ns = sample
        v1, s1, v2, s2 = told
        c0 = 0
        if count > 0:
            moves = measurement != reading or reading != earlier
            if moves and UNEVEN * before_ns > passed_ns and UNEVEN * passed_ns > before_ns:
                pace = speed * 1e-9
                variance, quantum = follow_noise(
                    variance,
                    quantum,
                    sample,
                    change(measurement, reading, pace * passed_ns),
                    change(reading, earlier, pace * before_ns),
                )
            if measurement != last:
                c0 = 1
                leap = LEAP * quantum if quantum < math.inf else 0.0
                rested = c1 + c2 + c3 == 0 and spacing_ns > SHORTEST
                if rested and not -leap <= measurement - last <= leap:  # a motion begins
                    spacing_ns, waited, level, still, count = SHORTEST, 0, 0.0, 0, 0
            # divided differences, Newton's form
            h, before = (stamp_ns - t1) * 1e-9, (t1 - t2) * 1e-9
            r1, r2, r3 = rate, second, third
            rate = change(measurement, last, 0.5 * (speed + v1) * h) / h
            if count > 1 and not (h < UNEVEN * before and before < UNEVEN * h):
                count = 0  # no derivative is known to be so much worse
            if count > 1:
                second = (rate - r1) / ((stamp_ns - t2) * 1e-9)
            if count > 2:
                third = (second - r2) / ((stamp_ns - t3) * 1e-9)
            if count > 3:
                whole = (stamp_ns - t4) * 1e-9
                slope = (third - r3) / whole
                width = 0.25 * whole
                bend, fourth = fourth, 24.0 * slope * width * width * width
                if c0 + c1 + c2 + c3 < MOVING:
                    still += 1
                    if still >= PATIENCE and spacing_ns < LONGEST:
                        spacing_ns, still = 2 * spacing_ns, 0
                else:
                    still = 0
                    if fourths == 0.0:
                        fourths = SHAKES * variance  # few readings do not show it
                    least = quantum * quantum / 12.0 if quantum < math.inf else 0.0
                    # both contain motion; q^2/6 is that of single steps
                    noise = fourths if fourths > 2.0 * least else 2.0 * least
                    if variance < SHAKES * noise:
                        noise = variance if variance > least else least
                    noise /= width * width
                    most = RESOLVED * noise
                    shorter = spacing_ns > SHORTEST and spacing_ns > passed_ns
                    if shorter and (fourth * fourth > most or bend * bend > most):
                        spacing_ns, waited, level, count = spacing_ns // 2, 0, 0.0, 0
                    else:
                        bent = fourth * width
                        fourths += (bent * bent / OF_FOURTH - fourths) / FOURTHS
                        # the derivative at t2 of the polynomial through the five readings
                        to_0, to_1, to_3 = t2 - stamp_ns, t2 - t1, t2 - t3
                        of_third = 1e-18 * to_0 * to_1
                        later = rate + 1e-9 * (to_0 + to_1) * second
                        later += of_third * (third + 1e-9 * to_3 * slope)
                        noise *= OF_DERIVATIVE / (s2 * s2)
                        error = (v2 - later) / s2
                        mean = averaged(mean, error, noise)
                        scale = math.sqrt(mean - CHANCE) if mean > 1.0 + CHANCE else 1.0
                        waited += 1
                        level += (error * error - level) / waited
                        hidden = noise > HIDES * mean and level < FOUND * (noise + mean)
                        if waited >= PATIENCE and hidden and spacing_ns < LONGEST:
                            spacing_ns, waited, level = 2 * spacing_ns, 0, 0.0
                        elif waited >= LOOKS and shorter:
                            spacing_ns, waited, level, count = SHORTEST, 0, 0.0, 0
        chain = (
            count + 1,
            (stamp_ns, t1, t2, t3),
            measurement,
            (rate, second, third),
            fourth,
            (c0, c1, c2),
            (speed, sigma, v1, s1),
        )
        learnt = (mean, spacing_ns, waited, level, still, variance, fourths, quantum)
        return scale, learnt, chain

    return follow


def averaged(mean: float, error: float, noise: float) -> float:
    """Return the mean square of the errors after one more.

    An error that the noise hides counts less: its square has the variance 2 (mean + noise)^2.

    Parameters
    ----------
    error : of the published speed, as later readings show it [published standard deviations].
    noise : variance of this error's own error, in published variances.
    """
    square, widest = error * error - noise, mean + noise
    if square > BOUND * widest:
        square = BOUND * widest
    elif not square > -BOUND * widest:
        square = -BOUND * widest
    weight = mean / widest
    mean += weight * weight * (square - mean) / MEMORY
    if mean > FEWEST:
        return mean if mean < MOST else MOST
    return FEWEST  # also where it is nan
