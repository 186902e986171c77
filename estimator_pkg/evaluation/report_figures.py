"""The interactive figures of a report page, drawn with Bokeh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.comparison import BAND, Comparison, Row
from estimator_pkg.evaluation.findings import Measurement
from estimator_pkg.evaluation.spectrum import by_speed, density, normalised
from estimator_pkg.evaluation.thinning import changes, extremes
from estimator_pkg.observers.contract import STATUS_NAMES

COLOURS = ('#1f77b4', '#d62728', '#2ca02c', '#9467bd', '#ff7f0e', '#17becf', '#8c564b', '#e377c2',
           '#7f7f7f', '#bcbd22')
INK = '#222222'
WIDE, HALF, HIGH, LOW = 1080, 535, 260, 150
HOLES_MARKED = 200
TOOLS = 'box_zoom,pan,xwheel_zoom,reset,save'


def _short(values: NDArray) -> NDArray:
    """Half the bytes: seven digits are enough to be drawn."""
    return np.asarray(values, np.float32)


def over_time(comparison: Comparison, joint: str, rows: Sequence[Row], points: int) -> list[Any]:
    """Angle, velocity, error and status over time, their zoom linked."""
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


def closer(comparison: Comparison, rows: Sequence[Row]) -> list[Any]:
    """Error against speed, its spectrum and its distribution in units of its deviation."""
    return [_by_speed(rows), _spectrum(rows), _distribution(rows)]


def sample_times(seen: Measurement) -> Any:
    """Histogram of sample times, the holes marked."""
    shown = _figure('sample times', HALF, HIGH, x_axis_type='log', y_axis_type='log')
    milliseconds = seen.steps[seen.steps > 0.0] * 1e3
    low, high = float(np.min(milliseconds)), float(np.max(milliseconds))
    edges = np.geomspace(low * 0.9, high * 1.1, 80)
    heights, _ = np.histogram(milliseconds, edges)
    full = heights > 0
    shown.quad(top=heights[full].astype(float), bottom=0.5, left=edges[:-1][full],
               right=edges[1:][full], color=COLOURS[0], alpha=0.7)
    holes = np.array([length for _, length in seen.holes[:HOLES_MARKED]]) * 1e3
    if len(holes):
        shown.scatter(holes, np.full(len(holes), 0.75), marker='triangle', size=9,
                      color=COLOURS[1], legend_label='holes')
    shown.xaxis.axis_label = 'sample time [ms]'
    shown.yaxis.axis_label = 'samples'
    return shown


def _figure(title: str, width: int, height: int, **options: Any) -> Any:
    from bokeh.plotting import figure
    made = figure(title=title, width=width, height=height, tools=TOOLS, active_drag='box_zoom',
                  toolbar_location='right', **options)
    made.toolbar.logo = None
    made.grid.grid_line_alpha = 0.4
    made.min_border_left = 70
    return made


def _finish(figure: Any) -> Any:
    """The legend in a place where it hides no data, each line switched by a click."""
    if figure.legend:
        legend = figure.legend[0]
        legend.click_policy = 'hide'
        legend.label_text_font_size = '8pt'
        legend.spacing = 0
        legend.padding = 4
        legend.background_fill_alpha = 0.7
        legend.location = 'top_right'
    return figure


def _angle(comparison: Comparison, joint: str, points: int, shared: Any) -> Any:
    series = comparison.measurement[joint]
    shown = _figure(f'{joint}: measured position [rad]', WIDE, LOW, x_range=shared)
    good = np.isfinite(series.position) & (series.stamps_ns > 0)
    time = (series.stamps_ns[good] - comparison.starts[joint]) * 1e-9
    position = series.position[good]
    chosen = extremes(position, points)
    shown.line(time[chosen], _short(position[chosen]), color=INK, line_width=1)
    return shown


def _velocity(rows: Sequence[Row], points: int, shared: Any) -> Any:
    shown = _figure('velocity against the reference [rad/s]', WIDE, HIGH, x_range=shared)
    chosen = extremes(rows[0].truth, points)
    shown.line(rows[0].time[chosen], _short(rows[0].truth[chosen]), color=INK, line_width=3,
               alpha=0.4, legend_label='reference')
    for row, colour in zip(rows, _colours(rows)):
        chosen = extremes(row.estimate, points)
        time = row.time[chosen]
        if len(rows) == 1 and np.isfinite(row.stddev).any():
            band = BAND * row.stddev[chosen]
            shown.varea(time, _short(row.estimate[chosen] - band),
                        _short(row.estimate[chosen] + band), color=colour, alpha=0.25,
                        legend_label='95 % band')
        shown.line(time, _short(row.estimate[chosen]), color=colour, line_width=1.2,
                   legend_label=row.source)
    return _finish(shown)


def _error(rows: Sequence[Row], points: int, shared: Any) -> Any:
    shown = _figure('error and its 95 % band [rad/s]', WIDE, HIGH, x_range=shared)
    for row, colour in zip(rows, _colours(rows)):
        error = row.estimate - row.truth
        chosen = extremes(error, points)
        time = row.time[chosen]
        if np.isfinite(row.stddev).any():
            band = _short(BAND * row.stddev[chosen])
            shown.varea(time, -band, band, color=colour, alpha=0.15, legend_label=row.source)
        shown.line(time, _short(error[chosen]), color=colour, line_width=1,
                   legend_label=row.source)
    return _finish(shown)


def _status(rows: Sequence[Row], points: int, shared: Any) -> Any:
    from bokeh.models import FixedTicker
    shown = _figure('status', WIDE, LOW, x_range=shared)
    for row, colour in zip(rows, _colours(rows)):
        if len(row.status):
            chosen = changes(row.status, points)
            shown.step(row.status_time[chosen], row.status[chosen].astype(float), mode='after',
                       color=colour, line_width=1.5, legend_label=row.source)
    shown.yaxis.ticker = FixedTicker(ticks=list(range(len(STATUS_NAMES))))
    shown.yaxis.major_label_overrides = dict(enumerate(STATUS_NAMES))
    return _finish(shown)


def _by_speed(rows: Sequence[Row]) -> Any:
    shown = _figure('error against speed', HALF, HIGH)
    for row, colour in zip(rows, _colours(rows)):
        speed, rms, _ = by_speed(row.truth, row.estimate - row.truth)
        shown.line(speed, rms, color=colour, legend_label=row.source)
        shown.scatter(speed, rms, color=colour, size=4, legend_label=row.source)
    shown.y_range.start = 0.0
    shown.xaxis.axis_label = 'speed of the reference [rad/s]'
    shown.yaxis.axis_label = 'rms error [rad/s]'
    return _finish(shown)


def _spectrum(rows: Sequence[Row]) -> Any:
    shown = _figure('spectrum of the error', HALF, HIGH, x_axis_type='log', y_axis_type='log')
    for row, colour in zip(rows, _colours(rows)):
        frequency, root = density(row.time, row.estimate - row.truth)
        known = root > 0.0
        shown.line(frequency[known], root[known], color=colour, legend_label=row.source)
    shown.xaxis.axis_label = 'frequency [Hz]'
    shown.yaxis.axis_label = '(rad/s) / root Hz'
    return _finish(shown)


def _distribution(rows: Sequence[Row]) -> Any:
    shown = _figure('error in units of its standard deviation', HALF, HIGH)
    for row, colour in zip(rows, _colours(rows)):
        middles, heights = normalised(row.estimate - row.truth,
                                       np.hypot(row.stddev, row.reference_noise))
        if len(middles):
            shown.step(middles, heights, mode='center', color=colour,
                       legend_label=f'{row.source} ({row.coverage:.0%} within 95 %)')
    at = np.linspace(-5.0, 5.0, 101)
    shown.line(at, np.exp(-0.5 * at * at) / math.sqrt(2.0 * math.pi), color=INK, line_dash='4 2',
               legend_label='as it should be')
    shown.xaxis.axis_label = 'error / standard deviation (beyond 5: in the last cell)'
    return _finish(shown)


def _colours(rows: Sequence[Row]) -> list[str]:
    return [COLOURS[i % len(COLOURS)] for i in range(len(rows))]
