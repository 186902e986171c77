# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``bench accuracy``: every observer on the shared signals, errors and delay.

`run` measures each column once. `drawn` draws each column many times, with random phases and
speeds; it reports the pooled error, the largest, and the largest ratio to a baseline on the same
samples.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.signals import FURTHER, SIGNALS, SKIPPED, Samples, Signal
from estimator_pkg import registry
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import COASTING, TRACKING
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.text import fixed, number, table
from estimator_pkg.parameters import declared
from estimator_pkg.progress import progress
from estimator_pkg.sensor.guard import DUPLICATE

Array = NDArray[np.float64]

ALL = SIGNALS + FURTHER
DRAWS = 100
MANY = 10  # draws from which compiling the yardstick, which nothing else runs, pays
# the textbook filter: with noise readings repeat, and our low-speed bound would limit its velocity
YARDSTICK = Entry('kalman acceleration', 'kalman', (('low_speed_bound', False),))
DRAWN = (YARDSTICK, Entry('edge_adaptive', 'edge_adaptive'))
MISSED, SIGMAS = 0.05, 1.96  # of the 95 % interval
SHARE = 1.05  # a draw counts as worse than the baseline above this ratio


def measure(entry: Entry, samples: Samples) -> dict[str, Any]:
    """Return velocity errors, delay and fraction of published samples, after the first second.

    Returns
    -------
    rms, mean_abs, max_abs, bias [rad/s], delay_s, noise (see `metrics.velocity`), published.
    """
    joint = entry.joint()
    out = joint.run(samples.stamps, samples.angle)
    time = (samples.stamps - samples.stamps[0]) * 1e-9
    counted = time >= SKIPPED
    valid = (
        counted & (out.verdict < DUPLICATE) & ((out.status == TRACKING) | (out.status == COASTING))
    )
    numbers = metrics.velocity(time[valid], out.velocity[valid], samples.velocity[valid])
    return {**numbers, 'published': float(np.count_nonzero(valid) / np.count_nonzero(counted))}


def run(rows: Iterable[Entry] | None = None, signals: tuple[Signal, ...] = ALL) -> dict[str, Any]:
    """Return the table as data: one result per entry and signal."""
    chosen = list(at_defaults() if rows is None else rows)
    results = []
    with progress('accuracy', len(chosen) * len(signals)) as advance:
        for signal in signals:
            samples = signal.samples()
            for entry in chosen:
                results.append(
                    {
                        'observer': entry.label,
                        'tuning': entry.tuning,
                        'signal': signal.name,
                        **measure(entry, samples),
                    }
                )
                advance(1)
    return {'signals': {signal.name: signal.summary for signal in signals}, 'results': results}


def describe(found: dict[str, Any]) -> str:
    """Return the table as text: rms and delay per signal."""
    names = list(found['signals'])
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for result in found['results']:
        text = f'{number(result["rms"], 3)}  {fixed(result["delay_s"] * 1e3, 2)}'
        if result['published'] < 0.999:
            text += f' ({result["published"]:.0%} published)'
        cells.setdefault((result['observer'], result['tuning']), {})[result['signal']] = text
    rows = [
        (observer, tuning, *(row.get(name, '-') for name in names))
        for (observer, tuning), row in cells.items()
    ]
    legend = '\n'.join(f'  {name}: {summary}' for name, summary in found['signals'].items())
    body = table(('observer', 'gains', *names), rows, left=2)
    return (
        'velocity rms error [rad/s] and delay [ms] at 1 kHz and 4096 counts unless the column '
        f'states otherwise; wrapped, first second skipped\n{legend}\n{body}'
    )


def drawn(
    entries: Iterable[Entry] = DRAWN,
    signals: tuple[Signal, ...] = ALL,
    draws: int = DRAWS,
    duration: float = 6.0,
    *,
    fast: bool | None = None,
) -> dict[str, Any]:
    """Run each column `draws` times, each with another phase or speed; the quantum is known.

    Returns
    -------
    One row per entry and signal: pooled, median and worst rms [rad/s]; coverage, mean width and
    interval score of the 95 % interval (see `interval_score`); largest ratio to `YARDSTICK` on the
    same samples, and how many exceed `SHARE`.
    """
    chosen = list(entries)
    rows = []
    with progress('drawn', len(chosen) * len(signals)) as advance:
        for signal in signals:
            repeats = [signal.drawn(number, duration) for number in range(draws)]
            yard = None
            for entry in sorted(chosen, key=lambda entry: entry != YARDSTICK):
                joint = entry.joint(**_quantum(entry, signal))
                few = entry == YARDSTICK and draws < MANY
                errors, covered, widths, scores = zip(
                    *(_draw(joint, samples, False if few else fast) for samples in repeats)
                )
                rms = np.array(errors)
                if entry == YARDSTICK:
                    yard = rms
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
                if yard is not None:
                    ratio = rms / np.maximum(yard, 1e-12)
                    row |= {
                        'worst_ratio': float(np.max(ratio)),
                        'worse': int(np.count_nonzero(ratio > SHARE)),
                    }
                rows.append(row)
                advance(1)
    return {'signals': {signal.name: signal.summary for signal in signals}, 'rows': rows}


def _quantum(entry: Entry, signal: Signal) -> dict[str, float]:
    observer = registry.find(registry.OBSERVERS, entry.observer)
    return {'quantum': signal.quantum} if 'quantum' in declared(observer.gains) else {}


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


def _draw(joint: Joint, samples: Samples, fast: bool | None) -> tuple[float, float, float, float]:
    """Return (rms error of the velocity [rad/s], and `interval_score`)."""
    joint.reset()
    out = joint.run(samples.stamps, samples.angle, fast=fast)
    counted = (samples.stamps - samples.stamps[0]) * 1e-9 >= SKIPPED
    error = (out.velocity - samples.velocity)[counted]
    return (
        float(np.sqrt(np.mean(error * error))),
        *interval_score(error, out.velocity_stddev[counted]),
    )


def describe_drawn(found: dict[str, Any]) -> str:
    """Return the table of `drawn` as text."""
    rows = [
        (
            row['observer'],
            row['signal'],
            number(row['pooled'], 3),
            number(row['median'], 3),
            number(row['worst'], 3),
            fixed(100.0 * row['coverage'], 1),
            number(row['width'], 3),
            number(row['score'], 3),
            fixed(row.get('worst_ratio', np.nan), 3),
            str(row.get('worse', '-')),
        )
        for row in found['rows']
    ]
    draws = found['rows'][0]['draws'] if found['rows'] else 0
    return (
        f'{draws} random phases and speeds per column, quantum known: velocity rms error '
        '[rad/s]; coverage [%], mean width and score of the 95 % interval [rad/s]; ratio to '
        f'{YARDSTICK.label} on the same samples\n'
        + table(
            (
                'observer',
                'signal',
                'pooled',
                'median',
                'worst',
                'covered',
                'width',
                'score',
                'worst ratio',
                f'above {SHARE:g}',
            ),
            rows,
            left=2,
        )
    )
