# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The chart of the field: a panel per column, a line per estimator."""

from __future__ import annotations

import math
import textwrap
from typing import Any

from benchmarks.field import WHOLE, milliseconds
from benchmarks.ours import AHEAD, INFORMED, OURS, PEERS, PRACTICE
from estimator_pkg.evaluation.report.plot import check

COLOURS = {
    OURS: '#1b6ca8',
    PRACTICE: '#b8860b',
    PEERS: '#c8553d',
    INFORMED: '#3f8f5b',
    AHEAD: '#8a8a8a',
}
MEANING = {
    OURS: 'ours',
    PRACTICE: 'what practitioners use',
    PEERS: 'installed libraries, causal',
    INFORMED: 'the torque is known too',
    AHEAD: 'non-causal: uses future samples',
}
ACROSS = 4  # largest number of panels in a row
NARROW = 30.0  # a narrower span (as a ratio) has ticks between the powers of ten
LEAST = 1e-5  # smaller errors are drawn here [rad/s]
WIDTH, LINE = 1.75, 0.21  # width of a panel, height of a line [in]


def draw(found: dict[str, Any], path: str, title: str) -> None:
    """Write the chart: a filled dot at the one setting, a ring at the best of the column.

    Raises
    ------
    UserError : matplotlib is missing, or does not support this file type.
    """
    check(path)
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine
    from matplotlib.lines import Line2D

    names, places = list(found['columns']), _places(found['rows'])
    down = -(-len(names) // ACROSS)
    across = -(-len(names) // down)
    lines = max(places.values()) + 1.0
    figure = Figure(
        figsize=(2.6 + WIDTH * across, 1.4 + down * (0.75 + LINE * lines)),
        layout=ConstrainedLayoutEngine(wspace=0.04),
    )
    axes = figure.subplots(down, across, squeeze=False, sharey=True)
    for axis, name in zip(axes.flat, names):
        _panel(axis, found, name, places)
    for axis in list(axes.flat)[len(names) :]:
        axis.set_visible(False)
    for row in axes:
        row[0].set_yticks(
            [places[row_['name']] for row_ in found['rows']],
            [row_['name'] for row_ in found['rows']],
            fontsize=9,
        )
        for label, row_ in zip(row[0].get_yticklabels(), found['rows']):
            label.set_color(COLOURS[row_['group']])
        row[0].set_ylim(lines - 0.4, -1.3)
    groups = [group for group in COLOURS if any(r['group'] == group for r in found['rows'])]
    handles = [
        Line2D([], [], color=COLOURS[group], marker='o', linestyle='', label=MEANING[group])
        for group in groups
    ]
    handles += [
        Line2D(
            [], [], color='#444444', marker='o', linestyle='', label='one setting for all columns'
        ),
        Line2D(
            [],
            [],
            color='#444444',
            marker='o',
            markerfacecolor='white',
            linestyle='',
            label='best setting for this column',
        ),
    ]
    if any(column['noise'] > 0.0 for column in found['columns'].values()):
        handles.append(
            Line2D([], [], color='#e8e3d3', linewidth=8, label="below the reference's own error")
        )
    figure.legend(handles=handles, loc='outside lower center', ncols=2, frameon=False, fontsize=9)
    figure.suptitle(
        f'{title}: velocity rms error [rad/s]\n'
        'in grey, at the one setting: its delay [ms] and (published fraction)',
        fontsize=11,
    )
    figure.savefig(path, dpi=100)


def _places(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return the height of each line, with gaps between the groups."""
    places, at, last = {}, -1.0, ''
    for row in rows:
        at += 1.0 if row['group'] in (last, '') or not last else 1.6
        places[row['name']], last = at, row['group']
    return places


def _panel(axis: Any, found: dict[str, Any], name: str, places: dict[str, float]) -> None:
    column = found['columns'][name]
    axis.set_xscale('log')
    shown = [LEAST]
    here = {row['group'] for row in found['rows'] if row['one'][name]['rms'] is not None}
    for row in found['rows']:
        one, best = row['one'][name], row['best'][name]
        at, colour = places[row['name']], COLOURS[row['group']]
        axis.axhline(at, color='#efefef', linewidth=0.7, zorder=0)
        ends = [max(cell['rms'], LEAST) for cell in (one, best) if cell['rms'] is not None]
        shown += ends
        if len(ends) == 2:
            axis.plot(ends, [at, at], color=colour, linewidth=1.1, alpha=0.55)
        if best['rms'] is not None:
            axis.plot(
                max(best['rms'], LEAST),
                at,
                'o',
                color=colour,
                markersize=4.5,
                markerfacecolor='white',
            )
        if one['rms'] is not None:
            axis.plot(max(one['rms'], LEAST), at, 'o', color=colour, markersize=4.5)
        axis.text(
            1.0,
            at,
            _delay(one, row['group'] in here),
            color='#777777',
            fontsize=7.5,
            transform=axis.get_yaxis_transform(),
            ha='right',
            va='center',
        )
    low = min(each for each in shown if each > LEAST) if len(shown) > 1 else LEAST
    high = max(shown)
    low = (
        LEAST if min(shown[1:], default=LEAST) <= 3.0 * LEAST else 10.0 ** (math.log10(low) - 0.25)
    )
    # space for the delays at the right
    axis.set_xlim(0.6 * low, 10.0 ** (math.log10(high) + 0.3 * math.log10(high / low) + 0.15))
    axis.text(
        1.0,
        -0.95,
        'ms',
        transform=axis.get_yaxis_transform(),
        fontsize=7.5,
        color='#777777',
        ha='right',
        va='center',
    )
    if column['noise'] > 0.0:
        axis.axvspan(0.6 * low, max(column['noise'], 0.6 * low), color='#e8e3d3', zorder=-1)
    _ticks(axis, high / low)
    axis.grid(axis='x', color='#e4e4e4', linewidth=0.6)
    axis.set_axisbelow(True)
    axis.tick_params(axis='x', labelsize=8)
    axis.tick_params(axis='y', length=0)
    for side in ('top', 'right', 'left'):
        axis.spines[side].set_visible(False)
    head, _, joint = name.partition('/')
    head = textwrap.fill(head.replace('_', ' '), 20).replace(' ', '_')
    heading = f'{head}\n{joint}' if joint else f'{head}\n' + textwrap.fill(column['summary'], 24)
    axis.set_title(heading, fontsize=9)


def _ticks(axis: Any, span: float) -> None:
    """Set ticks at powers of ten; for a narrow span at 1, 2 and 5 in plain numbers."""
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

    if span < NARROW:
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.xaxis.set_major_formatter(FormatStrFormatter('%g'))
    axis.xaxis.set_minor_formatter(NullFormatter())


def _delay(cell: dict[str, Any], others: bool) -> str:
    if cell['rms'] is None:
        return 'no estimate' if others else ''
    text = ''
    if cell['delay_s'] is not None and math.isfinite(cell['delay_s']):
        text = milliseconds(cell['delay_s'])
    if cell['published'] < WHOLE:
        text = f'({cell["published"]:.0%})  {text}'
    return text
