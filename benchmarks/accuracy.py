# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part accuracy``: every observer at its defaults, on the shared signals and the recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import recorded
from benchmarks.columns import START, published
from benchmarks.signals import FURTHER, SIGNALS, SKIPPED, Samples, Signal
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.text import fixed, markdown, number, table
from estimator_pkg.progress import progress

Array = NDArray[np.float64]
Rows = list[dict[str, Any]]

ALL = SIGNALS + FURTHER
SIGMAS = 1.96  # standard deviations of the 95 % interval


def covered(error: Array, sigma: Array) -> float:
    """Return the fraction of errors within the 95 % interval; shape (n,) each [rad/s]."""
    return float(np.mean(np.abs(error) <= SIGMAS * sigma))


def measure(entry: Entry, samples: Samples) -> dict[str, Any]:
    """Return velocity errors, delay and fraction of published samples, after the first second.

    Returns
    -------
    rms, mean_abs, max_abs, bias [rad/s], delay_s, noise (see `metrics.velocity`), coverage of the
    95 % interval, published.
    """
    out = entry.joint().run(samples.stamps, samples.angle)
    time = (samples.stamps - samples.stamps[0]) * 1e-9
    counted = time >= SKIPPED
    valid = counted & published(out)
    found, true = out.velocity[valid], samples.velocity[valid]
    return {
        **metrics.velocity(time[valid], found, true),
        'coverage': covered(found - true, out.velocity_stddev[valid]),
        'published': float(np.count_nonzero(valid) / np.count_nonzero(counted)),
    }


def run(
    bags: Path | None, rows: Iterable[Entry] | None = None, signals: Sequence[Signal] = ALL
) -> Rows:
    """Return one row per stream and observer: those of the signals, then those of the bags."""
    chosen = list(at_defaults() if rows is None else rows)
    results: Rows = []
    with progress('accuracy', len(chosen) * len(signals)) as advance:
        for signal in signals:
            samples = signal.samples()
            for entry in chosen:
                found = measure(entry, samples)
                results.append({'stream': signal.name, 'observer': entry.label, **found})
                advance(1)
    return results + (recorded.rows(bags) if bags is not None else [])


def part(bags: Path) -> tuple[Rows, str]:
    """Return the rows, and why those of the recordings are not among them."""
    try:
        return run(bags), ''
    except UserError as error:
        return run(None), f'recordings: not run: {error}'


def describe(rows: Rows, as_markdown: bool = False) -> str:
    """Return the table: rms error, delay and coverage per stream and observer."""
    observers = list(dict.fromkeys(row['observer'] for row in rows))
    cells: dict[str, dict[str, str]] = {}
    for row in rows:
        text = number(row['rms'], 3) + (' *' if row.get('reference_cannot_tell') else '')
        if math.isfinite(row['delay_s']):
            text += f', {fixed(row["delay_s"] * 1e3, 2)} ms'
        text += f', {100.0 * row["coverage"]:.0f} %'
        if row.get('published', 1.0) < 0.999:
            text += f' ({row["published"]:.0%} published)'
        cells.setdefault(row['stream'], {})[row['observer']] = text
    lines = [(name, *(row.get(each, '-') for each in observers)) for name, row in cells.items()]
    legend = '; '.join(f'{each.name}: {each.summary}' for each in ALL)
    return (
        'velocity rms error [rad/s], delay [ms], coverage of the 95 % interval, at the defaults.\n'
        'Signals: 1 kHz and 4096 counts unless stated otherwise, without the first second: '
        f'{legend}.\nRecordings: without the first {START:g} s, without lag and bias of '
        "the reference; *: below the reference's own error\n\n"
        + (markdown if as_markdown else table)(('stream', *observers), lines)
    )
