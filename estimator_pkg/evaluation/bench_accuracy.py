"""``bench accuracy``: every observer on the shared signals, errors and delay."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from estimator_pkg.driver.guard import DUPLICATE
from estimator_pkg.evaluation import metrics
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.signals import SIGNALS, SKIPPED, Samples, Signal
from estimator_pkg.evaluation.text import fixed, number, table
from estimator_pkg.observers.contract import COASTING, TRACKING
from estimator_pkg.progress import progress


def measure(entry: Entry, samples: Samples) -> dict[str, Any]:
    """Velocity errors, delay and the share of samples that were published, after the first second.

    Returns
    -------
    rms, mean_abs, max_abs, bias [rad/s], delay_s, noise (see `metrics.velocity`), published.
    """
    joint = entry.joint()
    out = joint.run(samples.stamps, samples.angle)
    time = (samples.stamps - samples.stamps[0]) * 1e-9
    counted = time >= SKIPPED
    valid = (counted & (out.verdict < DUPLICATE)
             & ((out.status == TRACKING) | (out.status == COASTING)))
    numbers = metrics.velocity(time[valid], out.velocity[valid], samples.velocity[valid])
    return {**numbers, 'published': float(np.count_nonzero(valid) / np.count_nonzero(counted))}


def run(rows: Iterable[Entry] | None = None, signals: tuple[Signal, ...] = SIGNALS
        ) -> dict[str, Any]:
    """The table as data: one result per entry and signal."""
    chosen = list(at_defaults() if rows is None else rows)
    results = []
    with progress('accuracy', len(chosen) * len(signals)) as advance:
        for signal in signals:
            samples = signal.samples()
            for entry in chosen:
                results.append({'observer': entry.label, 'tuning': entry.tuning,
                                'signal': signal.name, **measure(entry, samples)})
                advance(1)
    return {'signals': {signal.name: signal.summary for signal in signals}, 'results': results}


def describe(found: dict[str, Any]) -> str:
    """The table as text: rms and delay per signal."""
    names = list(found['signals'])
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for result in found['results']:
        text = f'{number(result["rms"], 3)}  {fixed(result["delay_s"] * 1e3, 2)}'
        if result['published'] < 0.999:
            text += f' ({result["published"]:.0%} published)'
        cells.setdefault((result['observer'], result['tuning']), {})[result['signal']] = text
    rows = [(observer, tuning, *(row.get(name, '-') for name in names))
            for (observer, tuning), row in cells.items()]
    legend = '\n'.join(f'  {name}: {summary}' for name, summary in found['signals'].items())
    return ('velocity rms error [rad/s] and delay [ms] at 1 kHz, 4096 counts, wrapped, first '
            f'second skipped\n{legend}\n' + table(('observer', 'gains', *names), rows, left=2))
