# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Noise and delay of the velocities that a user has today, against the off-line reference."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from estimator_pkg.bags.series import at_stamps
from estimator_pkg.evaluation.compare.delay import delay
from estimator_pkg.evaluation.compare.interpolation import cubic
from estimator_pkg.evaluation.doctor.readings import (
    DIFFERENCE,
    PASS,
    WARN,
    Array,
    Finding,
    Readings,
    Rows,
    short,
)
from estimator_pkg.evaluation.reference.motion import Motion, motion
from estimator_pkg.parameters import declared

LONGEST = 20_000  # readings of the part that is smoothed
LATE, LATE_STEPS = 2e-3, 3.0  # a published velocity later than both [s, samples] is reported
FEWEST = 100  # readings without which there is no reference
LOW_PASS = declared(type(DIFFERENCE.joint().observer.gains()))['bandwidth_hz'].default


def stretch(seen: Readings) -> Rows:
    """Return at most `LONGEST` consecutive readings without a jump, of the joint or of the clock.

    Those in which the joint moves most are taken.

    They are indices, shape (k,). A reading that jumps and returns at once is left out.
    """
    jumps = np.flatnonzero(seen.leaps)
    alone = jumps[np.isin(jumps + 1, jumps) & ~np.isin(jumps - 1, jumps)] + 1
    turns = np.union1d(jumps, np.flatnonzero(~seen.joined))
    cuts = np.setdiff1d(turns, np.r_[alone - 1, alone]) + 1
    way = np.concatenate([[0.0], np.cumsum(np.where(seen.leaps, 0.0, np.abs(seen.moves)))])
    parts = [
        slice(first, min(first + LONGEST, end))
        for begin, end in pairwise([0, *cuts.tolist(), len(seen.rows)])
        for first in range(begin, max(end - LONGEST, begin) + 1, LONGEST // 10)
        if end - begin >= FEWEST
    ] or [slice(0, 0)]
    best = max(parts, key=lambda part: way[max(part.stop - 1, 0)] - way[part.start])
    return seen.rows[np.setdiff1d(np.arange(best.start, best.stop), alone)]


def reference(seen: Readings, rows: Rows) -> Motion | None:
    """Return the motion that these readings show; None if they do not show it.

    Parameters
    ----------
    rows : shape (k,), indices of the readings, as `stretch` returns them.
    """
    if seen.at_rest or len(rows) < FEWEST:
        return None
    found = motion(seen.stamps_ns[rows], seen.position[rows], seen.period)
    return None if found is None or found.seldom else found


def checks(seen: Readings, found: Motion | None, rows: Rows) -> list[Finding]:
    """Return the findings on the raw and the low-passed difference, and a published velocity.

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

    def error(values: Array) -> tuple[float, float, float]:
        """Return (rms error, noise, delay [s]): noise is the error beyond the delay."""
        at = at_stamps(found.stamps[firm], seen.stamps_ns[rows], values[rows])
        good = np.isfinite(at)
        if np.count_nonzero(good) < FEWEST:
            return (math.nan,) * 3
        late = delay(time[good], at[good], truth[good])
        if _rms(at[good] - truth[good]) > speed or late < -seen.step:
            late = math.nan  # noise hides it
        then = cubic(time, truth, time[good] - (late if late == late else 0.0))
        return _rms(at[good] - truth[good]), _rms(at[good] - then), late

    raw = np.full(len(seen.stamps_ns), np.nan)
    later = seen.rows[1:][seen.joined]
    raw[later] = seen.moves[seen.joined] / seen.steps[seen.joined]
    result = []
    for name, words, values in (
        ('finite difference', 'raw', raw),
        ('low-passed', f'low-passed at {LOW_PASS:g} Hz', seen.difference.velocity),
    ):
        rms, noise, late = error(values)
        result.append(
            Finding(
                name,
                PASS,
                f'{words}: noise {noise:.3g} rad/s, {_late(late)}, at {speed:.3g} rad/s rms',
                '',
                numbers | {'rms': rms, 'noise': noise, 'delay_s': late},
            )
        )
    if np.count_nonzero(np.isfinite(seen.velocity)) > FEWEST and np.ptp(
        seen.velocity[np.isfinite(seen.velocity)]
    ):
        rms, noise, late = error(seen.velocity)
        slow = late > max(LATE, LATE_STEPS * seen.step)
        result.append(
            Finding(
                'published velocity',
                WARN if slow else PASS,
                f'that of the topic: noise {noise:.3g} rad/s, {_late(late)}',
                'use the estimate of a node instead' if slow else '',
                numbers | {'rms': rms, 'noise': noise, 'delay_s': late},
            )
        )
    return result


def _late(late: float) -> str:
    return f'{short(late)} late' if late == late else 'delay not determined'


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))
