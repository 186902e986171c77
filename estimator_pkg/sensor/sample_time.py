# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What time lies between two readings, as stamps and readings show it.

A sensor has a clock, and a stamp is the time of a reading plus an error: a clock that counts whole
milliseconds, a host that is late, a queue. Where samples are taken unevenly, the stamps are right.
Both look the same in the stamps; the readings decide. A filter of this file predicts each reading
at the stamp and at a whole number of periods; the odds of the two, from sample to sample, say what
a stamp is worth. So there are two ways for time to pass, by the stamps or by the period, and one
law for both: what is taken at one sample and stamped at another is taken off the next, so that
times add up to the stamps.

docs/stamps_and_quantisation.md derives it.
"""

from __future__ import annotations

import math

from estimator_pkg.record import record

EVEN = 0.005  # of the period: a stamp that is off by less is right either way
KNOWN = 16.0  # samples after which the period is known, and ...
FEW = 4.0  # ... as many changed readings, or regular stamps
SURE = 8.0  # log odds are clamped to this: one late stamp is seen, and as many true ones bury it
REGULAR = 4.0  # log odds from which on the period is believed, until they are below 0
EXPLAINED = 9.0  # (3)^2: variances of a prediction; a larger square is not explained by it
MEMORY = 32.0  # samples over which errors are averaged, and of the loop of the period
ODDS_MEMORY = 2.0 * MEMORY  # the same of the odds
MEAN_MEMORY = 2.0 * MEMORY  # and of the mean sample time
KEPT = 0.6  # of an error from sample to sample; critically damped filter of order 3:
OF_ANGLE = 1.0 - KEPT**3
OF_SPEED = 1.5 * (1.0 - KEPT) ** 2 * (1.0 + KEPT)
OF_ACCELERATION = (1.0 - KEPT) ** 3
OUTLYING = 3.0  # times the jitter: lateness counts no more in the loop
GOOD = 4.0  # times the variance by the stamps: the period predicts as well
SHORT = 0.1  # periods: so soon after another a sample may have waited
LEAST_TIME = 0.02  # periods: two readings are no closer
LATER = 1.25  # periods after another: a stamp that is later than the one before
LATER_IN_A_ROW = 3.0  # stamps: a stream that gets slower has no more
EARLIEST = 2.5  # periods: no stamp is that much earlier than its reading
CAUGHT_UP = 0.03  # of a sample time, in one sample: what was taken off the stamps is given back
LEAST_VARIANCE = 1e-24  # [rad^2] errors below are rounding
SHOWN = 0.1  # periods: the status reports a larger mean error of the stamps


@record
class Prediction:
    """A prediction of the readings."""

    beyond: float  # predicted minus read angle, after the newest reading [rad]
    velocity: float  # [rad/s]
    acceleration: float  # [rad/s^2]
    variance: float  # of its error [rad^2]


@record
class SampleTime:
    """The sensor's clock as stamps and readings show it."""

    period: float  # between two samples [s]; 0: not known
    count: float  # samples that have shown it
    locked: float  # of these, samples since it was another one
    phase: float  # newest stamp minus the newest sample at this period [s]
    mean_phase: float  # its mean [s]
    jitter: float  # mean size of it [s]
    later: float  # stamps in a row that were later than the one before
    queue: float  # log odds that a long sample time is that of one which waited
    early: float  # stamps in a row that were earlier than the one before
    mean: float  # sample time by the stamps [s]
    late: float  # newest stamp minus the time at which its reading was taken to be [s]
    even: bool  # the period is believed, and not the stamps
    odds: float  # logarithm of the odds of that
    usual: bool  # the newest reading was as predicted
    changes: float  # changed readings
    by_stamps: Prediction
    by_period: Prediction


def reset_sample_time(clock: SampleTime) -> None:
    """Forget all, the period too."""
    unknown = SampleTime()
    clock.take(unknown)
    begin_sample_time(clock)


def begin_sample_time(clock: SampleTime) -> None:
    """Begin before the first sample, or after a gap: the period is kept."""
    clock.phase = clock.mean_phase = clock.late = clock.changes = 0.0
    clock.locked = FEW
    clock.even, clock.later = False, 0.0


