# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part accuracy``: every observer at its defaults, on the shared signals and the recordings.

    python -m benchmarks.accuracy bags > test/recordings_bounds.yaml

prints fresh bounds of the recordings. Bounds guard against change: a case fails if it is worse than
its bound or better than half of it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from benchmarks import recorded
from benchmarks.columns import EDGE, START, Column, shared
from benchmarks.runner import Blocks, Part, Table, csv_text, delay_and_coverage, result
from benchmarks.signals import DURATION, FURTHER, SIGNALS
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.reference.reference import NOISE_MULTIPLE
from estimator_pkg.evaluation.text import fixed, number
from estimator_pkg.progress import progress

Rows = list[dict[str, Any]]

ALL = SIGNALS + FURTHER
MARGIN = 1.15  # a new bound over the measured value


def part(bags: Path) -> Part:
    """Return the rows of signals and recordings, or why the latter are not among them."""
    rows, lacking = run(shared(ALL, DURATION), at_defaults()), ''
    try:
        rows += run(recorded.with_truth(bags))
    except UserError as error:
        lacking = f'recordings: not run: {error}'
    return rows, [*describe(rows), lacking]


def run(columns: Sequence[Column], entries: Sequence[Entry] | None = None) -> Rows:
    """Return one row per column and observer; by default all, and the raw difference."""
    rows: Rows = []
    chosen = [*at_defaults(), recorded.RAW] if entries is None else entries
    with progress('accuracy', len(columns) * len(chosen)) as advance:
        for column in columns:
            for entry in chosen:
                found = result(column, entry)
                below = column.noise > 0.0 and found['rms'] <= NOISE_MULTIPLE * column.noise
                names = {'stream': column.name, 'observer': entry.label}
                rows.append({**names, **found, 'reference_cannot_tell': below})
                advance(1)
    return rows


def as_csv(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return the rows as a file of benchmarks/results."""
    return csv_text(
        {
            'stream': row['stream'],
            'observer': row['observer'],
            'rms_rad_s': number(row['rms'], 3),
            **delay_and_coverage(row),
            'below_reference_error': 'yes' if row['reference_cannot_tell'] else '',
        }
        for row in rows
    )


def describe(rows: Rows) -> Blocks:
    """Return the table: rms error, delay and coverage per stream and observer."""
    observers = list(dict.fromkeys(row['observer'] for row in rows))
    cells: dict[str, dict[str, str]] = {}
    for row in rows:
        text = number(row['rms'], 3) + (' *' if row['reference_cannot_tell'] else '')
        if math.isfinite(row['delay_s']):
            text += f', {fixed(row["delay_s"] * 1e3, 2)} ms'
        text += f', {100.0 * row["coverage"]:.0f} %'
        if row['published'] < 0.999:
            text += f' ({row["published"]:.0%} published)'
        cells.setdefault(row['stream'], {})[row['observer']] = text
    lines = [(name, *(row.get(each, '-') for each in observers)) for name, row in cells.items()]
    legend = '; '.join(f'{each.name}: {each.summary}' for each in ALL)
    text = (
        'velocity rms error [rad/s], delay [ms], coverage of the 95 % interval, at the defaults.\n'
        f'All without the last {EDGE:g} s. Signals: 1 kHz and 4096 counts unless stated otherwise, '
        f'without the first second: {legend}.\nRecordings: without the first {START:g} s, without '
        "lag and bias of the reference; *: below the reference's own error"
    )
    return text, Table(('stream', *observers), lines)


def bounds(rows: Rows) -> dict[str, dict[str, list[float]]]:
    """Return new bounds: case -> observer -> [rms, largest error]."""
    fresh: dict[str, dict[str, list[float]]] = {}
    for row in rows:
        fresh.setdefault(row['stream'], {})[row['observer']] = [
            float(f'{MARGIN * row[name]:.3g}') for name in ('rms', 'max_abs')
        ]
    return fresh


def judge(value: float, bound: float) -> str:
    """Return '' if `value` is between half of `bound` and `bound`; else what is wrong."""
    if not value <= bound:
        return f'{value:.4g} is worse than its bound {bound:.4g}'
    if value < 0.5 * bound:
        return f'{value:.4g} is better than half of its bound {bound:.4g}: print new bounds'
    return ''


if __name__ == '__main__':
    found = bounds(run(recorded.with_truth(Path(sys.argv[1]))))
    print(yaml.safe_dump(found, sort_keys=False, default_flow_style=None), end='')
