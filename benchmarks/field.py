# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part field``: every causal law next to `MAIN`, on signals, recordings and Hall captures.

Each law has one setting for a set of columns: the grid point with the smallest geometric mean, over
the columns, of error over best error. Errors are of the published samples at zero shift.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import recorded
from benchmarks.captures import captures
from benchmarks.columns import Column, shared
from benchmarks.laws import ours, peers
from benchmarks.runner import Blocks, Part, Table, chosen
from estimator_pkg.evaluation.text import fixed

MAIN = 'edge_adaptive'
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


def part(bags: Path) -> Part:
    """Return the comparison of all laws; raise UserError without recordings."""
    sets = columns(bags)
    others, missing = peers()
    rows = compared(chosen([*ours(), *others], sets), sets)
    lacking = f'not run, not installed: {", ".join(missing)}' if missing else ''
    return rows, [*describe(rows), lacking]


def compared(
    found: Mapping[str, Mapping[str, tuple[Any, NDArray[np.float64]]]],
    sets: Mapping[str, Sequence[Column]],
) -> list[dict[str, Any]]:
    """Return every law but `MAIN`, with its errors over those of `MAIN`.

    Errors below a column's floor do not distinguish laws, so it is added to both.

    Parameters
    ----------
    found : of `runner.chosen`.

    Returns
    -------
    law; settings by set; means : geometric mean of the ratios by set, nan where it was not run;
    lost : column -> ratio below 1, the columns on which `MAIN` loses to it.
    """
    rows = []
    for law, by_set in found.items():
        if law == MAIN:
            continue
        means: dict[str, float] = {}
        lost: dict[str, float] = {}
        for name, made in sets.items():
            theirs = by_set[name][1] if name in by_set else np.full(len(made), math.inf)
            ratios = {
                each.name: float((error + each.floor) / (main + each.floor))
                for each, error, main in zip(made, theirs, found[MAIN][name][1])
                if math.isfinite(error)
            }
            logs = np.log(list(ratios.values()))
            means[name] = float(np.exp(np.mean(logs))) if len(logs) else math.nan
            lost |= {column: ratio for column, ratio in ratios.items() if ratio < 1.0}
        settings = {name: setting for name, (setting, _) in by_set.items()}
        rows.append({'law': law, 'settings': settings, 'means': means, 'lost': lost})
    return rows


def describe(rows: Sequence[dict[str, Any]]) -> Blocks:
    """Return the table of `compared`."""
    lines = [
        (
            row['law'],
            *(fixed(mean, 2) for mean in row['means'].values()),
            ', '.join(f'{name} {fixed(value, 2)}' for name, value in row['lost'].items()) or 'none',
        )
        for row in rows
    ]
    header = ('law', *rows[0]['means'], f'{MAIN} loses to it on')
    text = (
        f"velocity rms over {MAIN}'s: geometric mean over the columns of a set, each law at its "
        'one setting for the set'
    )
    return text, Table(header, lines)