def sample_time(clock: SampleTime, passed: float, change: float) -> float:
    """Take a sample; return the time since the reading before it [s].

    Parameters
    ----------
    passed : between the stamps [s]. change : of the reading [rad].
    """
    period, even = clock.period, EVEN * clock.period
    odd = abs(passed - period)
    if clock.count >= KNOWN and clock.changes >= FEW:
        if odd + abs(clock.phase) + abs(clock.late) > even or clock.jitter > even:
            return judge(clock, passed, change)
    if clock.count < KNOWN:
        if passed > 2.0 * period:
            period, clock.count, clock.jitter = passed, 0.0, 0.0
            clock.period = passed
        elif passed < 0.5 * period:
            clock.count = min(clock.count, FEW)
            clock.early += 1.0
            if clock.early == LATER_IN_A_ROW:  # it is no hole that was the first
                period, clock.period = passed, passed
        else:
            clock.early = 0.0
        if odd < even and clock.count > FEW:
            clock.count = KNOWN
    clock.phase = clock.mean_phase = 0.0
    clock.count = min(clock.count + 1.0, 4.0 * MEMORY)
    clock.period += (passed - period) / clock.count
    clock.jitter += (odd - clock.jitter) / min(clock.count, MEMORY)
    if clock.changes == 0.0:
        begin_prediction(clock.by_stamps, max(passed, 0.5 * period), change)
        begin_prediction(clock.by_period, max(passed, 0.5 * period), change)
    else:
        clock.usual = miss(clock.by_period, passed, change) < EXPLAINED * clock.by_period.variance
        correct(clock.by_stamps, passed, change, clock.changes, period)
        correct(clock.by_period, passed, change, clock.changes, period)
    if change != 0.0:
        clock.changes = min(clock.changes + 1.0, MEMORY)
    clock.mean = clock.period
    least = LEAST_TIME * period if clock.count > FEW else 0.0
    return give_back(clock, passed, max(passed, least), 0.0)


def give_back(clock: SampleTime, passed: float, taken: float, late: float) -> float:
    """Return the time that is taken for a sample [s], so that times add up to the stamps.

    Parameters
    ----------
    passed : between the stamps [s]. taken : but for what was taken too much or too little [s].
    late : by how much this stamp is late [s].
    """
    most = CAUGHT_UP * taken
    taken += min(max(clock.late + passed - taken - late, -most), most)
    clock.late += passed - taken
    return taken


def judge(clock: SampleTime, passed: float, change: float) -> float:
    """Return the time that passed: by the stamp, or a whole number of periods."""
    period = clock.period
    variance = min(clock.by_stamps.variance, clock.by_period.variance)
    stamped = clock.phase + passed  # since the sample before, if this stamp is right
    number = max(1.0, float(math.floor(stamped / period + 0.5)))
    good = clock.by_period.variance < GOOD * clock.by_stamps.variance
    at_stamp = miss(clock.by_stamps, passed, change)
    at_number = miss(clock.by_period, number * period, change)
    later, waited, shows = passed > LATER * period, False, clock.late > 0.5 * period
    if number > 1.0:  # were samples lost, or is this one late?
        at_one = miss(clock.by_period, period, change)
        if later:  # it is, if the readings show it, and not later from sample to sample
            better = (min(at_number, at_stamp) - at_one) / (2.0 * variance)
            if at_one > EXPLAINED * variance or not clock.usual:
                better = min(better, 0.0)
            shows = better + clock.queue > REGULAR and better > -1.0 and clock.usual
            shows = shows and clock.later < LATER_IN_A_ROW
            waited = shows and (clock.even or (good and clock.late < period))
            if better > REGULAR or better < -REGULAR:
                clock.queue += ((SURE if better > 0.0 else -SURE) - clock.queue) / FEW
        else:  # it is late still, unless the readings show that it is not
            waited = at_one <= at_number
        if waited:
            number = number_shown(clock.by_period, period, change, number)
            at_number = miss(clock.by_period, number * period, change)
    clock.later = clock.later + 1.0 if later and waited else 0.0
    if passed < SHORT * period:  # behind one that waited, unless samples come so unevenly
        shows = at_number < at_stamp
        if abs(at_stamp - at_number) > 0.5 * (at_stamp + at_number):
            clock.queue += ((SURE if shows else -SURE) - clock.queue) / KNOWN
        waited = shows and clock.queue > REGULAR
    odds, way = 0.0, clock.by_period.velocity * (passed - number * period)
    if min(at_stamp, at_number) < EXPLAINED * variance and way * way > variance:
        odds = min(max((at_stamp - at_number) / (2.0 * variance), -SURE), SURE)
    odds += clock.odds * (1.0 - 1.0 / ODDS_MEMORY)
    clock.odds = min(max(odds, -SURE), SURE)
    clock.even = clock.odds > (0.0 if clock.even else REGULAR)
    clock.usual = min(at_stamp, at_number) < EXPLAINED * variance
    correct(clock.by_stamps, passed, change, clock.changes, period)
    correct(clock.by_period, number * period, change, clock.changes, period)
    if change != 0.0:
        clock.changes = min(clock.changes + 1.0, MEMORY)
    regular = follow_phase(clock, passed, number)
    if clock.even:
        return give_back(clock, passed, regular, clock.phase)
    if waited and shows:
        clock.late += passed - regular
        return regular
    return give_back(clock, passed, max(passed, LEAST_TIME * period), 0.0)


