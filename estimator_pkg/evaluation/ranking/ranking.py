# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rank velocity estimates of one joint without ground truth.

    reference = motion(stamps, positions, period)        # evaluation.reference.motion
    verdict = rank({'pll': velocity, ...}, reference, default='edge_adaptive')
    for line in verdict.sentences(): ...

- A candidate is a velocity at each of `reference.stamps`, nan where there is no estimate;
  `at_reference(reference, stamps, velocity)` makes it from estimates at other stamps.
- `rank` never refuses. Where nothing can be ranked, `Verdict.best` is '' and `Verdict.why` has the
  reason; `Verdict.choice` is then the default.
- `reference` may be None: `motion` returns that for too few readings.
- `motion_hz` is the user's one number: the highest frequency at which the joint moves.
- `Verdict` (evaluation.ranking.verdict) has best, ties, rms, pairs, motion_hz, other, cautions,
  sentences() and as_dict().

The error of a conditional mean is orthogonal to every function of the data. Hence the mean of
(a - r)^2 ranks causal estimates a as the truth would, if r = E[v | all readings], and r's own
variance only adds to all of them. The smoother is that mean as far as its model is right. A pair is
declared only if its difference is significant against the reference with and without the vibration
that was put back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.series import at_stamps
from estimator_pkg.evaluation.ranking import pairs as test
from estimator_pkg.evaluation.ranking.cautions import cautions
from estimator_pkg.evaluation.ranking.frequencies import low_passed, rests_on
from estimator_pkg.evaluation.ranking.verdict import Pair, Verdict
from estimator_pkg.evaluation.reference.motion import Motion

Array = NDArray[np.float64]

SKIPPED, AT_MOST = 1.0, 0.15  # ignored at the beginning [s], at most this part of the record
PRESENT = 0.9  # a candidate with fewer estimates than this fraction is not ranked
FEWEST = 80  # smallest number of samples with all estimates
ABOVE = 3.0  # the reference is low-passed at this multiple of motion_hz


def at_reference(reference: Motion, stamps: NDArray[np.int64], velocity: Array) -> Array:
    """Return the estimates at the reference's stamps, nan where there is none.

    Parameters
    ----------
    stamps, velocity : shape (k,), estimates [ns], [rad/s].
    """
    return at_stamps(reference.stamps, stamps, velocity)


def rank(
    candidates: Mapping[str, Array],
    reference: Motion | None,
    default: str = '',
    motion_hz: float | None = None,
    skip: float = SKIPPED,
) -> Verdict:
    """Return the ranking of estimates of one joint.

    Parameters
    ----------
    candidates : name -> velocities at `reference.stamps`, shape (n,) [rad/s]; nan: no estimate.
    reference : None: too few readings.
    default : the candidate that is kept where no other is better.
    motion_hz : highest frequency at which the joint moves [Hz]; None: not known.
    skip : time ignored at the beginning [s], at most 15 % of the record.
    """
    if reference is None:
        return Verdict(default=default, why='there are too few readings', tunable=False)
    said = cautions(reference)
    nothing = Verdict(default=default, cautions=said, tunable=False)
    if reference.seldom:
        return replace(
            nothing,
            why=f'the reading changes only {max(reference.smoothed.changes, 0)} times, too rarely '
            'to show the motion: record a longer or faster motion',
        )
    names = list(candidates)
    counted = reference.firm & (
        reference.time - reference.time[0]
        >= min(skip, AT_MOST * (reference.time[-1] - reference.time[0]))
    )
    values = np.array([candidates[name] for name in names], float).reshape(len(names), -1)
    present = np.isfinite(values[:, counted]).sum(axis=1) >= PRESENT * max(counted.sum(), 1)
    unranked = tuple(name for name, there in zip(names, present) if not there)
    names, values = [name for name in names if name not in unranked], values[present]
    rows = np.flatnonzero(counted & np.isfinite(values).all(axis=0))
    if not names or len(rows) < FEWEST:
        return replace(nothing, why='there are too few estimates', unranked=unranked)
    references = _references(reference, motion_hz)
    found = _ranked(
        names, values[:, rows], [each[rows] for each in references], reference, rows, default
    )
    found = replace(found, cautions=said, unranked=unranked, tunable=not reference.constant)
    if motion_hz is not None:
        found = replace(found, motion_hz=min(found.motion_hz, ABOVE * motion_hz))
    if len(references) > 1:
        found = replace(
            found,
            question_hz=reference.vibration_hz,
            other=_other(found, names, values[:, rows], references, reference, rows),
        )
    return found


def _references(reference: Motion, motion_hz: float | None) -> list[Array]:
    """Return the reference, and the one without vibration if that is a question."""
    found = [reference.velocity]
    if reference.put_back and not (motion_hz and reference.vibration_hz <= motion_hz):
        found.append(reference.plain)
    if motion_hz is not None:
        found = [low_passed(each, reference.rate, ABOVE * motion_hz) for each in found]
    return found


def _ranked(
    names: Sequence[str],
    values: Array,
    references: Sequence[Array],
    reference: Motion,
    rows: NDArray[np.int64],
    default: str,
) -> Verdict:
    """Return best, ties, rms, pairs and frequency against the first of these references."""
    errors = values - references[0]
    squares = [errors**2, *((values - each) ** 2 for each in references[1:])]
    own = reference.stddev**2
    rms = np.sqrt(np.mean(squares[0], axis=1) + own)
    order = np.argsort(rms, kind='stable')
    block = test.blocks(reference.time[rows])
    found = tuple(
        _pair(names[i], names[j], [(each[i], each[j]) for each in squares], block, own)
        for i, j in combinations(order, 2)
    )
    best = names[order[0]]
    return Verdict(
        best,
        default,
        tuple(pair.second for pair in found if pair.first == best and not pair.sign),
        {names[i]: float(rms[i]) for i in order},
        found,
        rests_on(errors, references[0], int(order[0]), reference.rate),
    )


def _pair(
    first: str,
    second: str,
    squares: Sequence[tuple[Array, Array]],
    block: NDArray[np.int64],
    own: float,
) -> Pair:
    """Return a pair; every reference must agree on its sign."""
    found = [test.difference(one, other, block) for one, other in squares]
    scale = 2.0 * max(float(np.mean(squares[0][0])) + own, 1e-300)
    relative = [abs(each.mean) / scale for each in found]
    signs = {each.sign for each in found}
    return Pair(
        first,
        second,
        signs.pop() if len(signs) == 1 else 0,
        100.0 * (math.sqrt(1.0 + 2.0 * relative[0]) - 1.0),
        100.0 * max(each.half / scale for each in found),
    )


def _other(
    found: Verdict,
    names: Sequence[str],
    values: Array,
    references: Sequence[Array],
    reference: Motion,
    rows: NDArray[np.int64],
) -> Verdict | None:
    """Return the verdict without the vibration; None if it is the same within its resolution."""
    other = _ranked(names, values, [references[1][rows]], reference, rows, found.default)
    same = other.best == found.best or found.best in other.ties
    return None if same else replace(other, cautions=found.cautions)
