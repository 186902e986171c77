# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rank velocity estimates of one joint without ground truth.

    reference = motion(stamps, positions, period)        # evaluation.reference.motion
    verdict = rank({'pll': velocity, ...}, reference, default='edge_adaptive')
    for line in verdict.sentences(): ...

- A candidate is a velocity at each of `reference.stamps`, nan where there is no estimate;
  `at_reference(reference, stamps, velocity)` makes it from estimates at other stamps.
- `rank` never refuses. Where nothing can be ranked, `Verdict.best` is '' and `Verdict.why` has the
  reason; `Verdict.choice` is then the default, or '' where the readings must be mended first.
- `reference` may be None: `motion` returns that for too few readings.
- `motion_hz` is the user's one number: the highest frequency at which the joint moves.
- `Verdict` (evaluation.ranking.verdict) has best, ties, rms, pairs, other, cautions, sentences()
  and as_dict().

The error of a conditional mean is orthogonal to every function of the data. Hence the mean of
(a - r)^2 ranks causal estimates a as the truth would, if r = E[v | all readings], and r's own
variance only adds to all of them. The smoother is that mean as far as its model is right. A pair is
declared only if its difference is significant against the reference with and without the vibration
that was recovered.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation import pairs as test
from estimator_pkg.evaluation.matching import exact
from estimator_pkg.evaluation.ranking.cautions import cautions, unseen
from estimator_pkg.evaluation.ranking.verdict import ComparedPair, Verdict, shown
from estimator_pkg.evaluation.reference.motion import ReferenceMotion

Array = NDArray[np.float64]

SKIPPED, SKIP_PART = 1.0, 0.15  # ignored at the beginning [s], at most this part of the record
PRESENT = 0.9  # a candidate with fewer than this fraction of the most estimates is not ranked
FEWEST_COMMON = 80  # smallest number of samples with all estimates


def at_reference(reference: ReferenceMotion, stamps: NDArray[np.int64], velocity: Array) -> Array:
    """Return the estimates at the reference's stamps, nan where there is none.

    Parameters
    ----------
    stamps, velocity : shape (k,), estimates [ns], [rad/s], in the order of their publication.
    """
    return exact(reference.stamps, stamps, velocity)


def rank(
    candidates: Mapping[str, Array],
    reference: ReferenceMotion | None,
    default: str = '',
    motion_hz: float | None = None,
    skip: float | None = None,
) -> Verdict:
    """Return the ranking of estimates of one joint.

    Parameters
    ----------
    candidates : name -> velocities at `reference.stamps`, shape (n,) [rad/s]; nan: no estimate.
    reference : None: too few readings.
    default : the candidate that is kept where it is as good as the best; ignored if it has no
        estimates.
    motion_hz : highest frequency at which the joint moves [Hz]; None: not known, or it was given
        to `Motion.below` already.
    skip : time ignored at the beginning [s]; None: 1 s, at most 15 % of the record.
    """
    if reference is None:
        return Verdict(default=default, why='there are too few readings', tunable=False)
    if motion_hz is not None and reference.motion_hz is None:
        reference = reference.below(motion_hz)
    said = cautions(reference)
    nothing = Verdict(default=default, cautions=said, tunable=False)
    if reference.seldom:
        return replace(
            nothing,
            why=f'the reading changes only {max(reference.smoothed.changes, 0)} times, too rarely '
            'to show the motion: record a longer or faster motion',
        )
    if unseen(reference):
        return replace(nothing, default='', why=unseen(reference))
    elapsed = reference.time - reference.time[0]
    counted = reference.firm & (
        elapsed >= (min(SKIPPED, SKIP_PART * elapsed[-1]) if skip is None else skip)
    )
    names, rows = _common(candidates, counted)
    unranked = tuple(name for name in candidates if name not in names)
    if not names or len(rows) < FEWEST_COMMON:
        return replace(nothing, why='there are too few estimates', unranked=unranked)
    default = default if default in names else ''
    references = [reference.velocity[rows]]
    if reference.vibrates:
        references.append(reference.plain[rows])
    block = test.blocks(reference.time[rows])
    sums = {
        name: [np.bincount(block, (candidates[name][rows] - each) ** 2) for each in references]
        for name in names
    }
    count = np.bincount(block)
    when = np.bincount(block, elapsed[rows]) / np.maximum(count, 1)
    own = float(reference.stddev**2)
    found = _ranked(sums, count, own, default, when)
    found = replace(found, cautions=said, unranked=unranked, tunable=not reference.constant)
    if len(references) == 1:
        return found
    plain = {name: each[1:] for name, each in sums.items()}
    other = _ranked(plain, count, own, default, when)
    same = other.best == found.best or found.best in other.ties
    return replace(found, question_hz=reference.vibration_hz, other='' if same else other.best)


def _common(
    candidates: Mapping[str, Array], counted: NDArray[np.bool_]
) -> tuple[list[str], NDArray[np.int64]]:
    """Return the candidates with enough estimates, and the rows where all of them have one."""
    present = {
        name: int(np.count_nonzero(np.isfinite(candidates[name]) & counted)) for name in candidates
    }
    enough = max(1.0, PRESENT * max(present.values(), default=0))
    names, common = [name for name in present if present[name] >= enough], counted.copy()
    for name in names:
        common &= np.isfinite(candidates[name])
    return names, np.flatnonzero(common)


def _ranked(
    sums: Mapping[str, Sequence[NDArray]],
    count: NDArray[np.int64],
    own: float,
    default: str,
    when: Array,
) -> Verdict:
    """Return best, ties, rms and pairs against the first of the references.

    Parameters
    ----------
    sums : by name, the squared errors summed by block, shape (blocks,), against each reference.
    count : shape (blocks,), samples of each block. own : variance of the reference [(rad/s)^2].
    when : shape (blocks,), time of each block in the record [s].
    """
    mean = {name: float(np.sum(each[0]) / np.sum(count)) + own for name, each in sums.items()}
    rms = {name: math.sqrt(each) for name, each in mean.items()}
    order = sorted(rms, key=rms.__getitem__)

    def pair(first: str, second: str) -> ComparedPair:
        """Return a pair; every reference must agree on its sign."""
        apart = [one - other for one, other in zip(sums[first], sums[second])]
        found = test.agreed([[each] for each in apart], [count])
        scale = 2.0 * max(mean[first], 1e-300)
        printed = {shown(rms[name]) for name in (first, second)}
        return ComparedPair(
            first,
            second,
            found.sign if len(printed) == 2 else 0,
            100.0 * (math.sqrt(1.0 + 2.0 * abs(found.mean) / scale) - 1.0),
            100.0 * found.half / scale,
            tuple(when[test.events(apart[0])].tolist()),
        )

    pairs = tuple(pair(a, b) for a, b in combinations(order, 2))
    best = order[0]
    ties = tuple(each.second for each in pairs if each.first == best and not each.sign)
    return Verdict(best, default, ties, {name: rms[name] for name in order}, pairs)
