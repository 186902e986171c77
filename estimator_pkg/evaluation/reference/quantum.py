"""The step of a quantised reading, seen in the readings themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAME = 1e-6  # readings this close (part of the largest) are one level: they were float32 once
WIDEST = 4.0  # times that: what is spread further is not one level
ENOUGH = 8  # levels below which nothing can be said,
REPEATED = 10  # unless each was read so often
WHOLE = 0.1  # a spacing is a whole number of quanta if it is off by at most this part of one
SHARE = 0.9  # so many of the spacings have to be
CLEARLY_FINER = 0.7  # a step of what passes that is this part of the levels' is the right one
FEW = 8.0  # only spacings up to so many quanta tell: wider ones may be whole by chance


def quantum(readings: Array) -> float:
    """The distance between neighbouring levels of `readings`; 0 where they are not quantised.

    A motion at constant speed is spaced evenly without any count, and one of 32 counts a sample has
    few levels that are neighbours. So what passes from reading to reading must have levels too.

    Parameters
    ----------
    readings : shape (n,), wrapped or not [rad or m]; nan is left out.
    """
    finite = readings[np.isfinite(readings)]
    if len(finite) < 2:
        return 0.0
    same = SAME * float(np.max(np.abs(finite)))
    moves = np.diff(finite)
    found = _spacing(finite, same)
    finer = _spacing(moves[np.abs(moves) < np.pi], 2.0 * same)  # without the wraps
    if not found or not finer:
        return 0.0
    return finer if finer < CLEARLY_FINER * found else found


def _spacing(values: Array, same: float) -> float:
    """The step of which all distances between values are multiples; 0: there is none."""
    levels = np.unique(values)
    if len(levels) < 2:
        return 0.0
    first = np.flatnonzero(np.diff(levels, prepend=-np.inf) > same)  # of those that are one
    last = np.append(first[1:], len(levels)) - 1
    if np.max(levels[last] - levels[first]) > WIDEST * same:
        return 0.0
    spacings = np.diff(np.add.reduceat(levels, first) / (last - first + 1))
    fewest = 1 if len(values) >= REPEATED * (len(spacings) + 1) else ENOUGH - 1
    if len(spacings) < fewest:
        return 0.0
    step = float(np.min(spacings))
    step = float(np.mean(spacings[spacings < 1.5 * step]))
    near = spacings[spacings < FEW * step] / step
    whole = np.abs(near - np.rint(near)) < WHOLE
    if len(near) < fewest or np.mean(whole) < SHARE:
        return 0.0
    near = near[whole]
    return float(step * np.sum(near) / np.sum(np.rint(near)))
