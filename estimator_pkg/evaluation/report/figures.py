# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Plots of a joint: curves over time, the largest error, error by speed, spectrum."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.estimate import STATUS_NAMES
from estimator_pkg.evaluation.compare.comparison import SIGMAS_95, Comparison, Row
from estimator_pkg.evaluation.plots import GREY, Curve, Style, ahead, figure, over_time
from estimator_pkg.evaluation.report.spectrum import by_speed, density
from estimator_pkg.printable import printable

Array = NDArray[np.float64]

WORST_NEIGHBOURS = 300  # samples on either side of the largest error
FREQUENCIES = 160  # points of a spectrum, evenly on its logarithmic axis
SPACING = 0.5  # lines of several statuses are drawn within this distance
REFERENCE = {'line_color': GREY, 'line_width': 3}


def group(
    comparison: Comparison,
    joint: str,
    rows: Sequence[Row],
    instants: int,
    styles: Mapping[str, Style],
    shown: Collection[str],
) -> tuple[Any, str]:
    """Return (angle, velocity, error and status of a joint over time, what is left out)."""
    first = min(float(row.time[0]) for row in rows)
    last = max(float(row.time[-1]) for row in rows)
    panels: dict[str, list[Curve]] = {}
    series = comparison.measurement.get(joint)
    if series is not None:
        time = (series.stamps_ns - comparison.starts[joint]) * 1e-9
        good = np.isfinite(series.position) & (series.stamps_ns > 0)
        good &= (time >= first) & (time <= last)
        good &= ahead(time)
        if good.any():
            style = {'line_color': GREY, 'line_width': 1.5}
            panels['measured position [rad]'] = [
                Curve('measured position', '@ rad', time[good], series.position[good], style)
            ]
    reference = Curve('reference', '@ rad/s', rows[0].time, rows[0].truth, REFERENCE)
    velocities: list[Curve] = []
    errors, bands, statuses = [], [], []
    for i, row in enumerate(rows):
        name, line, estimate, stddev = row.source, styles[row.source].line, row.estimate, row.stddev
        error = estimate - row.truth
        velocities.append(Curve(name, '@ rad/s', row.time, estimate, line, name))
        errors.append(Curve(name, 'error @', row.time, error, line, name))
        if np.isfinite(stddev).any():
            fill = {'fill_color': line['line_color'], 'fill_alpha': 0.15}
            bands.append(Curve(name, '± @', row.time, SIGMAS_95 * stddev, fill, name, 'band'))
        inside = slice(*np.searchsorted(row.status_time, [first, np.nextafter(last, np.inf)]))
        if len(row.status[inside]):
            offset = SPACING * (i / (len(rows) - 1) - 0.5) if len(rows) > 1 else 0.0
            at, status = row.status_time[inside], row.status[inside] + offset
            statuses.append(Curve(name, '@', at, status, line, name, 'step'))
    panels['velocity [rad/s]; grey: reference'] = [*velocities, reference]
    panels['error and 95 % interval [rad/s]'] = errors + bands
    if statuses:
        panels['status'] = statuses
    return over_time(panels, instants, shown, STATUS_NAMES)


def lines(
    plot: Any,
    found: Sequence[tuple[str, Array, Array]],
    styles: Mapping[str, Style],
    shown: Collection[str],
) -> Any:
    """Add lines (source, x, y), of shape (n,) each, to a plot; return it."""
    for source, x, y in reversed(found):  # the best is on top
        plot.line(x, y, name=printable(source), visible=source in shown, **styles[source].line)
    return plot


def around_the_worst(best: Row, rows: Sequence[Row]) -> tuple[Any, Any]:
    """Return the plot of every sample around the largest error of the best estimate, and lines."""
    worst = int(np.nanargmax(np.abs(best.estimate - best.truth)))
    low, high = max(0, worst - WORST_NEIGHBOURS), min(len(best.time), worst + WORST_NEIGHBOURS)
    window = best.time[low], best.time[high - 1]
    plot = figure('around the largest error: every sample', 'time [s]', 'velocity [rad/s]')
    plot.line(best.time[low:high], best.truth[low:high], **REFERENCE)
    found = []
    for row in rows:
        inside = slice(*np.searchsorted(row.time, [window[0], np.nextafter(window[1], np.inf)]))
        found.append((row.source, row.time[inside], row.estimate[inside]))
    return plot, found


def error_by_speed(rows: Sequence[Row]) -> tuple[Any, Any]:
    """Return the plot of the rms error in bins of the reference's speed, and its lines."""
    found = [(row.source, *by_speed(row.truth, row.estimate - row.truth)) for row in rows]
    return figure(
        'error against speed', 'speed of the reference [rad/s]', 'rms error [rad/s]'
    ), found


def error_spectrum(rows: Sequence[Row]) -> tuple[Any, Any]:
    """Return the plot of the spectral density of the errors, and its lines."""
    found = []
    for row in rows:
        frequency, root = density(row.time, row.estimate - row.truth)
        if len(frequency) > FREQUENCIES:  # means of bins that are even on the axis
            edges = np.geomspace(frequency[0], frequency[-1] * 1.001, FREQUENCIES)
            starts = np.unique(np.searchsorted(frequency, edges[:-1]))
            count = np.diff(starts, append=len(frequency))
            frequency = np.add.reduceat(frequency, starts) / count
            root = np.sqrt(np.add.reduceat(root**2, starts) / count)
        found.append((row.source, frequency, np.where(root > 0.0, root, np.nan)))
    axes: dict[str, Any] = {'x_axis_type': 'log', 'y_axis_type': 'log'}
    return figure('spectrum of the error', 'frequency [Hz]', '(rad/s) / root Hz', **axes), found
