# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Noise and delay of the velocities that a user has today, against the off-line reference."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estimator_pkg.bags.series import at_stamps
from estimator_pkg.evaluation.checks.joint import FEWEST_FOR_REFERENCE
from estimator_pkg.evaluation.checks.readings import (
    DIFFERENCE,
    PASS,
    WARN,
    Array,
    Finding,
    Readings,
    Rows,
    late_by,
)
from estimator_pkg.evaluation.delay import UNKNOWN_DELAY, Delay, measured
from estimator_pkg.evaluation.doctor.published import relation
from estimator_pkg.evaluation.ranking.cautions import JUDGE_BY_TRUTH, contradiction
from estimator_pkg.evaluation.reference.motion import ReferenceMotion
from estimator_pkg.evaluation.signals import cubic
from estimator_pkg.parameters import declared

PUBLISHED = 'published velocity'  # the check of that in the messages
LATE_TIME, LATE_STEPS = 2e-3, 3.0  # a published velocity later than both [s, samples] is reported
LOW_PASS = declared(type(DIFFERENCE.joint().observer.gains()))['bandwidth_hz'].default


def checks(seen: Readings, found: ReferenceMotion | None, rows: Rows) -> list[Finding]:
    """Return the findings on the raw and the low-passed difference, and a published velocity.

    One on the reference comes first if its readings contradict it.

    Parameters
    ----------
    found : as `reference` returns it. rows : the readings that it is of.
    """
    if found is None:
        why = 'no reference: the joint moves too little'
        return [Finding(name, PASS, why) for name in ('finite difference', 'low-passed')]
    firm = found.firm
    time, truth = found.time[firm], found.velocity[firm]
    speed = float(np.sqrt(np.mean(truth * truth)))
    numbers = {'rms_speed': speed, 'reference_stddev': found.stddev}

    def error(values: Array) -> tuple[float, float, Delay]:
        """Return (rms error, noise, delay): noise is the error beyond the delay."""
        at = at_stamps(found.stamps[firm], seen.stamps_ns[rows], values[rows])
        good = np.isfinite(at)
        if np.count_nonzero(good) < FEWEST_FOR_REFERENCE:
            return math.nan, math.nan, UNKNOWN_DELAY
        late = measured(time[good], at[good], truth[good]).known
        then = cubic(time, truth, time[good] - np.nan_to_num(late.late))
        return _rms(at[good] - truth[good]), _rms(at[good] - then), late

    raw = np.full(len(seen.stamps_ns), np.nan)
    later = seen.rows[1:][seen.joined]
    raw[later] = seen.moves[seen.joined] / seen.steps[seen.joined]
    result = []
    if found.smoothed.contradicted:
        result.append(Finding('reference', WARN, contradiction(found.smoothed), JUDGE_BY_TRUTH))
    compared = [
        ('finite difference', 'raw', raw),
        ('low-passed', f'at {LOW_PASS:g} Hz', seen.difference.velocity),
    ]
    known = np.isfinite(seen.velocity[rows])
    at = at_stamps(found.stamps[firm], seen.stamps_ns[rows][known], seen.velocity[rows][known])
    good = np.isfinite(at)
    what = None
    if np.count_nonzero(good) > FEWEST_FOR_REFERENCE:
        given = time[good], at[good], truth[good], found.position[firm][good]
        what = relation(*given, found.uncertainty)
        compared.append((PUBLISHED, 'that of the topic', seen.velocity))
    for name, words, values in compared:
        rms, noise, late = error(values)
        published = what if values is seen.velocity else None
        late = late if published is None else published.late
        slow = published and late.late - late.half > max(LATE_TIME, LATE_STEPS * seen.step)
        text = f'{words}: noise {noise:.3g} rad/s, {late_by(late)}'
        remedy = 'use the estimate of a node instead' if slow else ''
        more = {'rms': rms, 'noise': noise, 'delay_s': late.late, 'delay_95_s': late.half}
        if published is None:
            text += f', at {speed:.3g} rad/s rms'
        else:
            more |= {'factor': published.factor, 'wrong': bool(published.wrong)}
            if published.wrong:
                text = f'{words} is {published.wrong}'
                text += f'; {late_by(late)}' if math.isfinite(late.late) else ''
                remedy = published.remedy
        result.append(Finding(name, WARN if remedy else PASS, text, remedy, numbers | more))
    return result


def misleads(findings: Sequence[Finding]) -> bool:
    """Return True if the velocity in the messages is not that of the joint."""
    return any(each.check == PUBLISHED and each.numbers.get('wrong') for each in findings)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))
