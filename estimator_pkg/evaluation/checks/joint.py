# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""All checks of one joint's readings, the part to judge by, and the motion that they show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from estimator_pkg.evaluation.checks import angles, stamps
from estimator_pkg.evaluation.checks.angles import AMBIGUOUS_MOVE
from estimator_pkg.evaluation.checks.readings import Readings, Rows, to_mend
from estimator_pkg.evaluation.checks.row import FAIL, Check, Finding
from estimator_pkg.evaluation.checks.stamps import DROPPED_OFTEN, HOLE_RATIO
from estimator_pkg.evaluation.reference.motion import ReferenceMotion, motion

FEWEST_READINGS = 12  # readings without which nothing is checked
LONGEST_STRETCH = 20_000  # readings of the part that is smoothed
TURNED = 1.2  # wrap periods beyond which a range is that of several turns
FEWEST_FOR_REFERENCE = 100  # readings without which there is no reference
LONG_PART, LONG_S = 0.5, 5.0  # a part this long suffices: of the record, or [s]
TRIED = 3  # number of parts that are tried, the longest first

CHECKS = (*stamps.CHECKS, *angles.CHECKS)
READINGS = Check(
    'readings',
    'usable readings',
    f'fewer than {FEWEST_READINGS}',
    {'few': '{usable} usable of {n} readings -> record the joint for some seconds'},
)


def stamped(seen: Readings) -> Readings:
    """Return the readings; those without any stamp are taken at their arrival."""
    if np.any(seen.stamps_ns > 0) or not len(seen.arrival_ns):
        return seen
    return replace(seen, stamps_ns=seen.arrival_ns, start_ns=int(seen.arrival_ns[0]))


def as_read(seen: Readings) -> Readings:
    """Return the readings without a wrap period, if they pass it in great steps and never wrap."""
    if not seen.period or len(seen.rows) < FEWEST_READINGS or not seen.never_wraps:
        return seen
    steps = np.abs(np.diff(seen.raw)[seen.joined])
    far = float(np.ptp(seen.raw)) > TURNED * seen.period
    great = float(np.percentile(steps, 99.0)) > AMBIGUOUS_MOVE * seen.period
    return replace(seen, period=0.0, free=True) if far and great else seen


def checked(seen: Readings) -> list[Finding]:
    """Return the findings on stamps and readings of one joint."""
    missing, seen = stamps.MISSING(seen), stamped(seen)
    if len(seen.rows) < FEWEST_READINGS:
        few = READINGS.found(FAIL, ['few'], {}, {'usable': len(seen.rows), 'n': len(seen.position)})
        return [missing, stamps.ORDER(seen), few]
    wrap = angles.WRAP(seen)
    if other := wrap.numbers.get('wrap_period'):  # the other checks read the angle by it
        seen = replace(seen, period=other)
    known = {angles.WRAP.name: wrap, missing.check: missing}
    every = [each for each in CHECKS if not (seen.log and each is stamps.CLOCK)]
    return [known[each.name] if each.name in known else each(seen) for each in every]


def failed(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings that FAIL."""
    return [each for each in findings if each.level == FAIL]


def usable(seen: Readings, findings: Sequence[Finding]) -> tuple[Readings | None, str]:
    """Return the readings to judge by, and the caution on them; (None, why) if there are none.

    Parameters
    ----------
    findings : on `seen`.
    """
    faults = failed(findings)
    grave = [each for each in faults if not _survived(each, seen)]
    if not faults:
        return seen, ''
    if not grave:
        values = '; '.join(each.value for each in faults)
        return seen, f'{values}: the observers start anew there; {faults[0].remedy}'
    part = _longest(seen) if all(each.check == 'jumps' for each in grave) else None
    if part is None:
        return None, to_mend(faults)
    begin, end = part.when(part.rows[[0, -1]])
    return part, (
        f'judged from {begin:.2f} to {end:.2f} s, the longest part without what FAILs in the '
        f'record ({", ".join(each.value for each in grave)}): choose another part with --from and '
        '--to'
    )


def _survived(finding: Finding, seen: Readings) -> bool:
    """Return True if observers restart or drop samples, and estimate as well as before."""
    if finding.check == 'order of stamps':
        return bool(finding.numbers['late'] <= DROPPED_OFTEN * len(seen.stamps_ns))
    return finding.check in ('holes', 'repeated stamps')


def _longest(seen: Readings) -> Readings | None:
    """Return the longest part between jumps, holes and clock jumps in which nothing FAILs."""
    if len(seen.rows) < FEWEST_FOR_REFERENCE:
        return None
    holes = seen.steps > HOLE_RATIO * seen.step
    cuts = np.flatnonzero(seen.leaps | holes | ~seen.joined) + 1
    lasts = {}
    for begin, end in pairwise([0, *cuts.tolist(), len(seen.rows)]):
        if end - begin >= FEWEST_FOR_REFERENCE:
            lasts[begin, end] = float(np.sum(seen.steps[begin : end - 1]))
    least = min(LONG_S, LONG_PART * float(np.sum(seen.steps[seen.joined])))
    for begin, end in sorted(lasts, key=lasts.__getitem__, reverse=True)[:TRIED]:
        rows = seen.rows[begin:end]
        kept = slice(int(np.min(rows)), int(np.max(rows)) + 1)
        part = cut(seen, kept)
        if lasts[begin, end] >= least and not failed(checked(part)):
            return part
    return None


def cut(seen: Readings, kept: slice | np.ndarray) -> Readings:
    """Return the readings at these indices; `kept`: a slice, or indices of shape (k,)."""
    names = 'stamps_ns', 'arrival_ns', 'position', 'velocity'
    return replace(seen, **{name: getattr(seen, name)[kept] for name in names})


def stretch(seen: Readings, longest: int = LONGEST_STRETCH) -> Rows:
    """Return at most `longest` consecutive readings without a jump, of the joint or of the clock.

    Those in which the joint moves most are taken.

    They are indices, shape (k,). A reading that jumps and returns at once is left out.
    """
    jumps = np.flatnonzero(seen.leaps)
    alone = jumps[np.isin(jumps + 1, jumps) & ~np.isin(jumps - 1, jumps)] + 1
    turns = np.union1d(jumps, np.flatnonzero(~seen.joined))
    cuts = np.setdiff1d(turns, np.r_[alone - 1, alone]) + 1
    way = np.concatenate([[0.0], np.cumsum(np.where(seen.leaps, 0.0, np.abs(seen.moves)))])
    parts = [
        slice(first, min(first + longest, end))
        for begin, end in pairwise([0, *cuts.tolist(), len(seen.rows)])
        for first in range(begin, max(end - longest, begin) + 1, max(longest // 10, 1))
        if end - begin >= FEWEST_FOR_REFERENCE
    ] or [slice(0, 0)]
    best = max(parts, key=lambda part: way[max(part.stop - 1, 0)] - way[part.start])
    return seen.rows[np.setdiff1d(np.arange(best.start, best.stop), alone)]


def reference(seen: Readings, rows: Rows) -> ReferenceMotion | None:
    """Return the motion that these readings show; None if they do not show it.

    Parameters
    ----------
    rows : shape (k,), indices of the readings, as `stretch` returns them.
    """
    if seen.at_rest or len(rows) < FEWEST_FOR_REFERENCE:
        return None
    found = motion(seen.stamps_ns[rows], seen.position[rows], seen.period)
    return None if found is None or found.seldom else found
