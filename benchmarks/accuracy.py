# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part accuracy``: every observer at its defaults, on the shared signals and the recordings.

`run` measures each stream once. `drawn` draws each signal many times, with random phases and
speeds; it reports the pooled error, the largest, and the largest ratio to a baseline on the same
samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import recorded
from benchmarks.columns import published
from benchmarks.signals import FURTHER, SIGNALS, SKIPPED, Samples, Signal
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.text import fixed, markdown, number, table
from estimator_pkg.progress import progress

Array = NDArray[np.float64]
Rows = list[dict[str, Any]]

ALL = SIGNALS + FURTHER
DRAWS = 100
# the textbook filter: with noise readings repeat, and our low-speed bound would limit its velocity
YARDSTICK = Entry('kalman acceleration', 'kalman', (('low_speed_bound', False),))
MAIN = Entry('edge_adaptive', 'edge_adaptive')
MISSED, SIGMAS = 0.05, 1.96  # of the 95 % interval
SHARE = 1.05  # a draw counts as worse than the baseline above this ratio


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
        'coverage': interval_score(found - true, out.velocity_stddev[valid])[0],
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
        f'{legend}.\nRecordings: without the first {recorded.SKIPPED:g} s, without lag and bias of '
        "the reference; *: below the reference's own error\n\n"
        + (markdown if as_markdown else table)(('stream', *observers), lines)
    )


def drawn(
    entries: Iterable[Entry] = (YARDSTICK, MAIN),
    signals: Iterable[Signal] = ALL,
    draws: int = DRAWS,
    duration: float = 6.0,
) -> Rows:
    """Run each signal `draws` times, each with another phase or speed; the quantum is known.

    Returns
    -------
    One row per entry and signal: pooled, median and worst rms [rad/s]; coverage, mean width and
    interval score of the 95 % interval (see `interval_score`); largest ratio to `YARDSTICK` on the
    same samples, and how many exceed `SHARE`.
    """
    chosen, signals = sorted(entries, key=lambda entry: entry != YARDSTICK), tuple(signals)
    rows = []
    with progress('drawn', len(chosen) * len(signals)) as advance:
        for signal in signals:
            repeats = [signal.drawn(number, duration) for number in range(draws)]
            yard: dict[str, Any] = {}
            for entry in chosen:
                joint = entry.joint(quantum=signal.quantum)
                errors, covered, widths, scores = zip(*(_draw(joint, each) for each in repeats))
                rms = np.array(errors)
                if entry == YARDSTICK:
                    yard = {'rms': rms, 'pooled': float(np.sqrt(np.mean(rms * rms)))}
                row = {
                    'observer': entry.label,
                    'signal': signal.name,
                    'draws': draws,
                    'pooled': float(np.sqrt(np.mean(rms * rms))),
                    'median': float(np.median(rms)),
                    'worst': float(np.max(rms)),
                    'coverage': float(np.mean(covered)),
                    'width': float(np.mean(widths)),
                    'score': float(np.mean(scores)),
                }
                if yard:
                    ratio = rms / np.maximum(yard['rms'], 1e-12)
                    row |= {
                        'baseline': yard['pooled'],
                        'worst_ratio': float(np.max(ratio)),
                        'worse': int(np.count_nonzero(ratio > SHARE)),
                    }
                rows.append(row)
                advance(1)
    return rows


def interval_score(error: Array, sigma: Array) -> tuple[float, float, float]:
    """Return (coverage, mean width, interval score) of the 95 % interval [rad/s].

    The score is the width, and 2/0.05 times the distance by which the truth is outside (Gneiting
    and Raftery 2007, eq. 43): it is least for the narrowest interval that covers 95 %.

    Parameters
    ----------
    error, sigma : shape (n,), of the velocity [rad/s].
    """
    half = SIGMAS * sigma
    outside = np.maximum(np.abs(error) - half, 0.0)
    width = 2.0 * float(np.mean(half))
    return (float(np.mean(outside == 0.0)), width, width + 2.0 / MISSED * float(np.mean(outside)))


def _draw(joint: Joint, samples: Samples) -> tuple[float, float, float, float]:
    """Return (rms error of the velocity [rad/s], and `interval_score`)."""
    joint.reset()
    out = joint.run(samples.stamps, samples.angle)
    counted = (samples.stamps - samples.stamps[0]) * 1e-9 >= SKIPPED
    error = (out.velocity - samples.velocity)[counted]
    return (
        float(np.sqrt(np.mean(error * error))),
        *interval_score(error, out.velocity_stddev[counted]),
    )


def describe_drawn(rows: Rows, as_markdown: bool = False) -> str:
    """Return the table of `drawn`, without the rows of the baseline."""
    lines = [
        (
            row['signal'],
            *(number(row[key], 3) for key in ('pooled', 'median', 'worst')),
            f'{100.0 * row["coverage"]:.1f} %',
            number(row['baseline'], 3),
            fixed(row['worst_ratio'], 3),
            f'{row["worse"]} of {row["draws"]}',
        )
        for row in rows
        if row['observer'] != YARDSTICK.label
    ]
    header = ('pooled', 'median', 'worst', 'covered', YARDSTICK.label, 'worst ratio')
    return (
        f'{MAIN.label} at random phases and speeds, quantum known: velocity rms error [rad/s]; '
        f'coverage of the 95 % interval; ratio to {YARDSTICK.label} on the same samples\n\n'
        + (markdown if as_markdown else table)(('signal', *header, f'above {SHARE:g}'), lines)
    )
