# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Every causal law beside `MAIN`: on the shared signals, the recordings and the Hall captures.

    python -m benchmarks accuracy --part rivals

Each law has one setting for a set of columns, the one that `benchmarks.field` chooses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks import field, moteus
from benchmarks.columns import FLOOR, Column, shared
from benchmarks.ours import OURS, PEERS, PRACTICE
from benchmarks.recordings import recorded
from estimator_pkg.evaluation.report.plot import check
from estimator_pkg.evaluation.text import fixed, markdown, table

MAIN = 'edge_adaptive'
MOVES = 0.05  # mean square of a recording's speed, at least [(rad/s)^2]
WORST = 16.0  # the chart ends here; the raw difference of Hall counts lies beyond
MARKERS = ('o', 's', '^')
SETS = {'shared': 'signals', 'recordings': 'recordings', 'captures': 'Hall captures'}


def columns(bags: Path) -> dict[str, list[Column]]:
    """Return the columns by set; of the recordings those of joints that move.

    Raises
    ------
    UserError : the bags are missing.
    """
    kept, _ = recorded(bags)
    return {
        'shared': shared(),
        'recordings': [each for each in kept if _moves(each)],
        'captures': moteus.columns(bags / moteus.FOLDER),
    }


def _moves(column: Column) -> bool:
    velocity = column.samples.velocity[column.counted]
    return float((velocity * velocity).mean()) > MOVES


def run(sets: Mapping[str, Sequence[Column]]) -> dict[str, dict[str, Any]]:
    """Return the field of each set; the peers, which step in Python, are left out at 30 kHz."""
    everyone, _ = field.everyone()
    groups = {name: {OURS, PRACTICE} | ({PEERS} if name != 'captures' else set()) for name in sets}
    return {
        name: field.run(
            made, [each for each in everyone if each.group in groups[name]], SETS.get(name, name)
        )
        for name, made in sets.items()
    }


def ratios(found: Mapping[str, Any], law: str) -> dict[str, float]:
    """Return a law's error over that of `MAIN`, by column; inf without an estimate.

    Errors below a column's floor do not tell laws apart: it is added to both.
    """
    rows = {row['name']: row['one'] for row in found['rows']}
    made = {}
    for name, column in found['columns'].items():
        floor = max(FLOOR, column['noise'])
        ours, theirs = rows[MAIN][name]['rms'], rows[law][name]['rms']
        made[name] = math.inf if theirs is None else (theirs + floor) / (ours + floor)
    return made


class Rival(NamedTuple):
    """A law beside `MAIN`.

    means : geometric mean of its `ratios` by set; nan where it was not run.
    lost : column -> ratio below 1: the columns on which `MAIN` loses to it.
    """

    law: str
    means: dict[str, float]
    lost: dict[str, float]


def rivals(found: Mapping[str, dict[str, Any]]) -> list[Rival]:
    """Return every law of the first set but `MAIN`."""
    made = []
    for law in (row['name'] for row in next(iter(found.values()))['rows']):
        if law == MAIN:
            continue
        means, lost = {}, {}
        for name, each in found.items():
            known = law in {row['name'] for row in each['rows']}
            beside = ratios(each, law) if known else {}
            finite = [value for value in beside.values() if math.isfinite(value)]
            means[name] = math.exp(sum(map(math.log, finite)) / len(finite)) if finite else math.nan
            lost.update({column: value for column, value in beside.items() if value < 1.0})
        made.append(Rival(law, means, lost))
    return made


def describe(rows: Sequence[Rival], as_markdown: bool = False) -> str:
    """Return the table as text."""
    lines = [
        (
            law,
            *('-' if math.isnan(mean) else fixed(mean, 2) for mean in means.values()),
            ', '.join(f'{column} {fixed(value, 2)}' for column, value in lost.items()) or 'none',
        )
        for law, means, lost in rows
    ]
    header = ('law', *(SETS.get(name, name) for name in rows[0].means), f'{MAIN} loses to it on')
    return (
        f"velocity rms over {MAIN}'s: geometric mean over the columns of a set, each law at its "
        f'one setting for the set\n\n{(markdown if as_markdown else table)(header, lines)}'
    )


def draw(rows: Sequence[Rival], path: str) -> None:
    """Write the chart: a law a line, its mean ratio on each set.

    Raises
    ------
    UserError : matplotlib is missing, or does not support this file type.
    """
    check(path)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 0.9 + 0.27 * len(rows)), layout='constrained')
    axis = figure.subplots()
    places = range(len(rows), 0, -1)
    for name, marker in zip(rows[0].means, MARKERS):
        axis.plot([each.means[name] for each in rows], places, marker, label=SETS.get(name, name))
    axis.axvline(1.0, color='black', linewidth=1.0)
    axis.set_xscale('log')
    axis.set_xlim(0.9, WORST)
    ticks = (1, 1.5, 2, 3, 5, 10)
    axis.set_xticks(ticks, [f'{each:g}' for each in ticks], minor=False)
    axis.set_xticks([], minor=True)
    axis.set_yticks(places, [each.law for each in rows])
    axis.set_xlabel(f"velocity rms over {MAIN}'s (1: the same; right is worse)")
    axis.grid(color='0.9')
    axis.legend(loc='lower right')
    figure.savefig(path, dpi=110)