def number_shown(prediction: Prediction, period: float, change: float, most: float) -> float:
    """Return the number of periods, from 1 to `most`, in which the joint moved as it did."""
    way = prediction.velocity * period
    if way * way <= EXPLAINED * prediction.variance:
        return 1.0
    number = float(math.floor((change - prediction.beyond) / way + 0.5))
    return min(max(number, 1.0), most)


def follow_phase(clock: SampleTime, passed: float, number: float) -> float:
    """Follow period and phase by a loop of second order; return the time to the next sample [s].

    Parameters
    ----------
    number : of periods since the sample before.
    """
    period = clock.period
    clock.locked = min(clock.locked + 1.0, MEMORY)
    weight = 1.0 / clock.locked
    late = clock.phase + passed - number * period
    clock.mean += (passed - clock.mean) / MEAN_MEMORY
    near = 0.5 * period < passed < 1.5 * period
    # it is another period
    if not 0.5 * period < clock.mean < 2.0 * period or (near and late < -EARLIEST * period):
        clock.period = clock.mean
        clock.phase = clock.mean_phase = 0.0
        clock.odds = min(clock.odds, 0.0)
        clock.locked, clock.even = FEW, False
        return passed
    if not near:  # this stamp is far off: it shows no phase
        clock.phase = late
        return number * period
    clock.early = clock.early + 1.0 if late < clock.phase - CAUGHT_UP * period else 0.0
    twice = clock.phase < -period and clock.early < LATER_IN_A_ROW  # a pause was taken
    if clock.even and twice:
        clock.phase = late + CAUGHT_UP * period
        return (number - CAUGHT_UP) * period
    clock.jitter += weight * (min(abs(late), period) - clock.jitter)
    most = OUTLYING * clock.jitter
    clock.mean_phase += 2.0 * weight * (min(max(late, -most), most) - clock.mean_phase)
    shift = weight * clock.mean_phase
    clock.phase = late - shift
    clock.period += 0.25 * weight * shift
    return number * period + shift


def begin_prediction(prediction: Prediction, dt: float, change: float) -> None:
    """Begin with the line through the first two readings."""
    prediction.beyond = prediction.acceleration = 0.0
    prediction.velocity, prediction.variance = change / dt, LEAST_VARIANCE


def miss(prediction: Prediction, dt: float, change: float) -> float:
    """Return the square of the prediction's error after `dt` [s], in [rad^2]."""
    ahead = (prediction.velocity + 0.5 * prediction.acceleration * dt) * dt
    error = change - prediction.beyond - ahead
    return error * error


def correct(
    prediction: Prediction, dt: float, change: float, changes: float, period: float
) -> None:
    """Correct a prediction by a reading that was taken `dt` [s] after the one before."""
    ahead = (prediction.velocity + 0.5 * prediction.acceleration * dt) * dt
    error = change - prediction.beyond - ahead
    square, variance = max(error * error, LEAST_VARIANCE), prediction.variance
    if change != 0.0:  # a reading that rests shows no error
        if changes > FEW and square > EXPLAINED * variance:
            prediction.variance = min(square, 4.0 * variance)
        else:
            prediction.variance += (square - variance) / changes
    rate = 1.0 / max(dt, 0.5 * period)
    prediction.beyond = (OF_ANGLE - 1.0) * error
    prediction.velocity += prediction.acceleration * dt + OF_SPEED * error * rate
    prediction.acceleration += OF_ACCELERATION * error * rate * rate


def note_on_stamps(clock: SampleTime) -> str:
    """Return a note for the status on stamps that are wrong; '' if they are right."""
    if not clock.even or clock.jitter < SHOWN * clock.period:
        return ''
    return (
        f'stamps are off by {1e3 * clock.jitter:.2g} ms on average: samples are taken '
        f'{1e3 * clock.period:.4g} ms apart (stamp them where they are measured, or see '
        'stamp_repair)'
    )
