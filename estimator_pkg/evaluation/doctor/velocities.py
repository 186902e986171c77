# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Noise and delay of the velocities that a user has today, against the off-line reference."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estimator_pkg.bags.series import at_stamps
from estimator_pkg.evaluation.checks.joint import FEWEST_FOR_REFERENCE
from estimator_pkg.evaluation.checks.readings import DIFFERENCE, Array, Readings, Rows, late_by
from estimator_pkg.evaluation.checks.row import PASS, WARN, Check, Finding
from estimator_pkg.evaluation.delay import UNKNOWN_DELAY, Delay, measured
from estimator_pkg.evaluation.doctor.published import FACTOR_TOLERANCE, relation
from estimator_pkg.evaluation.ranking.cautions import JUDGE_BY_TRUTH, contradiction
from estimator_pkg.evaluation.reference.motion import ReferenceMotion
from estimator_pkg.evaluation.signals import cubic
from estimator_pkg.parameters import declared

LATE_TIME, LATE_STEPS = 2e-3, 3.0  # a published velocity later than both [s, samples] is reported
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
