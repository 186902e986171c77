# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--csv FOLDER``: the rows of a part as a file of benchmarks/results, with units in the names."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from typing import Any

from estimator_pkg.evaluation.text import fixed, number

Row = dict[str, str]


def accuracy(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return the rows of `accuracy.run` as CSV."""
    return _text(
        {
            'stream': row['stream'],
            'observer': row['observer'],
            'rms_rad_s': number(row['rms'], 3),
            **_delay_and_coverage('', row['delay_s'], row['coverage']),
            'below_reference_error': 'yes' if row.get('reference_cannot_tell') else '',
        }
        for row in rows
    )


def held_out(lists: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the lists of `held_out.as_dict`, by title, as CSV."""
    return _text(
        {
            'list': title,
            'series': row['series'],
            'judged': 'yes' if row['judged'] else 'no',
            'reference_error_rad_s': number(row['noise'], 2),
            'single_rms_rad_s': number(row['single'], 3),
            'best_of_four_rms_rad_s': number(row['best'], 3),
            'best_of_four': row['which'],
            **{
                key: value for cells in map(_result, row['results'].items()) for key, value in cells
            },
        }
        for title, found in lists.items()
        for row in found['rows']
    )


def _result(named: tuple[str, Mapping[str, Any]]) -> Iterable[tuple[str, str]]:
    name, found = named
    yield f'{name}_rms_rad_s', number(found['rms'], 3)
    yield from _delay_and_coverage(f'{name}_', found['delay_s'], found['covered']).items()


def _delay_and_coverage(prefix: str, delay: float | None, covered: float) -> Row:
    late = math.nan if delay is None else 1e3 * delay
    return {
        f'{prefix}delay_ms': fixed(late, 2) if math.isfinite(late) else '',
        f'{prefix}covered_percent': f'{100.0 * covered:.0f}',
    }


def _text(rows: Iterable[Row]) -> str:
    lines = list(rows)
    out = io.StringIO()
    writer = csv.DictWriter(out, lines[0], lineterminator='\n')
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue()
