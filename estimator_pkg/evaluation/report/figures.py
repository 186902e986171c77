# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The two figures of a page: the curves of a joint over time, and noise against delay."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from estimator_pkg.estimate import STATUS_NAMES
from estimator_pkg.evaluation.compare.evaluate import Comparison, Row
from estimator_pkg.evaluation.compare.metrics import SIGMAS_95, rms_at_delay
from estimator_pkg.evaluation.plots import GREY, Curve, Style, ahead, figure, over_time
from estimator_pkg.printable import printable

SPACING = 0.5  # lines of several statuses are drawn within this distance
REFERENCE = {'line_color': GREY, 'line_width': 3}


def over_time_of_joint(
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
        time = (series.stamps_ns - comparison.start(joint)) * 1e-9
        good = np.isfinite(series.position) & (series.stamps_ns > 0)
        good &= (time >= first) & (time <= last) & ahead(time)
        if good.any():
            measured = Curve('measured position', '@ rad', time[good], series.position[good])
            panels['measured position [rad]'] = [measured]
    velocities: list[Curve] = []
    errors, bands, statuses = [], [], []
    for i, row in enumerate(rows):
        name, line, time = row.source, styles[row.source].line, row.time
        velocities.append(Curve(name, '@ rad/s', time, row.estimate, line, name))
        errors.append(Curve(name, 'error @', time, row.estimate - row.truth, line, name))
        if np.isfinite(row.stddev).any():
            fill = {'fill_color': line['line_color'], 'fill_alpha': 0.15}
            bands.append(Curve(name, '± @', time, SIGMAS_95 * row.stddev, fill, name, 'band'))
        inside = slice(*np.searchsorted(row.status_time, [first, np.nextafter(last, np.inf)]))
        if len(row.status[inside]):
            offset = SPACING * (i / (len(rows) - 1) - 0.5) if len(rows) > 1 else 0.0
            at, status = row.status_time[inside], row.status[inside] + offset
            statuses.append(Curve(name, '@', at, status, line, name, 'step'))
    reference = Curve('reference', '@ rad/s', rows[0].time, rows[0].truth, REFERENCE)
    panels['velocity [rad/s]; grey: reference'] = [*velocities, reference]
    panels['error and 95 % interval [rad/s]'] = errors + bands
    if statuses:
        panels['status'] = statuses
    return over_time(panels, instants, shown, STATUS_NAMES)


def noise_against_delay(rows: Sequence[Row], styles: Mapping[str, Style]) -> Any:
    """Return the plot of noise against delay; None if the motion determines no delay.

    The noise is the rms error against the truth with the same delay.
    """
    from bokeh.models import ColumnDataSource, HoverTool

    late = {row.source: row.velocity['delay_s'] for row in rows}
    there = [row for row in rows if np.isfinite(late[row.source])]
    if not there:
        return None
    columns = {
        'x': [1e3 * late[row.source] for row in there],
        'y': [rms_at_delay(row.time, row.estimate, row.truth, late[row.source]) for row in there],
        'name': [printable(row.source) for row in there],
        'colour': [styles[row.source].colour for row in there],
    }
    plot = figure('noise against delay', 'delay [ms]', 'noise [rad/s]', 340)
    data = ColumnDataSource(columns)
    points = plot.scatter('x', 'y', source=data, size=11, color='colour')
    tips = [('', '@name'), ('delay', '@x{0.00} ms'), ('noise', '@y{0.0000} rad/s')]
    plot.add_tools(HoverTool(renderers=[points], tooltips=tips, visible=False))
    return plot
