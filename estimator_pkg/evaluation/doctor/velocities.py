# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The velocities that a user has today, against the off-line reference.

Noise and delay of finite differences; factor, sign and delay of the velocity in the messages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator_pkg.bags.series import at_stamps
from estimator_pkg.evaluation import pairs
from estimator_pkg.evaluation.checks.joint import FEWEST_FOR_REFERENCE
from estimator_pkg.evaluation.checks.readings import DIFFERENCE, Array, Readings, Rows, late_by
from estimator_pkg.evaluation.checks.row import PASS, WARN, Check, Finding
from estimator_pkg.evaluation.delay import LONGEST_DELAY, UNKNOWN_DELAY, Delay, measured
from estimator_pkg.evaluation.ranking.cautions import JUDGE_BY_TRUTH, contradiction
from estimator_pkg.evaluation.reference.motion import ReferenceMotion
from estimator_pkg.evaluation.signals import cubic
from estimator_pkg.parameters import declared

LATE_TIME, LATE_STEPS = 2e-3, 3.0  # a published velocity later than both [s, samples] is reported
FACTOR_TOLERANCE = 0.05  # a factor further from 1 than this, and than its interval, is wrong
ALIKE = 0.5  # smaller part of the variance that the motion explains: it is another signal
EXPLAINS = 0.98  # larger part of it that the position explains: proportional to that
NEAR_BEST = 0.02  # of the variance: shorter delays within this of the best one are as good
MOST_SHIFTS = 400  # shifts that are tried
AVERAGED = 0.05  # time over which both are averaged against noise [s]
UNITS = {60.0 / math.tau: 'rpm', 360.0 / math.tau: 'deg/s', 1.0 / math.tau: 'turns per second'}
DRIVER = 'correct it in the driver, or use the estimate of a node instead'

LOW_PASS = declared(type(DIFFERENCE.joint().observer.gains()))['bandwidth_hz'].default
TODAY = {
    'none': 'no reference: the joint moves too little',
    'error': '{how}: noise {noise:.3g} rad/s, {late}, at {rms_speed:.3g} rad/s rms',
}
MEASURES = 'noise and delay against the off-line reference'
NEVER = 'never: this is what you have today'
DIFFERENCES = (
    Check('finite difference', MEASURES, NEVER, TODAY),
    Check('low-passed', MEASURES, NEVER, TODAY),
)
REFERENCE = Check(
    'reference',
    'noise that the off-line reference fits against the scatter of the readings',
    'above five times; else not listed',
    {'contradicted': f'{{contradiction}} -> {JUDGE_BY_TRUTH}'},
)
TOPIC = 'that of the topic: noise {noise:.3g} rad/s, {late}'
PUBLISHED = Check(
    'published velocity',
    'noise, delay, factor and sign of the velocity in the messages',
    f'later than {LATE_STEPS:g} samples and {LATE_TIME * 1e3:g} ms; a factor '
    f'{100 * FACTOR_TOLERANCE:g} % off, a sign, another unit, the position, a constant, another '
    'signal',
    {
        'right': TOPIC,
        'late': f'{TOPIC} -> use the estimate of a node instead',
        'wrong': 'that of the topic is {wrong} -> {remedy}',
        'wrong_late': 'that of the topic is {wrong}; {late} -> {remedy}',
    },
)
CHECKS = (*DIFFERENCES, REFERENCE, PUBLISHED)


def checks(seen: Readings, found: ReferenceMotion | None, rows: Rows) -> list[Finding]:
    """Return the findings on the raw and the low-passed difference, and a published velocity.

    One on the reference comes first if its readings contradict it.

    Parameters
    ----------
    found : as `reference` returns it. rows : the readings that it is of.
    """
    if found is None:
        return [check.found(PASS, ['none']) for check in DIFFERENCES]
    firm = found.firm
    time, truth = found.time[firm], found.velocity[firm]
    speed = float(np.sqrt(np.mean(truth * truth)))
    numbers = {'rms_speed': speed, 'reference_stddev': found.stddev}

    def error(values: Array, late: Delay | None = None) -> tuple[dict[str, float], Delay]:
        """Return (numbers, delay); the noise is the error beyond the delay."""
        at = at_stamps(found.stamps[firm], seen.stamps_ns[rows], values[rows])
        good = np.isfinite(at)
        if np.count_nonzero(good) < FEWEST_FOR_REFERENCE:
            rms = noise = math.nan
            late = late or UNKNOWN_DELAY
        else:
            own = measured(time[good], at[good], truth[good]).known
            then = cubic(time, truth, time[good] - np.nan_to_num(own.late))
            rms, noise, late = _rms(at[good] - truth[good]), _rms(at[good] - then), late or own
        return {'rms': rms, 'noise': noise, 'delay_s': late.late, 'delay_95_s': late.half}, late

    raw = np.full(len(seen.stamps_ns), np.nan)
    later = seen.rows[1:][seen.joined]
    raw[later] = seen.moves[seen.joined] / seen.steps[seen.joined]
    result = []
    if found.smoothed.contradicted:
        words = {'contradiction': contradiction(found.smoothed)}
        result.append(REFERENCE.found(WARN, ['contradicted'], {}, words))
    ways = ('raw', raw), (f'at {LOW_PASS:g} Hz', seen.difference.velocity)
    for check, (how, values) in zip(DIFFERENCES, ways):
        more, late = error(values)
        words = {'how': how, 'late': late_by(late)}
        result.append(check.found(PASS, ['error'], numbers | more, words))
    known = np.isfinite(seen.velocity[rows])
    at = at_stamps(found.stamps[firm], seen.stamps_ns[rows][known], seen.velocity[rows][known])
    good = np.isfinite(at)
    if np.count_nonzero(good) > FEWEST_FOR_REFERENCE:
        given = time[good], at[good], truth[good], found.position[firm][good]
        published = relation(*given, found.uncertainty)
        more, late = error(seen.velocity, published.late)
        more |= {'factor': published.factor, 'wrong': bool(published.wrong)}
        slow = late.late - late.half > max(LATE_TIME, LATE_STEPS * seen.step)
        text = 'late' if slow else 'right'
        if published.wrong:
            text = 'wrong_late' if math.isfinite(late.late) else 'wrong'
        words = {'wrong': published.wrong, 'remedy': published.remedy, 'late': late_by(late)}
        level = PASS if text == 'right' else WARN
        result.append(PUBLISHED.found(level, [text], numbers | more, words))
    return result


