# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers at their defaults on held-out recordings, compared with textbook baselines.

    python -m benchmarks accuracy --part held --held-out FOLDER

The four baselines are swept over their gain. The single best one is the observer and setting with
the lowest geometric mean rms over the set. The best of four is, series by series, the best of the
four, each at its own common setting: the one with its lowest geometric mean.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import field, held_data
from benchmarks.columns import Column
from benchmarks.ours import Estimator, ours
from estimator_pkg.estimate import COASTING, TRACKING
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.text import fixed, markdown, number, table
from estimator_pkg.progress import progress
from estimator_pkg.sensor.guard import DUPLICATE

Array = NDArray[np.float64]

LISTS = {
    'series': 'held-out recordings',
    'unseen': 'held-out recordings, second list',
    'third': 'held-out recordings, third list',
}
OBSERVERS = ('edge_adaptive', 'hybrid_angle')
BASELINES = ('finite_difference', 'pll', 'kalman velocity', 'kalman acceleration')
SIGMAS = 1.959964  # standard deviations of a 95 % interval
NEAR = 1.15  # of a baseline's error, at most on each series


class Result(NamedTuple):
    """An observer on a series: rms [rad/s], delay [s], covered share of the 95 % interval.

    The reference's own error is part of the interval.
    """

    rms: float
    delay_s: float
    covered: float
    published: float


class Row(NamedTuple):
    """A series.

    noise : error of the reference [rad/s]. results : by observer. single, best : rms of the single
    best baseline and of the best of the four [rad/s]; which : name of the latter. judged : the
    reference is fine enough for the baselines' errors.
    """

    series: str
    reference: str
    noise: float
    results: dict[str, Result]
    single: float
    best: float
    which: str
    judged: bool


class Found(NamedTuple):
    """All series; the single best baseline and the common settings, in words."""

    rows: list[Row]
    single: str
    common: dict[str, str]


def run(folder: Path, which: str = 'series') -> Found:
    """Return the comparison on a list, whose files are below `folder`; raise UserError."""
    chosen = held_data.listed(which)
    judged = {each.name: each.judged for each in chosen}
    return compared(held_data.columns(folder, chosen), judged)


def compared(columns: Sequence[Column], judged: dict[str, float]) -> Found:
    """Return the comparison on these columns; `judged` as in `held_data.Listed`, by name."""
    families = [each for each in ours() if each.name in BASELINES]
    swept: dict[str, Array] = {}
    with progress('baselines', sum(len(each.values) for each in families)) as advance:
        for each in families:
            swept[each.name] = _swept(each, columns, advance)
    best = {name: int(np.argmin(_means(errors))) for name, errors in swept.items()}
    at_best = {name: errors[best[name]] for name, errors in swept.items()}
    single = min(at_best, key=lambda name: float(_means(at_best[name])))
    settings = {
        each.name: f'{each.name}, {each.gain} {number(float(each.values[best[each.name]]), 3)}'
        for each in families
    }
    rows = []
    with progress('observers', len(columns)) as advance:
        for j, column in enumerate(columns):
            which = min(at_best, key=lambda name: at_best[name][j])
            least = float(at_best[which][j])
            rows.append(
                Row(
                    column.name,
                    column.reference,
                    column.noise,
                    {name: result(column, name) for name in OBSERVERS},
                    float(at_best[single][j]),
                    least,
                    which,
                    column.noise <= judged[column.name] * least,
                )
            )
            advance(1)
    return Found(rows, settings[single], settings)


def _swept(family: Estimator, columns: Sequence[Column], advance: Any) -> Array:
    """Return the rms errors, shape (settings, columns)."""
    found = []
    for value in family.values:
        with np.errstate(all='ignore'):  # a gain that diverges has no error
            found.append([field.error(family.run(each, value), each)[0] for each in columns])
        advance(1)
    return np.array(found)


def _means(errors: Array) -> Array:
    """Return the mean logarithm over the columns, the last axis."""
    found: Array = np.mean(np.log(np.maximum(errors, 1e-300)), axis=-1)
    return found


