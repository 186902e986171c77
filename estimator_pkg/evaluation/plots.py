# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Plots of a page, drawn by Bokeh, and the page around them: one file that loads nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UserError
from estimator_pkg.optional import needs
from estimator_pkg.printable import printable

Array = NDArray[np.float64]

COLOURS = ('#0072b2', '#d55e00', '#009e73', '#b8508f', '#b98500', '#3d3d3d', '#56b4e9')
DASHES = ('', '7 3', '2 3', '9 3 2 3', '5 2', '12 4', '4 3 1 3')
GREY = '#9a9a9e'  # of references
MOST_NUMBERS = 1_200_000  # of all curves over time of a page: 6.4 MB
FEWEST_POINTS = 200  # points of a curve
LINE_GAP = 10.0  # a line is not drawn across a longer gap [median sample times]
OUTLIER_PERCENT = 99.5  # an outlier beyond OUTLIER_ROOM times this percentile is marked, not drawn
OUTLIER_ROOM = 2.5
TALL_PANEL, LOW_PANEL = 250, 130  # height of a panel [pixels]
TEMPLATES = resources.files(__package__) / 'templates'


def check() -> None:
    """Raise UserError if the library is missing: called before the work, not after it."""
    try:
        import bokeh  # noqa: F401
    except ImportError as error:
        raise UserError(f'--html: {needs("bokeh")}') from error


class Style(NamedTuple):
    """Colour and dashes [pixels] of an estimate's lines, the same in all plots."""

    colour: str
    dash: str = ''

    @property
    def line(self) -> dict[str, Any]:
        """Properties of a line of Bokeh."""
        return {'line_color': self.colour, 'line_dash': self.dash, 'line_width': 1.5}