def misleads(findings: Sequence[Finding]) -> bool:
    """Return True if the velocity in the messages is not that of the joint."""
    return any(each.check == PUBLISHED.name and each.numbers.get('wrong') for each in findings)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


class Relation(NamedTuple):
    """What a published velocity is.

    wrong : in words; '' if it is right. remedy : to it. factor : of the velocity, with its sign;
    nan: unknown. late : its delay.
    """

    wrong: str
    remedy: str
    factor: float
    late: Delay


def relation(time: Array, values: Array, truth: Array, position: Array, unsure: float) -> Relation:
    """Return what the published `values` are.

    Parameters
    ----------
    time, values, truth, position : shape (n,): time [s], velocities and unwrapped position.
    unsure : standard deviation of `truth` [rad/s].
    """
    if np.ptp(values) == 0.0:
        what = 'zero' if values[0] == 0.0 else f'constant at {values[0]:.3g} rad/s'
        moves = float(np.std(truth)) > max(3.0 * unsure, 0.05 * abs(float(np.mean(truth))))
        what = f'{what}, though the joint moves' if moves or values[0] == 0.0 else ''
        return Relation(what, DRIVER if what else '', math.nan, UNKNOWN_DELAY)
    explained, shift = max(
        (_explained(time, *_averaged(time, values, truth, width)) for width in (0.0, AVERAGED)),
        key=lambda each: each[0],
    )
    here = np.corrcoef(values, truth)[0, 1] ** 2
    of_position = float(np.corrcoef(values, position)[0, 1] ** 2) if np.ptp(position) else 0.0
    if of_position > EXPLAINS and here < of_position - NEAR_BEST:
        ratio = np.polyfit(position, values, 1)[0]
        what = f'proportional to the position ({ratio:.3g} times it)'
        return Relation(what, DRIVER, math.nan, UNKNOWN_DELAY)
    if explained < ALIKE:
        if float(np.std(truth)) < 3.0 * unsure:
            return Relation('', '', math.nan, UNKNOWN_DELAY)
        what = f'not the derivative of the position: the motion explains {explained:.0%} of it'
        return Relation(what, DRIVER, math.nan, UNKNOWN_DELAY)
    factor, half = _factor(time, values, truth, shift)
    late = measured(time, values / factor, truth).known if factor else UNKNOWN_DELAY
    if math.isfinite(late.late):
        factor, half = _factor(time, values, truth, late.late)
    half += 2.0 * abs(factor) * unsure / float(np.std(truth))
    if abs(factor - 1.0) <= max(FACTOR_TOLERANCE, half):
        return Relation('', '', factor, late)
    what = f'{abs(factor):.3g} times the velocity'
    remedy = f'check unit, gear ratio and scaling: {DRIVER}'
    for size, unit in UNITS.items():
        if abs(abs(factor) / size - 1.0) <= max(FACTOR_TOLERANCE, half / size):
            what, remedy = f'{what}: {unit}', 'publish rad/s'
    if factor < 0.0:
        size = abs(factor + 1.0) <= max(FACTOR_TOLERANCE, half)
        what = 'reversed' if size else f'reversed, and {what}'
        remedy = f'turn its sign: {DRIVER}' if size else f'turn its sign; {remedy}'
    return Relation(what, remedy, factor, late)


def _averaged(time: Array, values: Array, truth: Array, width: float) -> tuple[Array, Array]:
    """Return both, averaged over `width` [s], less the mean of the record."""
    count = max(1, min(round(width / float(np.median(np.diff(time)))), len(time) // 4))
    window = np.ones(count) / count
    first, second = (np.convolve(each, window, 'same') for each in (values, truth))
    return first - first.mean(), second - second.mean()


def _explained(time: Array, values: Array, truth: Array) -> tuple[float, float]:
    """Return (part of the variance that the motion explains, delay [s]): the shortest as good."""
    longest = max(LONGEST_DELAY, 10.0 * float(np.median(np.diff(time))))
    shifts = np.linspace(0.0, min(longest, 0.25 * float(time[-1] - time[0])), MOST_SHIFTS)
    parts = np.array(
        [_correlation(values, np.interp(time - shift, time, truth)) ** 2 for shift in shifts]
    )
    at = int(np.argmax(parts >= np.max(parts) - NEAR_BEST))
    return float(np.max(parts)), float(shifts[at])


def _correlation(one: Array, other: Array) -> float:
    size = math.sqrt(float(one @ one) * float(other @ other))
    return float(one @ other) / size if size else 0.0


def _factor(time: Array, values: Array, truth: Array, late: float) -> tuple[float, float]:
    """Return the factor and half of its 95 % interval, at this delay; over blocks of time."""
    then = np.interp(time - late, time, truth)
    then = then - then.mean()
    level = values - values.mean()
    power = float(then @ then)
    factor = float(then @ level) / power
    block = pairs.blocks(time)
    rest = np.bincount(block, then * (level - factor * then))
    return factor, pairs.student(len(rest) - 1) * math.sqrt(float(rest @ rest)) / power
