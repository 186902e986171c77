# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The part of a joint's readings that estimates can be judged by, although a check FAILs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from estimator_pkg.evaluation.checks.joint import FEWEST_FOR_REFERENCE, checked, failed
from estimator_pkg.evaluation.checks.readings import Readings, to_mend
from estimator_pkg.evaluation.checks.row import Finding
from estimator_pkg.evaluation.checks.stamps import DROPPED_OFTEN, HOLE_RATIO

LONG_PART, LONG_S = 0.5, 5.0  # a part this long suffices: of the record, or [s]
TRIED = 3  # number of parts that are tried, the longest first


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
