# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Match truth and estimates by stamp; interpolate the truth where the stamps differ."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.series import at_stamps
from estimator_pkg.evaluation.delay import GAP_STEPS
from estimator_pkg.evaluation.signals import cubic

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

JUMP_NS = 100_000_000  # a stamp this much older than the last one restarts the time (as in the
# guard's reorder_window): a looping bag, a restarted simulation
PIECE_PAUSE = 10.0  # gap between two such pieces in the common time [s]


class Matched(NamedTuple):
    """The estimates with a truth.

    rows : shape (m,), indices of these estimates.
    time : shape (m,), strictly increasing time [s] since the first of all stamps; pieces before and
        after a clock jump follow each other.
    velocity, position : shape (m,), the truth at these stamps; the position is multi-turn.
    exact : number of estimates with a truth at the same stamp; the others are interpolated.
    unmatched : number of estimates without a truth: outside its time, or in a gap.
    """

    rows: NDArray[np.int64]
    time: Array
    velocity: Array
    position: Array
    exact: int
    unmatched: int


def pieces(stamps: Stamps) -> list[NDArray[np.int64]]:
    """Return the indices, shape (k,), of each piece between clock jumps, sorted by stamp.

    Single wrong stamps are in no piece.
    """
    rows = np.flatnonzero(~strays(stamps))
    if not len(rows):
        return []
    cuts = np.flatnonzero(np.diff(stamps[rows]) < -JUMP_NS) + 1
    result = []
    for part in np.split(rows, cuts):
        _, first = np.unique(stamps[part], return_index=True)
        result.append(part[first])
    return result


def strays(stamps: Stamps) -> NDArray[np.bool_]:
    """Return True, shape (n,), for single stamps far ahead of both their neighbours."""
    found = np.zeros(len(stamps), bool)
    steps = np.diff(stamps)
    if len(steps) > 1:
        found[1:-1] = (steps[:-1] > JUMP_NS) & (steps[1:] < -JUMP_NS) & (stamps[2:] > stamps[:-2])
    return found


def match(
    stamps: Stamps, truth_stamps: Stamps, velocity: Array, position: Array, period: float
) -> Matched:
    """Return the truth at the stamps of the estimates, interpolated where they differ.

    Parameters
    ----------
    stamps : shape (n,), of the estimates [ns], in order of arrival.
    truth_stamps, velocity, position : shape (k,), the truth [ns, rad/s, rad].
    period : wrap period of the positions [rad]; 0: none.
    """
    nothing = np.zeros(0)
    found = [(np.zeros(0, np.int64), nothing, nothing, nothing)]
    offset, equals = 0.0, 0
    for mine, other in _paired(stamps, truth_stamps):
        at, known, angle = stamps[mine], truth_stamps[other], position[other]
        right = np.searchsorted(known, at)
        equal = known[np.minimum(right, len(known) - 1)] == at
        usable = equal | _between(known, right)
        if not usable.any():
            continue
        if period > 0.0:
            finite = np.isfinite(angle)
            angle[finite] = np.unwrap(angle[finite], period=period)
        seconds, when = (known - known[0]) * 1e-9, (at[usable] - known[0]) * 1e-9
        time = (at[usable] - at[usable][0]) * 1e-9 + offset
        offset, equals = float(time[-1]) + PIECE_PAUSE, equals + int(np.count_nonzero(equal))
        values = (cubic(seconds, each, when) for each in (velocity[other], angle))
        found.append((mine[usable], time, *values))
    rows, time, speed, angle = map(np.concatenate, zip(*found))
    return Matched(rows, time, speed, angle, equals, len(stamps) - len(rows))


def _between(known: Stamps, right: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return True where a stamp before known[right] is between two known ones without a gap."""
    if len(known) < 2:
        return np.zeros(len(right), bool)
    steps = np.diff(known)
    near = steps[np.clip(right - 1, 0, len(steps) - 1)] <= GAP_STEPS * np.median(steps)
    return (right > 0) & (right < len(known)) & near


def exact(stamps: Stamps, known: Stamps, values: Array) -> Array:
    """Return the values at the same stamps in the same piece, shape (n,); nan elsewhere.

    Parameters
    ----------
    stamps : shape (n,) [ns]. known, values : shape (k,); both in order of arrival.
    """
    found = np.full(len(stamps), np.nan)
    for mine, other in _paired(stamps, known):
        found[mine] = at_stamps(stamps[mine], known[other], values[other])
    return found


def _paired(
    stamps: Stamps, truth_stamps: Stamps
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield each piece of the estimates with its piece of the truth.

    It has the same number, or where some have no partner, most of its time in common.
    """
    ours, theirs = pieces(stamps), pieces(truth_stamps)
    if len(theirs) == len(ours):
        yield from zip(ours, theirs)
        return
    for mine in ours:
        first, last = stamps[mine[0]], stamps[mine[-1]]
        shared = [
            min(last, truth_stamps[each[-1]]) - max(first, truth_stamps[each[0]]) for each in theirs
        ]
        if shared and max(shared) >= 0:
            yield mine, theirs[int(np.argmax(shared))]
