# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Estimate the quantum of readings from the readings themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAME_LEVEL = 1e-6  # readings within this fraction of the largest are one level (they were float32)
WIDEST = 4.0  # largest spread of one level, over that distance
ENOUGH_LEVELS = 8  # smallest number of levels for a result,
READ_OFTEN = 10  # unless each was read this often
WHOLE_TO = 0.1  # a spacing counts as an integer number of quanta within this fraction of a quantum
WHOLE_PART = 0.9  # fraction of the spacings that must be integers
CLEARLY_FINER = 0.7  # below this ratio, the quantum of the steps replaces that of the levels
STEADY_PART = 0.9  # a larger part of the steps that repeat the one before,
SINGLE_PART = 0.01  # and a smaller one that differs alone,
FEWEST_STEPS = 20  # in motion, from which they show a commanded speed
FEW_QUANTA = 8.0  # only spacings up to this many quanta count: wider ones may be integers by chance


def quantum(readings: Array) -> float:
    """Return the distance between neighbouring levels of `readings`; 0 if they are not quantised.

    A motion at constant speed has even spacings without any quantum, and one of 32 counts per
    sample has few neighbouring levels. So the steps between readings must have levels too.

    Parameters
    ----------
    readings : shape (n,), wrapped or not [rad or m]; nan is ignored.
    """
    finite = readings[np.isfinite(readings)]
    if len(finite) < 2:
        return 0.0
    same = SAME_LEVEL * float(np.max(np.abs(finite)))
    moves = np.diff(finite)
    found = _spacing(finite, same)
    wrap = max(0.5 * float(np.ptp(finite)), 1.5 * found)  # moves are shorter
    finer = _spacing(moves[np.abs(moves) < wrap], 2.0 * same)
    if not finer or steady(moves, finer):
        return 0.0
    if not found:  # of three or more counts a step the levels are no neighbours
        counts = (finite - finite[0]) / finer
        return finer if np.mean(np.abs(counts - np.rint(counts)) < WHOLE_TO) > WHOLE_PART else 0.0
    return finer if finer < CLEARLY_FINER * found else found


def steady(moves: Array, count: float) -> bool:
    """Return True if the steps in motion are those of a few constant speeds, without counts.

    Counts of a constant speed alternate: near a whole number of counts a step, single ones differ.

    Parameters
    ----------
    moves : shape (n,), steps between readings. count : their supposed quantum.
    """
    in_motion = np.abs(moves[:-1]) > WHOLE_TO * count
    same = np.abs(np.diff(moves)) < WHOLE_TO * count
    if np.count_nonzero(in_motion) < FEWEST_STEPS or np.mean(same[in_motion]) < STEADY_PART:
        return False
    back = np.abs(moves[2:] - moves[:-2]) < WHOLE_TO * count
    return bool(np.mean((back & ~same[1:])[in_motion[:-1]]) < SINGLE_PART)


def _spacing(values: Array, same: float) -> float:
    """Return the step of which all distances between values are multiples; 0: none."""
    levels = np.unique(values)
    if len(levels) < 2:
        return 0.0
    first = np.flatnonzero(np.diff(levels, prepend=-np.inf) > same)  # merges equal levels
    last = np.append(first[1:], len(levels)) - 1
    if np.max(levels[last] - levels[first]) > WIDEST * same:
        return 0.0
    spacings = np.diff(np.add.reduceat(levels, first) / (last - first + 1))
    fewest = 1 if len(values) >= READ_OFTEN * (len(spacings) + 1) else ENOUGH_LEVELS - 1
    if len(spacings) < fewest:
        return 0.0
    step = float(np.min(spacings))
    step = float(np.mean(spacings[spacings < 1.5 * step]))
    near = spacings[spacings < FEW_QUANTA * step] / step
    whole = np.abs(near - np.rint(near)) < WHOLE_TO
    if len(near) < fewest or np.mean(whole) < WHOLE_PART:
        return 0.0
    near = near[whole]
    return float(step * np.sum(near) / np.sum(np.rint(near)))
