# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""All observers at their defaults on recorded bags, in one table.

    python -m benchmarks.recorded bags
    python -m benchmarks.recorded bags --markdown
    python -m benchmarks.recorded bags --print-bounds > test/recordings_bounds.yaml

The truth of a recording is a sensor too: its fitted lag and bias are removed. The row is marked if
an error is below the reference's noise. Bounds guard against change: a case fails if it is worse
than its bound or better than half of it.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.destination import METADATA
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.comparison import Comparison, compare
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.options import MEASUREMENT, TRUTH, Options
from estimator_pkg.evaluation.text import fixed, markdown, table
from estimator_pkg.observers import DEFAULT
from estimator_pkg.printable import show
from estimator_pkg.progress import progress

SKIPPED = 0.5  # ignored at the beginning [s]
MARGIN = 1.15  # a new bound over the measured value
RAW = Entry('finite_difference, raw', 'finite_difference', (('bandwidth_hz', 1e6),))
MAIN = DEFAULT
RIVALS = ('kalman acceleration', RAW.label)


def recordings(folder: Path) -> list[Path]:
    """Return the bags below `folder` that contain a measurement and a truth.

    Raises
    ------
    UserError : there is no such bag.
    """
    found = []
    for metadata in sorted(folder.rglob(METADATA)):
        with open_bag(metadata.parent) as bag:
            if MEASUREMENT in bag.topics and TRUTH in bag.topics:
                found.append(metadata.parent)
    if not found:
        raise UserError(
            f'{folder} contains no bag with {MEASUREMENT} and {TRUTH}: give another folder'
        )
    return found


def measure(bag: Path, entries: Sequence[Entry]) -> Comparison:
    """Run the observers on one recording."""
    return compare(
        str(bag), Options(observers=tuple(entries), skip=SKIPPED, correct_reference=True)
    )


def case(bag: Path, joint: str) -> str:
    """Return the name of a joint of a recording in the bounds."""
    return f'{bag.name}/{joint}'


def own_error(rms: float, noise: float) -> float:
    """Return an rms error without the reference's noise; 0 if the noise is larger."""
    return math.sqrt(max(0.0, rms * rms - noise * noise))


def rows(folder: Path, entries: Sequence[Entry] | None = None) -> list[dict[str, Any]]:
    """Return one dictionary per recording, joint and observer."""
    chosen = list(entries if entries is not None else [*at_defaults(), RAW])
    bags = recordings(folder)
    result = []
    with progress('recordings', len(bags)) as advance:
        for bag in bags:
            found = measure(bag, chosen)
            for row in found.rows:
                noise = found.references[row.joint].noise
                result.append(
                    {
                        'case': case(bag, row.joint),
                        'observer': row.source,
                        **row.velocity,
                        'own': own_error(row.velocity['rms'], noise),
                        'reference_noise': noise,
                        'reference_cannot_tell': row.reference_cannot_tell,
                    }
                )
            advance(1)
    return result


def bounds(measured: Sequence[dict[str, Any]]) -> dict[str, dict[str, list[float]]]:
    """Return new bounds: case -> observer -> [rms, largest error]."""
    fresh: dict[str, dict[str, list[float]]] = {}
    for row in measured:
        fresh.setdefault(row['case'], {})[row['observer']] = [
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


def describe(measured: Sequence[dict[str, Any]], as_markdown: bool = False) -> str:
    """Return the table: rms error per observer and recording, and `MAIN`'s over its rivals'."""
    observers = list(dict.fromkeys(row['observer'] for row in measured))
    cases: dict[str, dict[str, dict[str, Any]]] = {}
    for row in measured:
        cases.setdefault(row['case'], {})[row['observer']] = row
    lines = []
    for name, found in cases.items():
        noise = next(iter(found.values()))['reference_noise']
        cells = [
            fixed(row['rms'], 3) + (' *' if row['reference_cannot_tell'] else '')
            for row in found.values()
        ]
        lines.append(
            (
                name,
                fixed(noise, 3),
                *cells,
                *(fixed(found[MAIN]['rms'] / found[rival]['rms'], 2) for rival in RIVALS),
            )
        )
    header = (
        'recording/joint',
        'reference noise',
        *observers,
        *(f'{MAIN} / {rival}' for rival in RIVALS),
    )
    text = (markdown if as_markdown else table)(header, lines)
    return (
        f'{text}\n\nVelocity rms error [rad/s] at zero shift, without the first {SKIPPED:g} s; the '
        "reference's own lag and bias\nare removed. *: the error is below the reference's own "
        'noise.'
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, or new bounds; return the exit code."""
    parser = argparse.ArgumentParser(description='all observers on recorded bags, in one table')
    parser.add_argument('folder', type=Path, help='folder of the bags')
    parser.add_argument('--print-bounds', action='store_true', help='print new bounds as YAML')
    parser.add_argument('--markdown', action='store_true')
    parsed = parser.parse_args(arguments)
    try:
        measured = rows(parsed.folder)
    except UserError as error:
        show(error, file=sys.stderr)
        return error.exit_code
    if parsed.print_bounds:
        print(yaml.safe_dump(bounds(measured), sort_keys=False, default_flow_style=None), end='')
    else:
        print(describe(measured, parsed.markdown))
    return 0


if __name__ == '__main__':
    sys.exit(main())