def styles(sources: Iterable[str]) -> dict[str, Style]:
    """Return a style for each; colours and dashes both differ between neighbours."""
    return {
        source: Style(COLOURS[i % len(COLOURS)], DASHES[(i + i // len(COLOURS)) % len(DASHES)])
        for i, source in enumerate(sources)
    }


class Curve(NamedTuple):
    """A curve over time.

    label, text : the line of the tooltip and what it says there; '@' becomes the value.
    time, values : shape (n,), time increasing [s]; nan: none.
    style : of the line. source : the estimate that the legend shows and hides; '': always shown.
    kind : 'line', 'step', or 'band' from -values to values.
    """

    label: str
    text: str
    time: NDArray[np.floating]
    values: NDArray
    style: Mapping[str, Any] = MappingProxyType({'line_color': GREY, 'line_width': 1.5})
    source: str = ''
    kind: str = 'line'

    def at(self, times: Array) -> NDArray[np.float32]:
        """Return the values at `times` [s], shape (k,): nan in gaps and outside."""
        time, values = self.time, np.asarray(self.values, float)
        before = np.searchsorted(time, times, side='right') - 1
        if self.kind == 'step':
            return np.where(before < 0, np.nan, values[np.maximum(before, 0)]).astype(np.float32)
        found = np.interp(times, time, values, left=np.nan, right=np.nan)
        before = np.clip(before, 0, max(len(time) - 2, 0))
        after = np.minimum(before + 1, len(time) - 1)
        hole = (time[after] - time[before] > longest(time)) & (times > time[before])
        found[hole & (times < time[after])] = np.nan
        return found.astype(np.float32)


def ahead(time: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return where times, shape (n,), are later than all before: the clock may jump back."""
    return np.append(True, time[1:] > np.maximum.accumulate(time)[:-1])[: len(time)]


def sample_times(time: NDArray[np.floating]) -> dict[str, list[Curve]]:
    """Return the panel of the times between samples at `time`, shape (n,) [s], by its title."""
    steps, line = np.diff(time, prepend=np.nan) * 1e3, Style(COLOURS[0]).line
    return {'time since the sample before [ms]': [Curve('sample time', '@ ms', time, steps, line)]}


def longest(time: NDArray[np.floating]) -> float:
    """Return the longest time that a line crosses [s], of sample times, shape (n,) [s]."""
    return LINE_GAP * float(np.median(np.diff(time))) if len(time) > 1 else np.inf


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
    low, high = np.percentile(known, [100.0 - OUTLIER_PERCENT, OUTLIER_PERCENT])
    room = 0.5 * (OUTLIER_ROOM - 1.0) * max(float(high - low), 1e-9)
    least, most = float(known.min()), float(known.max())
    if least >= low - room and most <= high + room:
        return None
    return max(float(low) - room, least - 0.1 * room), min(float(high) + room, most + 0.1 * room)


def instants(curves: Sequence[Curve], rows: int) -> tuple[Array, str]:
    """Return (times [s], shape (k,), what is left out, as a sentence or '').

    These are all times, or those of the lowest and the highest value of each curve in stretches of
    equal length; and two in each gap. At each of them all curves have the values of that instant.
    """
    most = max(len(each.time) for each in curves)
    drawn = [each for each in curves if each.kind != 'band']
    points = rows if most <= rows else max(FEWEST_POINTS, rows // len(drawn))
    times = [each.time[extremes(each.values, points)] for each in drawn]
    for each in drawn:
        steps = np.diff(each.time)
        if each.kind == 'line':
            holes = np.flatnonzero(steps > longest(each.time))
            times += [each.time[holes] + part * steps[holes] for part in (0.001, 0.999)]
    chosen = np.unique(np.concatenate(times))
    if most <= points:
        return chosen, ''
    span = (chosen[-1] - chosen[0]) / (points // 2)
    return chosen, (
        f'Drawn: {len(chosen)} of {most} instants, with the lowest and the highest value of every '
        f'curve in each {span:.2g} s. Between them, zooming shows no more detail.'
    )


def over_time(
    panels: Mapping[str, Sequence[Curve]],
    rows: int,
    shown: Iterable[str] = (),
    names: Sequence[str] = (),
    whole: bool = False,
) -> tuple[Any, str]:
    """Return (panels above each other with one time axis, what is left out).

    Parameters
    ----------
    panels : by title, each with its most important curve first. rows : most instants.
    shown : sources that are visible at first.
    names : of the integer values of steps. whole : outliers are in the picture.
    """
    from bokeh.layouts import gridplot
    from bokeh.models import (
        ColumnDataSource,
        CrosshairTool,
        CustomJSHover,
        CustomJSTransform,
        FixedTicker,
        HoverTool,
        Range1d,
        Span,
    )

    curves = [each for panel in panels.values() for each in panel]
    times, note = instants(curves, rows)
    columns: dict[str, NDArray] = {'time': times, 'zero': np.zeros(len(times), np.int8)}
    tips: dict[str, list[str]] = {'time': ['@time{%.4f} s']}
    formats: dict[str, Any] = {'@time': 'printf'}
    status = CustomJSHover(
        args={'names': list(names)}, code='return names[Math.round(value)] ?? "-"'
    )
    minus = CustomJSTransform(v_func='return xs.map(x => -x)')
    cursor = CrosshairTool(
        overlay=Span(dimension='height', line_color=GREY, line_dash='dotted'), visible=False
    )
    data, shown = ColumnDataSource(), {'', *shown}
    made: list[Any] = []
    hovers: list[Any] = []
    for title, panel in panels.items():
        steps = any(each.kind == 'step' for each in panel)
        plot = figure(title, '', '', LOW_PANEL if len(panel) == 1 or steps else TALL_PANEL)
        # A line that is not seen has a point at each instant, which the pointer finds.
        plot.extra_y_ranges = {'middle': Range1d(-1, 1)}
        every = plot.line('time', 'zero', source=data, line_alpha=0.0, y_range_name='middle')
        lines, draws = [], []
        for each in panel:
            name = f'c{len(columns)}'
            columns[name] = each.at(times)
            if each.kind == 'band':  # Bokeh fills it across nan
                columns[name] = np.nan_to_num(columns[name])
            formats[f'@{name}'] = status if each.kind == 'step' else 'printf'
            tip = each.text.replace('@', f'@{name}{{%.4g}}')
            tips.setdefault(printable(each.label), []).append(tip)
            draws.append((each, name))
        for each, name in reversed(draws):  # the first is on top
            more = {'source': data, 'visible': each.source in shown, **each.style}
            more |= {'name': printable(each.source)} if each.source else {}
            if each.kind == 'band':
                plot.varea('time', {'field': name, 'transform': minus}, name, **more)
            elif each.kind == 'step':
                lines.append(plot.step('time', name, mode='after', **more))
            else:
                lines.append(plot.line('time', name, **more))
        plot.y_range.renderers = lines  # not `every`, nor bands: they are wide at a start
        front = [each for each in panel if each.kind == 'line' and each.source in shown]
        outer = None if whole else limits(each.values for each in front)
        if outer:
            plot.y_range = Range1d(*outer)
            plot.title.text += '\noutliers are beyond'
        if steps:
            ticks = range(1 + round(max(float(np.nanmax(each.values)) for each in panel)))
            plot.y_range = Range1d(-0.6, len(ticks) - 0.4)
            plot.yaxis.ticker = FixedTicker(ticks=list(ticks))
            plot.yaxis.major_label_overrides = {i: names[i] for i in ticks}
        hovers.append(
            HoverTool(renderers=[every], mode='vline', point_policy='follow_mouse', visible=False)
        )
        plot.add_tools(hovers[-1], cursor)
        plot.x_range = made[0].x_range if made else plot.x_range
        made.append(plot)
    data.data = columns
    for hover in hovers:  # each shows the values of all panels
        hover.tooltips = [(label, ', '.join(texts)) for label, texts in tips.items()]
        hover.formatters = formats
    made[-1].xaxis.axis_label = 'time [s]'
    made[-1].height += 25
    return gridplot([[each] for each in made], sizing_mode='stretch_width'), note


def figure(title: str, x: str, y: str, height: int = TALL_PANEL, **more: Any) -> Any:
    """Return an empty plot: axes with labels, and the tools of all plots."""
    from bokeh.models import WheelZoomTool
    from bokeh.plotting import figure as plot

    made = plot(
        title=title.replace('; ', '\n'),  # short lines fit a phone
        x_axis_label=x,
        y_axis_label=y,
        height=height,
        sizing_mode='stretch_width',
        tools='box_zoom,pan,reset,save',
        active_drag='box_zoom',
        min_border_left=70,
        window_axis='x',  # zoomed in time, the vertical axis follows
        **more,
    )
    wheel = WheelZoomTool(modifiers='ctrl')  # the wheel alone scrolls the page
    made.add_tools(wheel)
    made.toolbar.active_scroll = wheel
    made.toolbar.logo = None
    for each in (made.x_range, made.y_range):
        if hasattr(each, 'only_visible'):
            each.only_visible = True
    return made


def page(template: str, drawn: Sequence[Any], **values: Any) -> str:
    """Return a page with style, library, data and plots in it: it loads nothing.

    Parameters
    ----------
    template : a file of `TEMPLATES`, for which ``plots[i]`` is the place of ``drawn[i]``. Texts
        become `printable` there, and HTML in them is escaped.
    """
    from bokeh.embed import components
    from bokeh.resources import Resources
    from jinja2 import Environment, FileSystemLoader

    library, script, places = '', '', ()
    if drawn:
        script, places = components(tuple(drawn))
        library = Resources(mode='inline', components=['bokeh']).render_js()
    environment = Environment(
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda each: each if hasattr(each, '__html__') else printable(each),
        loader=FileSystemLoader(str(TEMPLATES)),
    )
    return environment.get_template(template).render(
        plots=places, library=library, script=script, **values
    )
