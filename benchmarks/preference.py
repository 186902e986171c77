# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`prefer` of edge_adaptive: noise against delay, on motions, recordings and captures.

    python -m benchmarks accuracy --part prefer

Noise of a motion: it is run with its counter at many angles, and the noise is the spread of the
estimates of one instant. A recording cannot be run again: there it is the rms second difference of
the estimate, which white noise dominates, and motion hardly enters.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import moteus
from benchmarks.columns import Column
from benchmarks.recordings import recorded
from benchmarks.signals import FURTHER, SIGNALS, SKIPPED, START_NS, Signal, encoder
from estimator_pkg.estimate import VALID
from estimator_pkg.evaluation.compare.delay import delay
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.text import fixed, markdown, number, table
from estimator_pkg.progress import progress
from estimator_pkg.sensor.guard import DUPLICATE

Array = NDArray[np.float64]

OBSERVER = 'edge_adaptive'
PREFER = ('smooth', 'balanced', 'fast')
MOTIONS = ('sine', 'trapezoid', 'steps', 'reversal', 'noise', '100 Hz', '10 kHz')
DRAWS, DURATION = 24, 4.0


class Result(NamedTuple):
    """Noise, delay [s], rms error [rad/s]; the noise in rad/s, or see the module."""

    noise: float
    delay_s: float
    rms: float


def run(folder: Path, *, fast: bool | None = None) -> list[dict[str, Any]]:
    """Return one row per stream: 'stream', 'kind' and a `Result` per preference."""
    signals = [each for each in SIGNALS + FURTHER if each.name in MOTIONS]
    columns = [
        *(each for each in recorded(folder)[0] if not each.name.startswith('at_rest')),
        *moteus.columns(folder / moteus.FOLDER),
    ]
    rows = []
    with progress('preferences', len(signals) + len(columns)) as advance:
        for signal in signals:
            rows.append(simulated(signal, fast=fast))
            advance(1)
        for column in columns:
            rows.append(real(column, fast=fast))
            advance(1)
    return rows


def simulated(
    signal: Signal, draws: int = DRAWS, duration: float = DURATION, *, fast: bool | None = None
) -> dict[str, Any]:
    """Return the row of a motion, run with its counter at `draws` angles."""
    stamps = np.rint((np.arange(round(duration * signal.rate)) + 1.0) * (1e9 / signal.rate))
    time: Array = stamps * 1e-9
    position, velocity = signal.motion(time)
    counted = time >= SKIPPED
    results = {}
    for prefer in PREFER:
        joint = _entry(prefer).joint(quantum=signal.quantum)
        found = []
        for number_ in range(draws):
            random = np.random.default_rng(number_)
            start = random.uniform(0.0, 2.0 * np.pi)
            angle = position + start + random.normal(0.0, signal.noise, len(position))
            joint.reset()
            out = joint.run(
                stamps.astype(np.int64) + START_NS, encoder(angle, signal.counts), fast=fast
            )
            found.append(out.velocity[counted])
        every, truth = np.array(found), velocity[counted]
        results[prefer] = Result(
            float(np.sqrt(np.mean(np.var(every, axis=0, ddof=1)))),
            delay(time[counted], np.mean(every, axis=0), truth),
            float(np.sqrt(np.mean((every - truth) ** 2))),
        )
    return {'stream': signal.name, 'kind': 'motion', 'results': results}


def real(column: Column, *, fast: bool | None = None) -> dict[str, Any]:
    """Return the row of a recording or capture."""
    results = {}
    for prefer in PREFER:
        joint = _entry(prefer).joint(wrap_period=column.period)
        out = joint.run(column.samples.stamps, column.samples.angle, fast=fast)
        rows = column.counted & (out.verdict < DUPLICATE) & np.isin(out.status, VALID)
        velocity, truth = out.velocity[rows], column.samples.velocity[rows]
        results[prefer] = Result(
            float(np.sqrt(np.mean(np.diff(velocity, 2) ** 2))),
            delay(column.time[rows], velocity, truth),
            float(np.sqrt(np.mean((velocity - truth) ** 2))),
        )
    return {'stream': column.name, 'kind': 'recording', 'results': results}


def _entry(prefer: str) -> Entry:
    return Entry(prefer, OBSERVER, (('prefer', prefer),))


def describe(rows: list[dict[str, Any]], as_markdown: bool = False) -> str:
    """Return the table: noise and delay of `balanced`, those of the others over these."""
    lines = []
    for row in rows:
        smooth, balanced, fast = (row['results'][each] for each in PREFER)
        lines.append(
            (
                row['stream'],
                number(balanced.noise, 3),
                *(fixed(each.noise / balanced.noise, 2) for each in (smooth, fast)),
                *(fixed(1e3 * each.delay_s, 2) for each in (smooth, balanced, fast)),
                *(number(each.rms, 3) for each in (smooth, balanced, fast)),
            )
        )
    header = ('stream', 'noise, balanced', '/ smooth', '/ fast')
    columns = [f'{what}, {each}' for what in ('delay [ms]', 'rms [rad/s]') for each in PREFER]
    draw = markdown if as_markdown else table
    return (
        f'{OBSERVER} by `prefer`: noise of balanced, and that of smooth and fast over it; delay; '
        'rms error\n\n' + draw((*header, *columns), lines)
    )
