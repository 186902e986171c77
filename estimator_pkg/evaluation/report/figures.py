# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The two figures of a page: the curves of a joint over time, and noise against delay."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from estimator_pkg.estimate import STATUS_NAMES
from estimator_pkg.evaluation.compare.comparison import SIGMAS_95, Comparison, Row
from estimator_pkg.evaluation.plots import GREY, Curve, Style, ahead, figure, over_time
from estimator_pkg.evaluation.report.tradeoff import Sweep, front
from estimator_pkg.printable import printable

SPACING = 0.5  # lines of several statuses are drawn within this distance
REFERENCE = {'line_color': GREY, 'line_width': 3}
IN_VIEW = 2.0  # curves are drawn up to this multiple of the points' range
DARK = '#1d1d1f'


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


def noise_against_delay(found: Sequence[Sweep], styles: Mapping[str, Style]) -> Any:
    """Return the plot of noise against delay; None if the motion determines no delay."""
    from bokeh.models import ColumnDataSource, HoverTool

    there = [each for each in found if np.isfinite(each.own).all()]
    if not there:
        return None
    late, noise = np.transpose([each.own for each in there])
    widest, top = IN_VIEW * max(float(late.max()), 1e-3), IN_VIEW * max(float(noise.max()), 1e-12)
    plot = figure('noise against delay', 'delay [ms]', 'noise [rad/s]', 340, y_axis_type='log')
    best = front([*(each.own for each in found), *(at for each in found for at in each.curve)])
    seen = [(x * 1e3, y) for x, y in best if x <= widest and y <= top]
    if seen:
        band = {'line_color': GREY, 'line_width': 7, 'line_alpha': 0.45}
        plot.step(*np.transpose(seen), mode='after', **band)
    for each in found:
        x, y = each.curve.T
        near = (x <= widest) & (y <= top) & (y > 0.0)
        plot.line(x[near] * 1e3, y[near], **styles[each.source].line)
    colours = [styles[each.source].colour for each in there]
    on_front = [(max(each.own[0], 0.0), each.own[1]) in best for each in there]
    columns = {
        'x': late * 1e3,
        'y': noise,
        'name': [printable(each.source) for each in there],
        'colour': colours,
        'rim': [DARK if each else colour for each, colour in zip(on_front, colours)],
    }
    look = {'size': 11, 'fill_color': 'colour', 'line_color': 'rim', 'line_width': 2}
    points = plot.scatter('x', 'y', source=ColumnDataSource(columns), **look)
    tips = [('', '@name'), ('delay', '@x{0.00} ms'), ('noise', '@y{0.0000} rad/s')]
    plot.add_tools(HoverTool(renderers=[points], tooltips=tips, visible=False))
    return plot
