# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The curves of a report page over time: the lowest and highest value of each stretch, as text."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.compare.comparison import BAND, Comparison, Row
from estimator_pkg.evaluation.report.thinning import HOLE, broken, changes
from estimator_pkg.observers.contract import STATUS_NAMES
from estimator_pkg.printable import printable

Array = NDArray[np.float64]

BANDS = 2000  # points of a band, which changes slowly
TALL, LOW = 220, 110  # height of a panel [pixels]
SPACING = 0.5  # lines of several statuses are drawn within this distance


def group(comparison: Comparison, joint: str, rows: Sequence[Row], points: int) -> dict[str, Any]:
    """Return the panels of one joint for ``page.js``: angle, velocity, error and status.

    Parameters
    ----------
    points : most points of a curve.
    """
    first = min(float(row.time[0]) for row in rows)
    last = max(float(row.time[-1]) for row in rows)
    last = max(last, first + 1e-3)
    panels = []
    series = comparison.measurement.get(joint)
    if series is not None:
        good = np.isfinite(series.position) & (series.stamps_ns > 0)
        time = (series.stamps_ns[good] - comparison.starts[joint]) * 1e-9
        panels.append(
            _panel(
                'measured position [rad]',
                LOW,
                [curve(time, series.position[good], 'measured', '', points, first, last)],
            )
        )
    reference = curve(rows[0].time, rows[0].truth, 'reference', '', points, first, last)
    velocities, errors, bands = [reference], [], []
    for row in rows:
        estimate, stddev, name = row.estimate, row.stddev, printable(row.source)
        velocities.append(curve(row.time, estimate, 'line', name, points, first, last))
        errors.append(curve(row.time, estimate - row.truth, 'line', name, points, first, last))
        if np.isfinite(stddev).any():
            bands.append(curve(row.time, BAND * stddev, 'band', name, BANDS, first, last))
    panels.append(_panel('velocity [rad/s]; grey: reference', TALL, velocities))
    panels.append(_panel('error and 95 % interval [rad/s]', TALL, bands + errors))
    if any(len(row.status) for row in rows):
        panels.append(_status(rows, points, first, last))
    return {
        'start': first,
        'end': last,
        'finest': float(np.median(np.diff(rows[0].time))) if len(rows[0].time) > 1 else 1e-3,
        'panels': panels,
    }


def _panel(title: str, height: int, curves: list[dict[str, Any]]) -> dict[str, Any]:
    return {'title': title, 'height': height, 'curves': curves}


def _status(rows: Sequence[Row], points: int, first: float, last: float) -> dict[str, Any]:
    """Return the statuses; each estimate has a small offset, so that all are visible."""
    curves, highest = [], 0
    for i, row in enumerate(rows):
        if len(row.status):
            inside = slice(*np.searchsorted(row.status_time, [first, np.nextafter(last, np.inf)]))
            time, status = row.status_time[inside], row.status[inside]
            if not len(status):
                continue
            chosen = changes(status, points)
            offset = SPACING * (i / (len(rows) - 1) - 0.5) if len(rows) > 1 else 0.0
            highest = max(highest, int(status.max()))
            curves.append(
                curve(
                    np.append(time[chosen], last),
                    np.append(status[chosen], status[-1]) + offset,
                    'step',
                    printable(row.source),
                    points,
                    first,
                    last,
                )
            )
    panel = _panel('status', 18 * (highest + 2), curves)
    panel['ticks'] = list(STATUS_NAMES[: highest + 1])
    return panel


def curve(
    time: NDArray[np.floating],
    values: NDArray[np.floating],
    kind: str,
    source: str,
    points: int,
    first: float,
    last: float,
) -> dict[str, Any]:
    """Return one curve: all its samples, or the extremes of stretches of equal length.

    Parameters
    ----------
    time, values : shape (n,); nan: none.
    kind : 'line', 'step', 'band', 'reference' or 'measured'.
    source : the estimate that it belongs to; '': none.
    points : most numbers to keep.
    first, last : time range of the group [s].
    """
    made: dict[str, Any] = {'kind': kind, 's': source}
    inside = slice(*np.searchsorted(time, [first, np.nextafter(last, math.inf)]))
    time, values = time[inside], values[inside]
    if len(time) <= points or kind == 'step':
        if kind != 'step':
            time, values = broken(np.asarray(time, float), values, np.arange(len(time)))
        return {**made, 't': _text(time), 'y': _text(values)}
    low, high, step = extremes_of_time(time, values, points // 2, first, last)
    return {**made, 'first': first, 'step': step, 'y': _text(np.stack([low, high], axis=1))}


def extremes_of_time(
    time: NDArray[np.floating], values: NDArray[np.floating], count: int, first: float, last: float
) -> tuple[Array, Array, float]:
    """Return (lowest, highest) of each of `count` stretches of equal time, and their length [s].

    Both have shape (count,): nan where there is a gap; a stretch between two samples has the value
    before.

    Parameters
    ----------
    time, values : shape (n,), time increasing [s].
    first, last : time range [s].
    """
    step = (last - first) / count
    starts = np.searchsorted(time, first + step * np.arange(count))
    number = np.diff(starts, append=len(time))
    at = np.minimum(starts, len(time) - 1)
    low, high = np.fmin.reduceat(values, at), np.fmax.reduceat(values, at)
    longest = HOLE * float(np.median(np.diff(time)))
    empty = number == 0
    before, after = np.maximum(starts - 1, 0), at
    gap = empty & ((time[after] - time[before] > longest) | (starts == len(time)) | (starts == 0))
    low[empty] = high[empty] = values[before[empty]]
    low[gap] = high[gap] = np.nan
    return low, high, step


def _text(values: NDArray) -> str:
    """Return numbers as base64 of 32 bits each: seven digits are enough for drawing."""
    return base64.b64encode(np.ascontiguousarray(values, '<f4').tobytes()).decode()
