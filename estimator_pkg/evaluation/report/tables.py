# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The tables of a report page: one per bag, and one over all bags."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator_pkg import registry
from estimator_pkg.evaluation.compare.comparison import Comparison, Row
from estimator_pkg.evaluation.compare.description import describe_smoother, describe_truth
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.text import error, filled, fixed, interval, number
from estimator_pkg.parameters import declared
from estimator_pkg.params_file import split
from estimator_pkg.printable import escaped

TABLE_HEADER = (
    'estimate',
    'rms',
    'mean',
    'worst',
    'worst at',
    'bias',
    'delay',
    'noise',
    'in 95 % interval',
    'valid',
    'samples',
    'dropped',
)
SHOWN_GAINS = 3  # gains in a cell
TABLE_UNITS = ('', 'rad/s', 'rad/s', 'rad/s', 's', 'rad/s', 'ms', 'rad/s', '', 's', '', '')


class Overview:
    """The table of rms errors of many bags at the start of a page."""

    def __init__(self) -> None:
        self._bags = 0
        self._sources: dict[str, None] = {}  # in the order of their appearance
        self._lines: list[tuple[str, str, dict[str, str]]] = []  # bag, joint, cells by source

    def add(self, comparison: Comparison) -> str:
        """Add a bag; return the anchor on the page to which its line links."""
        self._bags += 1
        place = f'bag_{self._bags}'
        best = _best(comparison)
        bag = f'<a href="#{place}">{escaped(Path(comparison.bag).name)}</a>'
        for joint in dict.fromkeys(row.joint for row in comparison.rows):
            cells = {}
            for row in comparison.rows:
                if row.joint == joint:
                    text = error(row.velocity['rms'], 4) + '*' * row.reference_cannot_tell
                    cells[row.source] = f'<b>{text}</b>' if best.get(joint) is row else text
            self._sources.update(dict.fromkeys(cells))
            self._lines.append((bag, escaped(joint), cells))
        return place

    def html(self) -> str:
        """Return the table as HTML; empty for a single bag."""
        if self._bags < 2:
            return ''
        head = ''.join(f'<th>{escaped(each)}</th>' for each in ('bag', 'joint', *self._sources))
        lines = ''.join(
            f'<tr><td>{bag}</td><td>{joint}</td>'
            + ''.join(f'<td>{cells.get(source, "-")}</td>' for source in self._sources)
            + '</tr>'
            for bag, joint, cells in self._lines
        )
        return (
            "<p>Rms velocity error [rad/s] at zero shift; *: below the reference's own error.</p>"
            f'<div class="scroll"><table><tr>{head}</tr>{lines}</table></div>'
        )


def worth(comparison: Comparison) -> str:
    """Return the quality of the truth or the off-line reference as HTML."""
    descriptions = [
        f'{joint}: {describe_smoother(comparison.smoothed[joint], known.noise)}'
        if joint in comparison.smoothed
        else f'The truth of {joint}, compared with the measured position: {describe_truth(known)}'
        for joint, known in comparison.references.items()
        if any(row.joint == joint for row in comparison.rows)
    ]
    return ''.join(f'<p class="note">{escaped(each)}.</p>' for each in descriptions)