def result(column: Column, observer: str) -> Result:
    """Return an observer at its defaults on a column; it does not know the quantum."""
    samples = column.samples
    joint = Entry(observer, observer).joint(wrap_period=column.period)
    out = joint.run(samples.stamps, samples.angle, fast=True)
    published = (out.verdict < DUPLICATE) & np.isin(out.status, (TRACKING, COASTING))
    velocity = np.where(published, out.velocity, np.nan)
    rms, share = field.error(velocity, column)
    rows = np.flatnonzero(column.counted & np.isfinite(velocity))
    rows = rows[np.concatenate([[True], np.diff(column.time[rows]) > 0.0])]
    error = velocity[rows] - samples.velocity[rows]
    found = metrics.velocity(
        column.time[rows], velocity[rows], samples.velocity[rows], column.noise
    )
    sigma = np.hypot(out.velocity_stddev[rows], column.noise)
    covered = float(np.mean(np.abs(error) <= SIGMAS * sigma))
    return Result(rms, found['delay_s'], covered, share)


class Summary(NamedTuple):
    """Ratios over a baseline: geometric mean, shares at most 1.0 and `NEAR`, worst, its series."""

    mean: float
    at_most: float
    near: float
    worst: float
    series: str


def summary(rows: Iterable[Row], observer: str, baseline: str) -> Summary:
    """Return the ratios of the judged series; `baseline` is 'single' or 'best'."""
    ratios = {
        row.series: row.results[observer].rms / getattr(row, baseline) for row in rows if row.judged
    }
    values = np.array(list(ratios.values()))
    worst = max(ratios, key=lambda name: ratios[name])
    return Summary(
        float(np.exp(np.mean(np.log(values)))),
        float(np.mean(values <= 1.0)),
        float(np.mean(values <= NEAR)),
        ratios[worst],
        worst,
    )


def as_dict(found: Found) -> dict[str, Any]:
    """Return the comparison for ``--json``."""
    return {
        'single': found.single,
        'common': found.common,
        'rows': [
            {
                **row._asdict(),
                'results': {name: each._asdict() for name, each in row.results.items()},
            }
            for row in found.rows
        ],
        'ratios': {
            f'{name} / {baseline}': summary(found.rows, name, baseline)._asdict()
            for name in OBSERVERS
            for baseline in ('single', 'best')
        },
    }


def describe(found: Found, title: str, as_markdown: bool = False) -> str:
    """Return the tables as text: series by series, and the ratios."""
    lines = []
    for row in found.rows:
        cells: list[str] = []
        for name in OBSERVERS:
            each = row.results[name]
            cells += [number(each.rms, 3), fixed(each.rms / row.single, 2)]
            cells += [fixed(each.rms / row.best, 2), f'{100.0 * each.covered:.0f} %']
            if name == OBSERVERS[0]:
                late = each.delay_s
                cells.append(field.milliseconds(late) if math.isfinite(late) else '-')
        lines.append(
            (
                row.series + ('' if row.judged else ' *'),
                number(row.noise, 2),
                number(row.single, 3),
                f'{number(row.best, 3)}, {row.which}',
                *cells,
            )
        )
    heads = ['/ single', '/ best', 'covered']
    draw = markdown if as_markdown else table
    header = ('series', 'reference', 'single', 'best of four', OBSERVERS[0], *heads, 'late [ms]')
    whole = draw((*header, OBSERVERS[1], *heads), lines)
    shares = []
    for name in OBSERVERS:
        for baseline, meaning in (('single', 'single'), ('best', 'best of four')):
            over = summary(found.rows, name, baseline)
            shares.append(
                (
                    f'{name} / {meaning}',
                    fixed(over.mean, 2),
                    f'{100.0 * over.at_most:.0f} %',
                    f'{100.0 * over.near:.0f} %',
                    f'{fixed(over.worst, 2)}, {over.series}',
                )
            )
    covered = {
        name: [row.results[name].covered for row in found.rows if row.judged] for name in OBSERVERS
    }
    return '\n\n'.join(
        [
            f'{title}: velocity rms error [rad/s], observers at their defaults',
            whole,
            "*: not judged: the reference's own error is more than half of the best baseline's",
            f'single: {found.single}; best of four: {"; ".join(found.common.values())}',
            draw(('ratio', 'geometric mean', 'at most 1.0', f'at most {NEAR}', 'worst'), shares),
            '; '.join(
                f'{name}: the 95 % interval covers {100.0 * float(np.median(each)):.0f} % '
                f'(median), {100.0 * min(each):.0f} % at least'
                for name, each in covered.items()
            ),
        ]
    )
