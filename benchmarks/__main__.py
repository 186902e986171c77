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

from benchmarks import accuracy, faults, field, held_out, second, timing
from benchmarks.drive import drives
from benchmarks.live import live
from benchmarks.replay import MESSAGES, replays
from benchmarks.runner import Part, printed
from benchmarks.soak import soak
from benchmarks.update import batches, updates
from estimator_pkg import cli
from estimator_pkg.cli import Command
from estimator_pkg.errors import UserError

PROGRAM = 'python -m benchmarks'
QUICK_MESSAGES = 50_000
SOAK = 'soak'  # runs only if it is requested by name


def _speed(quick: bool) -> Part:
    return timing.part(
        [
            *updates(5 if quick else 15),
            *batches(300_000 if quick else 2_000_000, 3 if quick else 7),
            *replays(QUICK_MESSAGES if quick else MESSAGES, 1 if quick else 2),
            *drives(3 if quick else 7),
        ]
    )


CSV: dict[str, Callable[[Any], str]] = {'accuracy': accuracy.as_csv, 'held-out': held_out.as_csv}
PARTS: dict[str, Callable[[argparse.Namespace], Part]] = {
    'speed': lambda parsed: _speed(parsed.quick),
    'accuracy': lambda parsed: accuracy.part(Path(parsed.bags)),
    'live': lambda parsed: timing.part(live(parsed.quick)),
    'field': lambda parsed: field.part(Path(parsed.bags)),
    'held-out': lambda parsed: held_out.part(parsed.held_out, parsed.list),
    'faults': lambda parsed: faults.part(),
    'second': lambda parsed: second.part(),
    SOAK: lambda parsed: timing.part(soak(parsed.minutes)),
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
            result[part], blocks = measure(parsed)
        except UserError as error:
            if parsed.part:
                raise
            blocks = [f'not run: {error}']
        print(f'{part}: {printed(blocks, parsed.markdown)}\n', flush=True)
        if parsed.csv and part in CSV and part in result:
            path = Path(parsed.csv) / f'{part.replace("-", "_")}.csv'
            path.write_text(CSV[part](result[part]), encoding='utf-8')
    return result


COMMAND = Command('speed and accuracy compared with named peers', arguments, run)


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmarks; return the exit code."""
    arguments = sys.argv[1:] if words is None else words
    return cli.guarded(lambda: cli.run(COMMAND, arguments, PROGRAM), PROGRAM)


if __name__ == '__main__':
    sys.exit(main())
