# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The interactive figures of a report page, drawn with Bokeh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.compare.comparison import BAND, Comparison, Row
from estimator_pkg.evaluation.report.findings import Measurement
from estimator_pkg.evaluation.report.spectrum import by_speed, density, normalised
from estimator_pkg.evaluation.report.thinning import broken, changes, extremes, limits
from estimator_pkg.observers.contract import STATUS_NAMES
from estimator_pkg.printable import printable

# JavaScript that runs whenever the range moves: it selects the lowest and the highest point in each
# of `points` / 2 equal parts of the range, as `thinning.extremes` does; nan (a gap) stays.
CHOOSE = """
if (shown.tags[0]) return;  // once per frame, however many bounds have moved
shown.tags[0] = true;
requestAnimationFrame(() => {
    shown.tags[0] = false;
    const x = whole.data.x, y = whole.data.y, xs = [], ys = [];
    const find = value => {
        let low = 0, high = x.length;
        while (low < high) {
            const middle = (low + high) >> 1;
            if (x[middle] < value) low = middle + 1; else high = middle;
        }
        return low;
    };
    const first = Math.max(0, find(range.start) - 1);
    const last = Math.min(x.length, find(range.end) + 1);
    const length = Math.max(1, Math.ceil(2 * (last - first) / points));
    for (let at = first; at < last; at += length) {
        const end = Math.min(at + length, last);
        let low = at, high = at, hole = -1;
        for (let i = at; i < end; i++) {
            if (y[i] !== y[i]) hole = i;
            if (y[i] < y[low] || y[low] !== y[low]) low = i;
            if (y[i] > y[high] || y[high] !== y[high]) high = i;
        }
        const chosen = new Set([low, high]);
        if (hole >= 0) chosen.add(hole);
        for (const i of [...chosen].sort((a, b) => a - b)) { xs.push(x[i]); ys.push(y[i]); }
    }
    shown.data = {x: xs, y: ys};
});
"""


def zoomed(span: Any, whole: Any, shown: Any, points: int) -> None:
    """Fill the source `shown` from `whole` with the points visible in the range `span`."""
    from bokeh.models import CustomJS

    shown.tags = [False]
    choose = CustomJS(
        args={'range': span, 'whole': whole, 'shown': shown, 'points': points}, code=CHOOSE
    )
    span.js_on_change('start', choose)
    span.js_on_change('end', choose)


COLOURS = (
    '#1f77b4',
    '#d62728',
    '#2ca02c',
    '#9467bd',
    '#ff7f0e',
    '#17becf',
    '#8c564b',
    '#e377c2',
    '#7f7f7f',
    '#bcbd22',
)
DASHES = ('solid', 'dashed', 'dotted')  # for more estimates than there are colours
INK = '#222222'
TRUE = '#a7a7a7'
HIGH, LOW = 260, 150
COLUMNS = 3  # of the legend
LEFT = 78  # width of the axis labels, so that all frames are aligned
HOLES_MARKED = 200
TOOLS = 'box_zoom,pan,xwheel_zoom,reset,save'
DRAWN = 1600  # points of a line that are drawn at a time
AROUND = 400  # samples on either side of the largest error


def _short(values: NDArray) -> NDArray:
    """Return half the bytes: seven digits are enough for drawing."""
    return np.asarray(values, np.float32)


def over_time(comparison: Comparison, joint: str, rows: Sequence[Row], points: int) -> list[Any]:
    """Return angle, velocity, error and status over time, with linked zoom."""
    from bokeh.models import Range1d

    first = min([float(row.time[0]) for row in rows])
    last = max([float(row.time[-1]) for row in rows])
    margin = 0.01 * max(last - first, 1e-3)
    shared = Range1d(start=first - margin, end=last + margin)
    figures = [_velocity(rows, points, shared), _error(rows, points, shared)]
    if joint in comparison.measurement:
        figures.insert(0, _angle(comparison, joint, points, shared))
    if any(len(row.status) for row in rows):
        figures.append(_status(rows, points, shared))
    for each in figures[:-1]:
        each.xaxis.major_label_text_font_size = '0pt'
    figures[-1].xaxis.axis_label = 'time [s]'
    figures[-1].height += 30
    return figures


