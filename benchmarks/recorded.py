"""All observers at their defaults on recorded bags, in one table.

    python -m benchmarks.recorded bags
    python -m benchmarks.recorded bags --markdown
    python -m benchmarks.recorded bags --print-bounds > test/recordings_bounds.yaml

The truth of a recording is a sensor too: its own lag and bias are taken off as fitted, and where an
error is no larger than its noise the row says so. Bounds guard against change: a case fails when it
is worse than its bound or better than half of it.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from estimator_pkg.bags.reader import METADATA, open_bag
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.comparison import Comparison, compare
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.options import MEASUREMENT, TRUTH, Options
from estimator_pkg.evaluation.text import fixed, markdown, table
from estimator_pkg.printable import show
from estimator_pkg.progress import progress

SKIPPED = 0.5  # [s] at the beginning that does not count
MARGIN = 1.15  # a fresh bound is this many times what was measured
RAW = Entry('finite_difference, raw', 'finite_difference', (('bandwidth_hz', 1e6),))
MAIN = 'hybrid_angle'
RIVALS = ('kalman acceleration', RAW.label)


def recordings(folder: Path) -> list[Path]:
    """The bags below `folder` that carry a measurement and a truth of their own.

    Raises
    ------
    UserError : there is none.
    """
    found = []
    for metadata in sorted(folder.rglob(METADATA)):
        with open_bag(metadata.parent) as bag:
            if MEASUREMENT in bag.topics and TRUTH in bag.topics:
                found.append(metadata.parent)
    if not found:
        raise UserError(f'{folder}: no bag with {MEASUREMENT} and {TRUTH}')
    return found


def measure(bag: Path, entries: Sequence[Entry]) -> Comparison:
    """The observers on one recording."""
    return compare(
        str(bag), Options(observers=tuple(entries), skip=SKIPPED, correct_reference=True)
    )


def case(bag: Path, joint: str) -> str:
    """How a joint of a recording is called in the bounds."""
    return f'{bag.name}/{joint}'


def own_error(rms: float, noise: float) -> float:
    """What is left of an rms error when the reference's noise is taken off; 0: nothing."""
    return math.sqrt(max(0.0, rms * rms - noise * noise))


def rows(folder: Path, entries: Sequence[Entry] | None = None) -> list[dict[str, Any]]:
    """One dictionary per recording, joint and observer."""
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
    """Fresh bounds: case -> observer -> [rms, largest error]."""
    fresh: dict[str, dict[str, list[float]]] = {}
    for row in measured:
        fresh.setdefault(row['case'], {})[row['observer']] = [
            float(f'{MARGIN * row[name]:.3g}') for name in ('rms', 'max_abs')
        ]
    return fresh


def judge(value: float, bound: float) -> str:
    """'' if `value` is at most `bound` and not better than half of it; else what is wrong."""
    if not value <= bound:
        return f'{value:.4g} is worse than its bound {bound:.4g}'
    if value < 0.5 * bound:
        return f'{value:.4g} is better than half of its bound {bound:.4g}: print fresh bounds'
    return ''


def describe(measured: Sequence[dict[str, Any]], as_markdown: bool = False) -> str:
    """The table: rms error of each observer on each recording, and `MAIN`'s over its rivals'."""
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
        f'{text}\n\nVelocity rms error [rad/s] at zero shift, the first {SKIPPED:g} s left '
        "out, the reference's own lag and bias\ntaken off. *: the reference cannot tell: the "
        'error is no larger than its own noise.'
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table, or fresh bounds."""
    parser = argparse.ArgumentParser(description='all observers on recorded bags, in one table')
    parser.add_argument('folder', type=Path, help='where the bags are')
    parser.add_argument('--print-bounds', action='store_true', help='fresh bounds as YAML')
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
