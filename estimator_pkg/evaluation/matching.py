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
    """Return the truth at the stamps of the estimates.

    Parameters
    ----------
    stamps : shape (n,), of the estimates [ns], in order of arrival.
    truth_stamps, velocity, position : shape (k,), the truth [ns, rad/s, rad].
    period : wrap period of the positions [rad]; 0: none.
    """
    found: list[tuple[NDArray[np.int64], Array, Array, Array, int]] = []
    offset = 0.0
    for mine, other in _paired(stamps, truth_stamps):
        rows, speeds, angles, count = _piece(
            stamps, mine, truth_stamps, velocity, position, other, period
        )
        if len(rows):
            time = (stamps[rows] - stamps[rows[0]]) * 1e-9 + offset
            offset = float(time[-1]) + PIECE_PAUSE
            found.append((rows, time, speeds, angles, count))
    if not found:
        nothing = np.zeros(0)
        return Matched(np.zeros(0, np.int64), nothing, nothing, nothing, 0, len(stamps))
    *arrays, several = zip(*found)
    rows, time, speeds, angles = map(np.concatenate, arrays)
    return Matched(rows, time, speeds, angles, sum(several), len(stamps) - len(rows))


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


def _piece(
    stamps: Stamps,
    mine: NDArray[np.int64],
    truth_stamps: Stamps,
    velocity: Array,
    position: Array,
    other: NDArray[np.int64],
    period: float,
) -> tuple[NDArray[np.int64], Array, Array, int]:
    """Return (indices, velocity, position, number of exact matches) within one piece."""
    at, known = stamps[mine], truth_stamps[other]
    right = np.searchsorted(known, at)
    exact = known[np.minimum(right, len(known) - 1)] == at
    between = (right > 0) & (right < len(known))
    if len(known) > 1:
        steps = np.diff(known)
        between &= steps[np.clip(right - 1, 0, len(steps) - 1)] <= GAP_STEPS * np.median(steps)
    else:
        between[:] = False
    usable = exact | between
    seconds = (known - known[0]) * 1e-9
    when = (at[usable] - known[0]) * 1e-9
    speeds = _at(seconds, velocity[other], when, exact[usable], right[usable])
    angles = position[other]
    if period > 0.0:
        angles, finite = angles.copy(), np.isfinite(angles)
        angles[finite] = np.unwrap(angles[finite], period=period)
    angles = _at(seconds, angles, when, exact[usable], right[usable])
    return mine[usable], speeds, angles, int(np.count_nonzero(exact))


def _at(
    seconds: Array, values: Array, when: Array, exact: NDArray[np.bool_], right: NDArray[np.int64]
) -> Array:
    """Return the samples where the stamps are equal, interpolated values elsewhere."""
    result = np.empty(len(when))
    result[exact] = values[right[exact]]
    if not exact.all():
        result[~exact] = cubic(seconds, values, when[~exact])
    return result