def table(
    comparison: Comparison,
    rows: Sequence[Row],
    chosen: Mapping[str, Row],
    entries: Mapping[str, Entry],
) -> str:
    """Return the estimates of one bag as HTML, those of the verdict in bold.

    Parameters
    ----------
    rows : in the order of the table. chosen : by joint. entries : by source, with their gains.
    """
    several = len({row.joint for row in rows}) > 1
    titles = [
        f'{name}{f"<br><small>{unit}</small>" if unit else ""}'
        for name, unit in zip(TABLE_HEADER[1:], TABLE_UNITS[1:])
    ]
    kept, cells = filled(titles, [_cells(row) for row in rows])
    head = ''.join(f'<th>{each}</th>' for each in (TABLE_HEADER[0], *kept))
    lines = ''
    for row, own in zip(rows, cells):
        small = [row.joint, gains(row, entries)][not several :]
        name = escaped(row.source) + ''.join(f'<small>{escaped(each)}</small>' for each in small)
        made = f'<td class="text">{name}</td>'
        made += ''.join(f'<td>{escaped(cell)}</td>' for cell in own)
        lines += (
            f'<tr class="best">{made}</tr>' if chosen.get(row.joint) is row else f'<tr>{made}</tr>'
        )
    notes = ['Bold: the estimate that the verdict names. Best first.']
    if any(row.reference_cannot_tell for row in comparison.rows):
        notes.append("* The error is below the reference's own error.")
    return (
        f'<div class="scroll"><table><tr>{head}</tr>{lines}</table></div>'
        f'<p class="note">{" ".join(notes)}</p>'
    )


def gains(row: Row, entries: Mapping[str, Entry]) -> str:
    """Return the gains of an estimate: those that were set, else the main one; '' if unknown."""
    entry = entries.get(row.source)
    name = row.source if entry is None else entry.observer
    if name not in registry.names(registry.OBSERVERS):
        return ''
    values = changed(entry, row.joint)
    if values:
        shown = [f'{name} {text}' for name, text in list(values.items())[:SHOWN_GAINS]]
        return ', '.join(shown + ['...'] * (len(values) > SHOWN_GAINS))
    known = declared(registry.find(registry.OBSERVERS, name).gains)
    main = next((each for each in ('bandwidth_hz', 'prefer') if each in known), '')
    if not main:
        return 'defaults'
    default = known[main].default
    return f'{main} {"automatic" if default is None else _gain(default)} (default)'


def changed(entry: Entry | None, joint: str) -> dict[str, str]:
    """Return the gains of a joint that are not at their defaults, as text."""
    if entry is None:
        return {}
    known = declared(registry.find(registry.OBSERVERS, entry.observer).gains)
    common, overrides = split(dict(entry.values))
    values = {**common, **overrides.get(joint, {})}
    return {
        name: _gain(value)
        for name, value in values.items()
        if name in known and value != known[name].default
    }


def _gain(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)


def _best(comparison: Comparison) -> dict[str, Row]:
    """Return the best row by joint; none where the reference cannot rank them."""
    found = {}
    for joint in {row.joint for row in comparison.rows} - set(comparison.refused):
        rows = [row for row in comparison.rows if row.joint == joint]
        verdict = comparison.verdicts.get(joint)
        best = min(rows, key=lambda row: row.velocity['rms'])
        if verdict is not None:
            best = next((row for row in rows if row.source == verdict.best), best)
        if not best.reference_cannot_tell:
            found[joint] = best
    return found


def _cells(row: Row) -> tuple[str, ...]:
    """Return the numbers of an estimate, by `TABLE_HEADER` without its name."""
    v = row.velocity
    difference = np.abs(row.estimate - row.truth)
    worst = (
        float(row.time[int(np.nanargmax(difference))])
        if np.isfinite(difference).any()
        else math.nan
    )
    dropped = ', '.join(f'{kind} {count}' for kind, count in row.samples['dropped'].items())
    total = sum(row.validity.values())
    valid = (
        row.validity.get('tracking', 0.0)
        + row.validity.get('coasting', 0.0)
        + (row.validity.get('published', 0.0))
    )
    places = 2 if total < 1000.0 else 0
    return (
        error(v['rms'], 4) + ('*' if row.reference_cannot_tell else ''),
        error(v['mean_abs'], 4),
        error(v['max_abs'], 3),
        fixed(worst, 2),
        fixed(v['bias'], 4),
        interval(v['delay_s'] * 1e3, v['delay_95_s'] * 1e3),
        number(v['noise'], 3),
        f'{row.coverage:.0%}' if row.coverage == row.coverage else '-',
        f'{valid:.{places}f} of {total:.{places}f}' if total else '-',
        f'{row.samples["used"]} of {row.samples["received"]}',
        dropped or '0',
    )
