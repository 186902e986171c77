# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``python -m benchmarks``: speed and accuracy compared with named peers, from the checkout."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks import accuracy, faults, field, held_out, second
from benchmarks.drive import drives
from benchmarks.live import live
from benchmarks.replay import MESSAGES, replays
from benchmarks.runner import chosen
from benchmarks.soak import soak
from benchmarks.update import batches, updates
from estimator_pkg import cli
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.text import markdown, number, table

PROGRAM = 'python -m benchmarks'
QUICK_MESSAGES = 50_000
SOAK = 'soak'  # runs only if it is requested by name
Result = tuple[Any, str]  # for --json; what is printed


def _speed(parsed: argparse.Namespace) -> Result:
    quick = parsed.quick
    return _rows(
        parsed,
        [
            *updates(5 if quick else 15),
            *batches(300_000 if quick else 2_000_000, 3 if quick else 7),
            *replays(QUICK_MESSAGES if quick else MESSAGES, 1 if quick else 2),
            *drives(3 if quick else 7),
        ],
    )


def _accuracy(parsed: argparse.Namespace) -> Result:
    rows, lacking = accuracy.part(Path(parsed.bags))
    return rows, '\n'.join(filter(None, [accuracy.describe(rows, parsed.markdown), lacking]))


def _field(parsed: argparse.Namespace) -> Result:
    sets = field.columns(Path(parsed.bags))
    laws, missing = field.laws()
    rows = field.compared(chosen(laws, sets), sets)
    lacking = [f'not run, not installed: {", ".join(missing)}'] if missing else []
    return rows, '\n'.join([field.describe(rows, parsed.markdown), *lacking])


def _held_out(parsed: argparse.Namespace) -> Result:
    if parsed.held_out is None:
        raise UsageError(
            'their files are not shipped: give the folder of the repositories with --held-out'
        )
    lists = held_out.run(Path(parsed.held_out), parsed.list or tuple(held_out.LISTS))
    return lists, held_out.describe(lists, parsed.markdown)


def _second(parsed: argparse.Namespace) -> Result:
    cases = [*second.simulated()]
    cases += second.recorded(Path(parsed.second)) if parsed.second else []
    rows = [second.judged(case) for case in cases]
    return rows, second.describe(rows, parsed.markdown)


def _faults(parsed: argparse.Namespace) -> Result:
    rows = faults.faults()
    return rows, faults.describe(rows, parsed.markdown)


CSV: dict[str, Callable[[Any], str]] = {'accuracy': accuracy.as_csv, 'held-out': held_out.as_csv}
PARTS: dict[str, Callable[[argparse.Namespace], Result]] = {
    'speed': _speed,
    'accuracy': _accuracy,
    'live': lambda parsed: _rows(parsed, live(parsed.quick)),
    'field': _field,
    'held-out': _held_out,
    'faults': _faults,
    'second': _second,
    SOAK: lambda parsed: _rows(parsed, soak(parsed.minutes)),
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""

    def add(*names: str, **options: Any) -> None:
        parser.add_argument(*names, **options)

    some: dict[str, Any] = {'action': 'append', 'default': []}
    parts = (
        'run only this part (may be repeated; default: all but soak): cost of updates, batches, '
        'replay and drive; errors, delays and coverage; nodes over DDS; all causal laws; held-out '
        'series; faults of a sensor; second sensors; a node with a faulty driver'
    )
    add('--part', choices=tuple(PARTS), help=parts, **some)
    add('--bags', metavar='FOLDER', default='bags', help='folder of the recordings (default: bags)')
    add('--held-out', metavar='FOLDER', help='folder of the repositories of the held-out series')
    add('--second', metavar='FOLDER', help='folder of recordings with a second sensor')
    lists = 'held-out: only this list (may be repeated; default: all)'
    add('--list', choices=tuple(held_out.LISTS), help=lists, **some)
    add('--minutes', type=float, default=60.0, help='of the part soak (default: 60)')
    add('--markdown', action='store_true', help='print the tables as Markdown')
    add('--csv', metavar='FOLDER', help='write accuracy.csv and held_out.csv into this folder')
    add('--quick', action='store_true', help='a quick check, not a measurement: fewer rounds')


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Run and print part after part; return the results.

    A part that cannot run prints why, or raises it if it was requested by name.
    """
    machine = {
        'Python': platform.python_version(),
        'on': f'{platform.system()} {platform.machine()}',
        'cores': str(os.cpu_count()),
    }
    print(', '.join(f'{name} {value}' for name, value in machine.items()) + '\n')
    result: dict[str, Any] = {'machine': machine}
    for part, measure in PARTS.items():
        if part not in (parsed.part or PARTS.keys() - {SOAK}):
            continue
        try:
            result[part], printed = measure(parsed)
        except UserError as error:
            if parsed.part:
                raise
            printed = f'not run: {error}'
        print(f'{part}: {printed}\n', flush=True)
        if parsed.csv and part in CSV and part in result:
            path = Path(parsed.csv) / f'{part.replace("-", "_")}.csv'
            path.write_text(CSV[part](result[part]), encoding='utf-8')
    return result


def _rows(parsed: argparse.Namespace, rows: list[dict[str, Any]]) -> Result:
    """Return the rows and their table."""
    missed = [row['name'] for row in rows if row['ok'] is False]
    printed = 'value, median over the rounds, requirement\n\n' + describe(rows, parsed.markdown)
    return rows, printed + ('\nrequirement not met: ' + '; '.join(missed) if missed else '')


def describe(rows: list[dict[str, Any]], as_markdown: bool = False) -> str:
    """Return measured rows as a table."""
    lines = []
    for row in rows:
        if row['value'] is None:
            lines.append((row['name'], 'not run', '', '', row.get('why', '')))
            continue
        required = ''
        if row['limit'] is not None:
            required = f'{row["required"]} {number(row["limit"])}: ' + (
                'yes' if row['ok'] else 'NO'
            )
        lines.append(
            (row['name'], number(row['value']), number(row.get('median')), row['unit'], required)
        )
    draw = markdown if as_markdown else table
    return draw(('', 'value', 'median', 'unit', 'required'), lines)


COMMAND = Command('speed and accuracy compared with named peers', arguments, run)


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmarks; return the exit code."""
    arguments = sys.argv[1:] if words is None else words
    return cli.guarded(lambda: cli.run(COMMAND, arguments, PROGRAM), PROGRAM)


if __name__ == '__main__':
    sys.exit(main())