def around_the_worst(rows: Sequence[Row]) -> Any:
    """Return every sample around the largest error of the best estimate, without thinning."""
    from bokeh.models import Range1d

    best = min(rows, key=lambda row: row.velocity['rms'])
    worst = int(np.nanargmax(np.abs(best.estimate - best.truth)))
    window = (
        float(best.time[max(0, worst - AROUND)]),
        float(best.time[min(len(best.time) - 1, worst + AROUND)]),
    )
    shown = _figure(
        f'around the largest error of {best.source} [rad/s]',
        HIGH,
        x_range=Range1d(start=window[0], end=window[1]),
    )
    parts = [
        (row, style, slice(*np.searchsorted(row.time, window))) for row, style in _lookup(rows)
    ]
    here = slice(*np.searchsorted(best.time, window))
    _line(
        shown,
        best.time[here],
        best.truth[here],
        np.arange(here.stop - here.start),
        color=TRUE,
        line_width=3,
        name='reference',
    )
    outer = limits([best.truth[here], *(row.estimate[part] for row, _, part in parts)])
    for row, style, part in parts:
        time, estimate = row.time[part], row.estimate[part]
        if not len(time):
            continue
        _line(shown, time, estimate, np.arange(len(time)), line_width=1.2, **style)
        if outer:
            _mark_outside(shown, outer, time, estimate, style)
    shown.xaxis.axis_label = 'time [s]'
    return shown


def link(figures: Sequence[Any]) -> None:
    """Link the legend: a click on a name hides that estimate in all figures."""
    for item in next(figure.legend[0] for figure in figures if figure.legend).items:
        name = item.label.value
        leader = item.renderers[0]
        for figure in figures:
            for renderer in figure.renderers:
                if renderer.name == name and renderer is not leader:
                    leader.js_link('visible', renderer, 'visible')


def closer(comparison: Comparison, rows: Sequence[Row]) -> list[Any]:
    """Return error against speed, its spectrum, and its normalised distribution."""
    return [_by_speed(rows), _spectrum(rows), _distribution(rows)]


def sample_times(seen: Measurement) -> Any:
    """Return a histogram of sample times with the gaps marked."""
    holes = np.array([length for _, length in seen.holes[:HOLES_MARKED]]) * 1e3
    title = 'sample times' + (' (triangles: gaps)' if len(holes) else '')
    milliseconds = seen.steps[seen.steps > 0.0] * 1e3
    low, high = float(np.min(milliseconds)), float(np.max(milliseconds))
    usual = 1e3 / seen.rate
    edges = np.geomspace(min(low * 0.9, 0.5 * usual), max(high * 1.1, 2.0 * usual), 81)
    heights, _ = np.histogram(milliseconds, edges)
    shown = _figure(
        title,
        HIGH,
        x_axis_type='log',
        y_axis_type='log',
        x_range=(float(edges[0]), float(edges[-1])),
    )
    full = heights > 0
    shown.quad(
        top=heights[full].astype(float),
        bottom=0.5,
        left=edges[:-1][full],
        right=edges[1:][full],
        color=COLOURS[0],
        alpha=0.7,
    )
    if len(holes):
        shown.scatter(holes, np.full(len(holes), 0.75), marker='triangle', size=9, color=COLOURS[1])
    shown.xaxis.axis_label = 'sample time [ms]'
    shown.yaxis.axis_label = 'samples'
    return shown


def _figure(title: str, height: int, **options: Any) -> Any:
    from bokeh.plotting import figure

    made = figure(
        title=printable(title),
        height=height,
        sizing_mode='stretch_width',
        tools=TOOLS,
        active_drag='box_zoom',
        toolbar_location='above',
        **options,
    )
    made.toolbar.logo = None
    made.grid.grid_line_alpha = 0.4
    made.min_border_left = LEFT
    made.min_border_right = 20
    return made


