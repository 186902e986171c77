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
from typing import Any

from benchmarks import field, moteus
from benchmarks.columns import FLOOR, Column, shared
from benchmarks.ours import OURS, PEERS, PRACTICE
from benchmarks.recordings import recorded
from estimator_pkg.evaluation.text import fixed, markdown, table

MAIN = 'edge_adaptive'
MOVES = 0.05  # mean square of a recording's speed, at least [(rad/s)^2]
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


def describe(found: Mapping[str, dict[str, Any]], as_markdown: bool = False) -> str:
    """Return the table as text: geometric means of `ratios`, and every column lost to a law."""
    lines = []
    first = next(iter(found.values()))
    for row in first['rows']:
        if row['name'] == MAIN:
            continue
        cells, lost = [], []
        for each in found.values():
            if row['name'] not in {other['name'] for other in each['rows']}:
                cells.append('-')
                continue
            beside = ratios(each, row['name'])
            finite = [value for value in beside.values() if math.isfinite(value)]
            mean = math.exp(sum(map(math.log, finite)) / len(finite)) if finite else math.inf
            cells.append(fixed(mean, 2) if finite else '-')
            lost += [f'{name} {fixed(value, 2)}' for name, value in beside.items() if value < 1.0]
        lines.append((row['name'], *cells, ', '.join(lost) or 'none'))
    header = ('law', *(SETS.get(name, name) for name in found), f'{MAIN} loses to it on')
    return (
        f"velocity rms over {MAIN}'s: geometric mean over the columns of a set, each law at its "
        f'one setting for the set\n\n{(markdown if as_markdown else table)(header, lines)}'
    )
