# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part field``: every causal law next to `MAIN`, on signals, recordings and Hall captures.

Each law has one setting for a set of columns: the grid point with the smallest geometric mean, over
the columns, of error over best error. Errors are of the published samples at zero shift.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import recorded
from benchmarks.captures import captures
from benchmarks.columns import Column, shared
from benchmarks.laws import PEERS, Law, ours, peers
from benchmarks.practice import practice
from benchmarks.rivals import rivals
from estimator_pkg.evaluation.text import fixed, markdown, table
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

MAIN = 'edge_adaptive'
FAILED = 1e3  # ratio that a missing error counts as, when one setting is chosen
MOVES = 0.05  # mean square of a recording's speed, at least [(rad/s)^2]
SIGNALS, RECORDINGS, CAPTURES = 'signals', 'recordings', 'Hall captures'


def columns(bags: Path) -> dict[str, list[Column]]:
    """Return the columns by set; of the recordings those of joints that move; raise UserError."""
    return {
        SIGNALS: shared(),
        RECORDINGS: [each for each in recorded.columns(bags) if _moves(each)],
        CAPTURES: captures(bags),
    }


def _moves(column: Column) -> bool:
    velocity = column.samples.velocity[column.counted]
    return float((velocity * velocity).mean()) > MOVES


def laws() -> tuple[list[Law], list[str]]:
    """Return (every law, names of libraries that are not installed)."""
    used, lacking = practice()
    others, missing = peers()
    return [*ours(), *used, *rivals(), *others], [*lacking, *missing]


def run(sets: Mapping[str, Sequence[Column]], every: Sequence[Law]) -> list[dict[str, Any]]:
    """Return one row per law; peers and rivals, which step in Python, are not run at 30 kHz.

    Returns
    -------
    law; settings : by set; errors : by set and column [rad/s], inf without an estimate.
    """
    rows = []
    chosen = {
        law.name: [name for name in sets if law.group != PEERS or name != CAPTURES] for law in every
    }
    total = sum(len(law.values) * len(chosen[law.name]) for law in every)
    with progress('the field', total) as advance:
        for law in every:
            row: dict[str, Any] = {'law': law.name, 'gain': law.gain, 'settings': {}, 'errors': {}}
            for name in chosen[law.name]:
                errors = swept(law, sets[name], advance)
                at = choose(errors, np.array([column.floor for column in sets[name]]))
                row['settings'][name] = law.values[at]
                row['errors'][name] = {
                    column.name: float(error) for column, error in zip(sets[name], errors[at])
                }
            rows.append(row)
    return rows


def swept(law: Law, columns: Sequence[Column], advance: Callable[[int], Any]) -> Array:
    """Return the rms errors, shape (settings, columns) [rad/s]."""
    found = []
    for value in law.values:
        with np.errstate(all='ignore'):  # a gain that diverges has no error
            found.append([each.error(law.run(each, value))[0] for each in columns])
        advance(1)
    return np.array(found)


def choose(errors: Array, floors: Array) -> int:
    """Return the index of the setting with the least geometric mean of error over best error.

    Parameters
    ----------
    errors : shape (settings, columns); inf without an estimate.
    floors : shape (columns,); errors below these count as zero.
    """
    judged = np.isfinite(np.min(errors, axis=0))
    over = (errors[:, judged] + floors[judged]) / (
        np.min(errors[:, judged], axis=0) + floors[judged]
    )
    over = np.where(np.isfinite(over), over, FAILED)
    return int(np.argmin(np.mean(np.log(over), axis=1))) if judged.any() else 0


def compared(
    rows: Sequence[dict[str, Any]], sets: Mapping[str, Sequence[Column]]
) -> list[dict[str, Any]]:
    """Return every law but `MAIN`, with its errors over those of `MAIN`.

    Errors below a column's floor do not distinguish laws, so it is added to both.

    Returns
    -------
    law; means : geometric mean of the ratios by set, nan where it was not run; lost : column ->
    ratio below 1, the columns on which `MAIN` loses to it.
    """
    (main,) = (row['errors'] for row in rows if row['law'] == MAIN)
    found = []
    for row in rows:
        if row['law'] == MAIN:
            continue
        means: dict[str, float] = {}
        lost: dict[str, float] = {}
        for name, made in sets.items():
            theirs = row['errors'].get(name, {})
            ratios = {
                each.name: (theirs[each.name] + each.floor) / (main[name][each.name] + each.floor)
                for each in made
                if math.isfinite(theirs.get(each.name, math.inf))
            }
            logs = [math.log(ratio) for ratio in ratios.values()]
            means[name] = math.exp(sum(logs) / len(logs)) if logs else math.nan
            lost |= {column: ratio for column, ratio in ratios.items() if ratio < 1.0}
        found.append({'law': row['law'], 'means': means, 'lost': lost})
    return found


def describe(rows: Sequence[dict[str, Any]], as_markdown: bool = False) -> str:
    """Return the table of `compared` as text."""
    lines = [
        (
            row['law'],
            *('-' if math.isnan(mean) else fixed(mean, 2) for mean in row['means'].values()),
            ', '.join(f'{name} {fixed(value, 2)}' for name, value in row['lost'].items()) or 'none',
        )
        for row in rows
    ]
    header = ('law', *rows[0]['means'], f'{MAIN} loses to it on')
    return (
        f"velocity rms over {MAIN}'s: geometric mean over the columns of a set, each law at its "
        f'one setting for the set\n\n{(markdown if as_markdown else table)(header, lines)}'
    )
