# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The runner of lists: observers at their defaults and swept laws on columns; what is printed."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.columns import Column, published
from benchmarks.laws import Law
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.text import fixed, markdown, table
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

SIGMAS = 1.959964  # standard deviations of a 95 % interval
FAILED = 1e3  # ratio that a missing error counts as, when one setting is chosen


class Table(NamedTuple):
    """A table that a part prints: names of its columns, and cells."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]


Blocks = Sequence[str | Table]  # what a part prints, '' left out
Part = tuple[Any, Blocks]  # its result for --json, too


def printed(blocks: Blocks, as_markdown: bool = False) -> str:
    """Return blocks as text, with an empty line between two."""
    draw = markdown if as_markdown else table
    return '\n\n'.join(draw(*each) if isinstance(each, Table) else each for each in blocks if each)


def covered(error: Array, sigma: Array) -> float:
    """Return the fraction of errors within the 95 % interval; shape (n,) each [rad/s]."""
    return float(np.mean(np.abs(error) <= SIGMAS * sigma))


def result(column: Column, entry: Entry) -> dict[str, Any]:
    """Return an observer's errors on a column; it does not know the quantum.

    Returns
    -------
    rms, mean_abs, max_abs, bias [rad/s], delay_s, noise (see `metrics.velocity`), coverage of the
    95 % interval, which contains the reference's error, and the published share.
    """
    out = entry.joint(wrap_period=column.period).run(column.samples.stamps, column.samples.angle)
    velocity = np.where(published(out), out.velocity, np.nan)
    rows = np.flatnonzero(column.counted & np.isfinite(velocity))
    rows = rows[np.concatenate([[True], np.diff(column.time[rows]) > 0.0])]
    true = column.samples.velocity[rows]
    sigma = np.hypot(out.velocity_stddev[rows], column.noise)
    return {
        **metrics.velocity(column.time[rows], velocity[rows], true, column.noise),
        'coverage': covered(velocity[rows] - true, sigma),
        'published': column.error(velocity)[1],
    }


def swept(law: Law, columns: Sequence[Column], advance: Callable[[int], Any]) -> Array:
    """Return the rms errors, shape (settings, columns) [rad/s]."""
    found = []
    for value in law.values:
        with np.errstate(all='ignore'):  # a gain that diverges has no error
            found.append([each.error(law.run(each, value))[0] for each in columns])
        advance(1)
    return np.array(found)


def choose(errors: Array, floors: Array | float = 0.0) -> int:
    """Return the index of the setting with the least geometric mean of error over best error.

    Parameters
    ----------
    errors : shape (settings, columns); inf without an estimate.
    floors : shape (columns,) or one; errors below these count as zero.
    """
    errors = np.maximum(errors + floors, 1e-300)
    judged = np.isfinite(np.min(errors, axis=0))
    over = errors[:, judged] / np.min(errors[:, judged], axis=0)
    over = np.where(np.isfinite(over), over, FAILED)
    return int(np.argmin(np.mean(np.log(over), axis=1))) if judged.any() else 0


def chosen(
    laws: Sequence[Law], sets: Mapping[str, Sequence[Column]], floors: bool = True
) -> dict[str, dict[str, tuple[Any, Array]]]:
    """Return, by law and set, its one setting and its errors there [rad/s], shape (columns,).

    A law is not run on a set that it leaves out. With `floors`, errors below the columns' floors
    count as zero in the choice.
    """
    found: dict[str, dict[str, tuple[Any, Array]]] = {}
    total = sum(len(law.values) for law in laws for name in sets if name not in law.without)
    with progress('the laws', total) as advance:
        for law in laws:
            found[law.name] = {}
            for name, columns in sets.items():
                if name not in law.without:
                    errors = swept(law, columns, advance)
                    floor = np.array([each.floor for each in columns]) if floors else 0.0
                    at = choose(errors, floor)
                    found[law.name][name] = law.values[at], errors[at]
    return found


def delay_and_coverage(found: Mapping[str, Any], prefix: str = '') -> dict[str, str]:
    """Return cells of a CSV file for a `result`."""
    late = math.nan if found['delay_s'] is None else 1e3 * found['delay_s']  # None: from JSON
    return {
        f'{prefix}delay_ms': fixed(late, 2) if math.isfinite(late) else '',
        f'{prefix}covered_percent': f'{100.0 * found["coverage"]:.0f}',
    }


def csv_text(rows: Iterable[Mapping[str, str]]) -> str:
    """Return rows as CSV with a header."""
    lines, out = list(rows), io.StringIO()
    writer = csv.DictWriter(out, lines[0], lineterminator='\n')
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue()
