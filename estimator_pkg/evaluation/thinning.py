"""Fewer points for the same picture: what is drawn of a long record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def extremes(values: Array, points: int) -> NDArray[np.int64]:
    """Which samples to draw: the lowest and the highest of each of `points` / 2 equal stretches.

    Spikes survive, as they would not if every n-th sample were taken. In ascending order; all of
    them where there are no more than `points`.
    """
    count = len(values)
    if count <= points:
        return np.arange(count)
    stretches = max(1, points // 2)
    length = -(-count // stretches)
    padded = np.full(-(-count // length) * length, np.nan)
    padded[:count] = values
    rows = padded.reshape(-1, length)
    empty = ~np.isfinite(rows)
    first = np.arange(len(rows)) * length
    low = np.argmin(np.where(empty, np.inf, rows), axis=1)
    high = np.argmax(np.where(empty, -np.inf, rows), axis=1)
    chosen = np.unique(np.concatenate([[0], first + low, first + high, [count - 1]]))
    return chosen[chosen < count]


def changes(values: NDArray, points: int) -> NDArray[np.int64]:
    """Which samples draw a staircase: those at which it steps, with both ends; at most `points`."""
    if not len(values):
        return np.zeros(0, np.int64)
    steps = np.flatnonzero(np.diff(values)) + 1
    chosen = np.unique(np.concatenate([[0], steps, [len(values) - 1]]))
    if len(chosen) > points:
        chosen = chosen[np.linspace(0, len(chosen) - 1, points).astype(np.int64)]
    return chosen
