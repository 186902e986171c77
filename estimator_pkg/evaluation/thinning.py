# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Thin a long record for drawing without a visible change."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LINE_GAP = 10.0  # a line is not drawn across a longer gap [median sample times]
PERCENTILE_VALUES = 100_000  # number of values that determine a percentile
OUTLIER_PERCENT = 99.5  # an outlier beyond OUTLIER_ROOM times this percentile is marked, not drawn
OUTLIER_ROOM = 2.5


def extremes(values: Array, points: int) -> NDArray[np.int64]:
    """Return the indices to draw: lowest and highest of each of `points` / 2 equal stretches.

    Spikes stay visible, unlike with every n-th sample. Indices, shape (k,), in ascending order; all
    of those of `values`, shape (n,), if there are at most `points`.
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


def limits(lines: Iterable[Array]) -> tuple[float, float] | None:
    """Return the range to draw, in the lines' unit, if outliers would compress them; or None.

    Each line has shape (n,), with an n of its own; nan: none.
    """
    known = np.concatenate([np.zeros(0), *(line[np.isfinite(line)] for line in lines)])
    if not len(known):
        return None
    some = known[:: max(1, len(known) // PERCENTILE_VALUES)]
    low, high = np.percentile(some, [100.0 - OUTLIER_PERCENT, OUTLIER_PERCENT])
    room = 0.5 * (OUTLIER_ROOM - 1.0) * max(float(high - low), 1e-9)
    least, most = float(known.min()), float(known.max())
    if least >= low - room and most <= high + room:
        return None
    return max(float(low) - room, least - 0.1 * room), min(float(high) + room, most + 0.1 * room)
