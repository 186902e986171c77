# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``bench accuracy``: our observers and the peers, each at one setting and at its best per column.

Every estimator has one gain that is swept over a grid. "Best" is the lowest error of each column.
"One setting" is the grid point with the smallest geometric mean, over the columns, of error over
best error. Errors are of the published samples at zero shift; the delay is a separate number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.columns import Column
from benchmarks.ours import (
    AHEAD,
    INFORMED,
    NOT_HERE,
    OURS,
    PEERS,
    PRACTICE,
    Estimator,
    ours,
    with_input,
)
from benchmarks.peers import peers
from benchmarks.practice import practice
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.text import fixed, markdown, number, table
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

LEAST = 0.25  # an estimator that publishes less of a column has no error there
WHOLE = 0.95  # below this published fraction the table shows it
FAILED = 1e3  # ratio that a missing error counts as, when one setting is chosen
TELLS = 1.1  # errors above this multiple of the reference's own error can be measured
GROUPS = {
    OURS: 'use the readings only',
    PRACTICE: 'what practitioners use, from its papers; causal',
    PEERS: 'installed libraries, causal',
    INFORMED: 'know the torque as well',
    AHEAD: 'non-causal: use future samples too',
}


def everyone() -> tuple[list[Estimator], list[str]]:
    """Return (all rows in the order of the groups, names of libraries that are not installed)."""
    used, lacking = practice()
    others, missing = peers()
    missing = [*lacking, *missing]
    every = [*ours(), *with_input(), *used, *others]
    return [each for group in GROUPS for each in every if each.group == group], missing


def run(
    columns: Sequence[Column],
    estimators: Sequence[Estimator] | None = None,
    label: str = 'the field',
) -> dict[str, Any]:
    """Return the table as data: one row per estimator.

    Returns
    -------
    columns : name -> summary, reference, noise of the reference. rows : per estimator the one
    setting for all columns; `one` and `best` by column, each with rms, delay_s, published, setting,
    cannot_tell; rms is None without an estimate.
    """
    missing: list[str] = []
    if estimators is None:
        estimators, missing = everyone()
    rows = []
    with progress(label, sum(len(each.values) for each in estimators)) as advance:
        for each in estimators:
            rows.append(_row(each, columns, advance))
    return {
        'columns': {
            column.name: {
                'summary': column.summary,
                'reference': column.reference,
                'noise': column.noise,
            }
            for column in columns
        },
        'rows': rows,
        'not_installed': missing,
        'not_here': NOT_HERE,
    }


def _row(estimator: Estimator, columns: Sequence[Column], advance: Any) -> dict[str, Any]:
    found: list[list[Array]] = []
    for value in estimator.values:
        found.append([_estimate(estimator, column, value) for column in columns])
        advance(1)
    errors = np.array(
        [[error(velocity, column)[0] for velocity, column in zip(each, columns)] for each in found]
    )
    one = choose(errors, np.array([column.floor for column in columns]))

    def cell(j: int, at: int) -> dict[str, Any]:
        return {**_cell(found[at][j], columns[j]), 'setting': estimator.values[at]}

    best = np.argmin(errors, axis=0).tolist()
    return {
        'name': estimator.name,
        'group': estimator.group,
        'knows': estimator.knows,
        'gain': estimator.gain,
        'setting': estimator.values[one],
        'one': {column.name: cell(j, one) for j, column in enumerate(columns)},
        'best': {column.name: cell(j, best[j]) for j, column in enumerate(columns)},
    }


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


def _estimate(estimator: Estimator, column: Column, value: Any) -> Array:
    with np.errstate(all='ignore'):  # a gain that diverges has no error
        return estimator.run(column, value)


def error(velocity: Array, column: Column) -> tuple[float, float]:
    """Return (rms error, published fraction); the error is inf if too few or diverged."""
    counted = column.counted
    error = (velocity - column.samples.velocity)[counted]
    error = error[~np.isnan(error)]
    share = float(len(error) / max(1, int(np.count_nonzero(counted))))
    if share < LEAST or not np.all(np.abs(error) < 1e100):
        return math.inf, share
    return float(np.sqrt(np.mean(error * error))), share


def _cell(velocity: Array, column: Column) -> dict[str, Any]:
    rms, share = error(velocity, column)
    if not math.isfinite(rms):
        return {'rms': None, 'delay_s': None, 'published': share, 'cannot_tell': False}
    rows = np.flatnonzero(column.counted & np.isfinite(velocity))
    rows = rows[np.concatenate([[True], np.diff(column.time[rows]) > 0.0])]
    found = metrics.velocity(
        column.time[rows], velocity[rows], column.samples.velocity[rows], column.noise
    )
    return {
        'rms': rms,
        'delay_s': found['delay_s'],
        'published': share,
        'cannot_tell': column.noise > 0.0 and rms <= TELLS * column.noise,
    }


def describe(found: dict[str, Any], title: str, as_markdown: bool = False) -> str:
    """Return two tables as text: at one setting, and at the best of each column."""
    names = list(found['columns'])
    parts = [f'{title}: velocity rms error [rad/s], delay [ms]']
    for which, heading in (
        ('one', 'one setting per estimator for all columns'),
        ('best', 'best setting of each estimator per column'),
    ):
        lines = []
        for group, meaning in GROUPS.items():
            mine = [row for row in found['rows'] if row['group'] == group]
            if mine:
                lines.append((f'{group}: {meaning}', '', *('' for _ in names)))
            lines += [
                (
                    row['name'],
                    _setting(row) if which == 'one' else '',
                    *(_text(row[which][name]) for name in names),
                )
                for row in mine
            ]
        header = ('estimator', 'setting' if which == 'one' else '', *names)
        parts.append(f'{heading}\n\n' + (markdown if as_markdown else table)(header, lines))
    return '\n\n'.join([*parts, _legend(found)])


def _setting(row: dict[str, Any]) -> str:
    value = row['setting']
    return '' if value is None else f'{row["gain"]} {number(float(value), 3)}'


def _text(cell: dict[str, Any]) -> str:
    if cell['rms'] is None:
        return '-'
    text = number(cell['rms'], 3)
    if cell['delay_s'] is not None and math.isfinite(cell['delay_s']):
        text += f', {milliseconds(cell["delay_s"])}'
    if cell['published'] < WHOLE:
        text += f' ({cell["published"]:.0%})'
    return text + (' *' if cell['cannot_tell'] else '')


def milliseconds(seconds: float) -> str:
    """Return a delay with one decimal [ms]; never -0.0."""
    return fixed(1e3 * seconds if abs(seconds) >= 5e-5 else 0.0, 1)


def _legend(found: dict[str, Any]) -> str:
    lines = [
        f'{name}: {column["summary"]}'
        + (
            f'; {column["reference"]}, {number(column["noise"], 2)} rad/s'
            if column['noise']
            else ''
        )
        for name, column in found['columns'].items()
    ]
    if any(cell['cannot_tell'] for row in found['rows'] for cell in row['one'].values()):
        lines.append("*: below the reference's own error")
    lines.append('(n %): published and evaluated fraction of the column; -: less than a quarter')
    lines += [f'{row["name"]} knows: {row["knows"]}' for row in found['rows'] if row['knows']]
    lines += [f'no row: {name}: {why}' for name, why in found['not_here'].items()]
    lines += [f'not evaluated: {name}: {why}' for name, why in found.get('refused', {}).items()]
    if found['not_installed']:
        lines.append('not run, not installed: ' + ', '.join(found['not_installed']))
    return '\n'.join(lines)