def _legend(figure: Any) -> Any:
    """Put the legend above the frame, in columns that fit a narrow page; return it."""
    legend = figure.legend[0]
    figure.center.remove(legend)
    figure.add_layout(legend, 'above')
    legend.click_policy = 'hide'
    legend.label_text_font_size = '9pt'
    legend.orientation = 'horizontal'
    legend.ncols = min(len(legend.items), COLUMNS)
    legend.border_line_alpha = 0.0
    legend.padding = 2
    legend.margin = 0
    figure.height += 20 * -(-len(legend.items) // COLUMNS)
    return figure


def _line(
    figure: Any, time: NDArray, values: NDArray, chosen: NDArray[np.int64], **style: Any
) -> None:
    """Draw a line; for many points, each zoom selects which of them are drawn."""
    from bokeh.models import ColumnDataSource

    at, drawn = broken(time, values, chosen)
    whole = ColumnDataSource({'x': at, 'y': _short(drawn)})
    if len(at) <= DRAWN:
        figure.line('x', 'y', source=whole, **style)
        return
    few = extremes(drawn, DRAWN)
    style['line_width'] = 1  # browsers draw thin lines many times faster
    shown = ColumnDataSource({'x': at[few], 'y': _short(drawn[few])})
    figure.line('x', 'y', source=shown, **style)
    zoomed(figure.x_range, whole, shown, DRAWN)


def _lookup(rows: Sequence[Row]) -> list[tuple[Row, dict[str, Any]]]:
    """Return each row with the style of its lines."""
    return [
        (
            row,
            {
                'color': COLOURS[i % len(COLOURS)],
                'name': row.source,
                'line_dash': DASHES[i // len(COLOURS) % len(DASHES)],
            },
        )
        for i, row in enumerate(rows)
    ]


def _mark_outside(
    figure: Any, outer: tuple[float, float], time: NDArray, values: NDArray, style: dict[str, Any]
) -> None:
    """Draw small triangles at the edge of the frame where a line leaves it."""
    from bokeh.models import Range1d

    low, high = outer
    figure.y_range = Range1d(start=low, end=high)
    for outside, edge, marker in (
        (values > high, high, 'triangle'),
        (values < low, low, 'inverted_triangle'),
    ):
        if outside.any():
            figure.scatter(
                time[outside],
                np.full(int(outside.sum()), edge),
                marker=marker,
                size=8,
                color=style['color'],
                name=style['name'],
            )


def _angle(comparison: Comparison, joint: str, points: int, shared: Any) -> Any:
    series = comparison.measurement[joint]
    shown = _figure('measured position [rad]', LOW, x_range=shared)
    good = np.isfinite(series.position) & (series.stamps_ns > 0)
    time = (series.stamps_ns[good] - comparison.starts[joint]) * 1e-9
    position = series.position[good]
    chosen = extremes(position, points)
    _line(shown, time, position, chosen, color=INK, line_width=1)
    return shown


def _velocity(rows: Sequence[Row], points: int, shared: Any) -> Any:
    shown = _figure('velocity against the reference [rad/s]', HIGH, x_range=shared)
    chosen = extremes(rows[0].truth, points)
    _line(
        shown,
        rows[0].time,
        rows[0].truth,
        chosen,
        color=TRUE,
        line_width=3,
        legend_label='reference',
        name='reference',
    )
    outer = limits(chain([rows[0].truth], (row.estimate for row in rows)))
    for row, style in _lookup(rows):
        chosen = extremes(row.estimate, points)
        time, estimate = row.time[chosen], row.estimate[chosen]
        if len(rows) == 1 and np.isfinite(row.stddev).any():
            few = extremes(row.estimate, DRAWN)
            middle, band = row.estimate[few], BAND * row.stddev[few]
            shown.varea(
                row.time[few],
                _short(middle - band),
                _short(middle + band),
                color=style['color'],
                legend_label='95 % band',
                name='95 % band',
            )
        _line(
            shown,
            row.time,
            row.estimate,
            chosen,
            line_width=1.2,
            legend_label=printable(row.source),
            **style,
        )
        if outer:
            _mark_outside(shown, outer, time, estimate, style)
    return _legend(shown)


def _error(rows: Sequence[Row], points: int, shared: Any) -> Any:
    def error_of(row: Row) -> NDArray:
        return row.estimate - row.truth  # computed one at a time: they may be long

    outer = limits(error_of(row) for row in rows)
    if outer is None:
        outer = (
            min(float(np.nanmin(error_of(row))) for row in rows),
            max(float(np.nanmax(error_of(row))) for row in rows),
        )
    room = 0.05 * max(outer[1] - outer[0], 1e-9)
    outer = outer[0] - room, outer[1] + room  # range of the errors: the bands may be wider
    shown = _figure('error and 95 % band [rad/s]', HIGH, x_range=shared)
    for row, style in _lookup(rows):
        error = error_of(row)
        chosen = extremes(error, points)
        time = row.time[chosen]
        if np.isfinite(row.stddev).any():
            few = extremes(error, DRAWN)
            band = _short(BAND * row.stddev[few])
            shown.varea(
                row.time[few], -band, band, color=style['color'], alpha=0.15, name=row.source
            )
        _line(shown, row.time, error, chosen, line_width=1, **style)
        _mark_outside(shown, outer, time, error[chosen], style)
    return shown


def _status(rows: Sequence[Row], points: int, shared: Any) -> Any:
    """Draw each estimate with a small offset, so that all are visible."""
    from bokeh.models import FixedTicker

    shown = _figure('status', LOW, x_range=shared)
    for i, (row, style) in enumerate(_lookup(rows)):
        if len(row.status):
            chosen = changes(row.status, points)
            beside = 0.5 * (i / max(1, len(rows) - 1) - 0.5) if len(rows) > 1 else 0.0
            shown.step(
                row.status_time[chosen],
                row.status[chosen] + beside,
                mode='after',
                line_width=1.5,
                **style,
            )
    # lines have an offset, so the range is that of the statuses: each keeps its label
    known = np.concatenate([row.status for row in rows])
    shown.y_range.start, shown.y_range.end = known.min() - 0.5, known.max() + 0.5
    shown.yaxis.ticker = FixedTicker(ticks=list(range(len(STATUS_NAMES))))
    shown.yaxis.major_label_overrides = dict(enumerate(STATUS_NAMES))
    return shown


def _by_speed(rows: Sequence[Row]) -> Any:
    shown = _figure('error against speed', HIGH)
    for row, style in _lookup(rows):
        speed, rms, _ = by_speed(row.truth, row.estimate - row.truth)
        shown.line(speed, rms, **style)
        shown.scatter(speed, rms, color=style['color'], size=4, name=row.source)
    shown.y_range.start = 0.0
    shown.xaxis.axis_label = 'speed of the reference [rad/s]'
    shown.yaxis.axis_label = 'rms error [rad/s]'
    return shown


def _spectrum(rows: Sequence[Row]) -> Any:
    shown = _figure('spectrum of the error', HIGH, x_axis_type='log', y_axis_type='log')
    for row, style in _lookup(rows):
        frequency, root = density(row.time, row.estimate - row.truth)
        known = root > 0.0
        shown.line(frequency[known], root[known], **style)
    shown.xaxis.axis_label = 'frequency [Hz]'
    shown.yaxis.axis_label = '(rad/s) / root Hz'
    return shown


def _distribution(rows: Sequence[Row]) -> Any:
    shown = _figure('error / deviation (dashed: expected)', HIGH)
    for row, style in _lookup(rows):
        middles, heights = normalised(
            row.estimate - row.truth, np.hypot(row.stddev, row.reference_noise)
        )
        if len(middles):
            shown.step(middles, heights, mode='center', **style)
    at = np.linspace(-5.0, 5.0, 101)
    shown.line(
        at,
        np.exp(-0.5 * at * at) / math.sqrt(2.0 * math.pi),
        color=INK,
        line_width=2,
        line_dash='6 3',
    )
    shown.xaxis.axis_label = 'standard deviations (outermost: beyond)'
    shown.yaxis.axis_label = 'density'
    return shown
