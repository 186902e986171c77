# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A ripple of the speed of a slow shaft, in the times at which it passed the edges of its sensor.

See `sensor.map` for the equations.
"""

from __future__ import annotations

import numpy as np

from estimator_pkg.sensor.table import BETTER, Array

SPAN, SHORTEST = 8, 5  # cells over which a ripple is proven; its shortest period


def slower(times: Array, lag: int) -> tuple[int, Array]:
    """Return (index of the first cell, by how much longer than usual each one takes).

    The cells are the newest two periods; usual is the mean of the period around a cell.

    Parameters
    ----------
    times : of edges in a row, shape (n,) [s]. lag : the period, in cells.
    """
    start = max(0, len(times) - 2 * lag)
    middle = start + (lag - 1) // 2
    whole = times[start + lag :] - times[start:-lag]
    cells = times[middle + 1 : middle + 1 + len(whole)] - times[middle : middle + len(whole)]
    return middle, lag * cells / whole - 1.0


def found(times: Array, marks: int, rises: Array, unseen: float) -> int:
    """Return the period after which the times in the cells repeat, in cells; 0: none.

    The time in each of the newest cells is predicted by that a period before. Without a ripple it
    is predicted by the mean of a period, or of the two cells before, and the sensor's errors.

    Parameters
    ----------
    times : of edges in a row, shape (n,) [s]. marks : the period is a divisor of them.
    rises : by how much the sensor's errors make the newest cells larger, over their size, shape
        (SPAN,). unseen : error that the sample time makes, over the size of a cell.
    """
    if len(times) < SPAN + 3:
        return 0
    ends = np.arange(len(times) - SPAN, len(times))
    cells = times[ends] - times[ends - 1]

    def missed(guess: Array) -> float:
        return float(np.mean(((cells - guess) / (cells + guess)) ** 2))

    recent = missed(0.5 * (times[ends - 1] - times[ends - 3]) * (1.0 + rises))
    period, best = 0, BETTER
    for lag in range(SHORTEST, marks + 1):
        if marks % lag or len(times) <= lag + lag // 2 + SPAN:
            continue
        mean = (times[ends - 1] - times[ends - 1 - lag]) / lag
        start = ends - 1 - lag - (lag - 1) // 2
        usual = (times[start + lag] - times[start]) / lag
        least = min(recent, missed(mean * (1.0 + rises)))
        with_it = missed(mean * (times[ends - lag] - times[ends - 1 - lag]) / usual)
        if with_it < best * least and least > unseen * unseen:
            period, best = lag, with_it / least
    return period
