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

from benchmarks import (
    accuracy,
    chart,
    field,
    held_out,
    intervals,
    moteus,
    preference,
    rivals,
    streams,
)
from benchmarks.columns import shared
from benchmarks.drive import drives
from benchmarks.live.rows import latencies, live, starts
from benchmarks.mechanism import mechanisms
from benchmarks.recordings import recorded
from benchmarks.replay import MESSAGES, replays
from benchmarks.smoothed import smoothed
from benchmarks.update import batches, updates
from estimator_pkg import cli
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.report.plot import check
from estimator_pkg.evaluation.text import number, table

PROGRAM = 'python -m benchmarks'
SPEED, ACCURACY = 'speed', 'accuracy'
QUICK_MESSAGES = 50_000
ERRORS = ('rpm', 'deg')  # units of the drive's errors; the rest of its rows are costs
SHARED, RECORDED = 'the shared set', 'the recordings'
SPEED_PARTS: dict[str, Callable[[bool, int | None], list[dict[str, Any]]]] = {
    'update': lambda quick, messages: updates(5 if quick else 15),
    'batch': lambda quick, messages: batches(300_000 if quick else 2_000_000, 3 if quick else 7),
    'smoothed': lambda quick, messages: smoothed(5 if quick else 15),
    'mechanism': lambda quick, messages: mechanisms(3 if quick else 7),
    'replay': lambda quick, messages: replays(
        messages or (QUICK_MESSAGES if quick else MESSAGES), 1 if quick else 2
    ),
    'live': lambda quick, messages: live(),
    'start': lambda quick, messages: starts(1 if quick else 5),
    'latency': lambda quick, messages: latencies(1 if quick else 3),
    'drive': lambda quick, messages: [
        row for row in drives(3 if quick else 7) if row['unit'] not in ERRORS
    ],
}
ACCURACY_PARTS = (
    'defaults',
    'field',
    'recordings',
    'held',
    'moteus',
    'streams',
    'interval',
    'prefer',
    'rivals',
    'drive',
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        'group', nargs='?', choices=(SPEED, ACCURACY), help='group to run (default: both)'
    )
    parser.add_argument(
        '--part',
        action='append',
        default=[],
        choices=tuple(dict.fromkeys((*SPEED_PARTS, *ACCURACY_PARTS))),
        help=f'run only this part (may be repeated); of speed: '
        f'{", ".join(SPEED_PARTS)}; of accuracy: {", ".join(ACCURACY_PARTS)}',
    )
    parser.add_argument(
        '--draws',
        type=_positive,
        metavar='N',
        help='of accuracy: also N random phases and speeds per column',
    )
    parser.add_argument(
        '--bags',
        metavar='FOLDER',
        default='bags',
        help='of accuracy: folder of the recordings (default: bags)',
    )
    parser.add_argument(
        '--held-out',
        metavar='FOLDER',
        help='of accuracy: folder of the repositories with the held-out recordings',
    )
    parser.add_argument(
        '--plot',
        metavar='FILE',
        help='draw the field into FILE, and the recordings into FILE with _recordings in its name',
    )
    parser.add_argument('--markdown', action='store_true', help='print the tables as Markdown')
    parser.add_argument(
        '--quick',
        action='store_true',
        help='a quick check, not a measurement: fewer rounds, shorter bags, no sweeps',
    )
    parser.add_argument(
        '--messages',
        type=_positive,
        metavar='N',
        help=f'length of the replayed bag (default {MESSAGES})',
    )


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Run and print part after part; return the results.

    Raises
    ------
    UsageError : a part that the group does not have.
    """
    if parsed.plot:
        check(parsed.plot)
    result: dict[str, Any] = {'machine': machine()}
    chosen = _chosen(parsed)
    print(', '.join(f'{name} {value}' for name, value in result['machine'].items()) + '\n')
    if ACCURACY in chosen:
        _accuracy(parsed, chosen[ACCURACY], result)
    if SPEED in chosen:
        rows: list[dict[str, Any]] = []
        for part in chosen[SPEED]:
            found = SPEED_PARTS[part](parsed.quick, parsed.messages)
            print(f'{part}\n{describe(found)}\n', flush=True)
            rows += [{'part': part, **row} for row in found]
        result[SPEED] = {'rows': rows, 'quick': parsed.quick}
        missed = [row['name'] for row in rows if row['ok'] is False]
        if missed:
            print('requirement not met: ' + '; '.join(missed))
    return result


def _chosen(parsed: argparse.Namespace) -> dict[str, list[str]]:
    """Return the parts to run, by group."""
    parts = {ACCURACY: list(ACCURACY_PARTS), SPEED: list(SPEED_PARTS)}
    if parsed.quick:
        parts[ACCURACY] = ['defaults', 'drive']
    found = {}
    for group in (ACCURACY, SPEED):
        if parsed.group in (None, group):
            every = ACCURACY_PARTS if group == ACCURACY else tuple(SPEED_PARTS)
            mine = [part for part in every if part in parsed.part] if parsed.part else parts[group]
            if mine:
                found[group] = mine
    unknown = set(parsed.part) - {part for mine in found.values() for part in mine}
    if unknown:
        raise UsageError(
            f"{parsed.group} has no part '{min(unknown)}': "
            f'choose one of {", ".join(sorted(set(SPEED_PARTS) | set(ACCURACY_PARTS)))}'
        )
    return found


def _accuracy(parsed: argparse.Namespace, parts: list[str], result: dict[str, Any]) -> None:
    if 'defaults' in parts:
        result[ACCURACY] = accuracy.run()
        print(accuracy.describe(result[ACCURACY]) + '\n', flush=True)
    if parsed.draws:
        result['drawn'] = accuracy.drawn(draws=parsed.draws, fast=True)
        print(accuracy.describe_drawn(result['drawn']) + '\n', flush=True)
    if 'field' in parts:
        result['field'] = field.run(shared(), label=SHARED)
        _print(parsed, result['field'], SHARED, parsed.plot)
    if 'recordings' in parts:
        beside = Path(parsed.plot) if parsed.plot else None
        try:
            columns, refused = recorded(Path(parsed.bags))
        except UserError as error:
            why = f'{error}: give their folder with --bags'
            if 'recordings' in parsed.part:  # requested by name
                raise UserError(why) from error
            print(f'{RECORDED}: not run: {why}\n')
        else:
            result['recordings'] = {**field.run(columns, label=RECORDED), 'refused': refused}
            _print(
                parsed,
                result['recordings'],
                RECORDED,
                str(beside.with_stem(f'{beside.stem}_recordings')) if beside else None,
            )
    if 'held' in parts:
        _held(parsed, result)
    if 'moteus' in parts:
        _moteus(parsed, result)
    if 'streams' in parts:
        result['streams'] = streams.run(fast=True)
        print(streams.describe(result['streams'], parsed.markdown) + '\n', flush=True)
    if 'interval' in parts:
        result['interval'] = intervals.run(intervals.columns(Path(parsed.bags)))
        print(intervals.describe(result['interval'], parsed.markdown) + '\n', flush=True)
    if 'prefer' in parts:
        result['prefer'] = preference.run(Path(parsed.bags), fast=True)
        print(preference.describe(result['prefer'], parsed.markdown) + '\n', flush=True)
    if 'rivals' in parsed.part:  # requested by name: it repeats others, and takes long
        laws = rivals.rivals(rivals.run(rivals.columns(Path(parsed.bags))))
        result['rivals'] = [each._asdict() for each in laws]
        print(rivals.describe(laws, parsed.markdown) + '\n', flush=True)
        if parsed.plot:
            rivals.draw(laws, parsed.plot)
    if 'drive' in parts:
        rows = [row for row in drives(1) if row['unit'] in ERRORS or row['value'] is None]
        result['drive'] = {'rows': rows}
        print(f'the sensorless drive and motulator\n{describe(rows)}\n', flush=True)


def _held(parsed: argparse.Namespace, result: dict[str, Any]) -> None:
    if parsed.held_out is None:
        why = 'their files are not shipped: give the folder of the repositories with --held-out'
        if 'held' in parsed.part:  # requested by name
            raise UsageError(why)
        print(f'held-out recordings: not run: {why}\n')
        return
    result['held'] = {}
    for which, title in held_out.LISTS.items():
        found = held_out.run(Path(parsed.held_out), which)
        result['held'][which] = held_out.as_dict(found)
        print(held_out.describe(found, title, parsed.markdown) + '\n', flush=True)


def _moteus(parsed: argparse.Namespace, result: dict[str, Any]) -> None:
    try:
        result['moteus'] = moteus.run(Path(parsed.bags) / moteus.FOLDER, fast=True)
    except UserError as error:
        if 'moteus' in parsed.part:  # requested by name
            raise
        print(f'{moteus.FOLDER}: not run: {error}\n')
    else:
        print(moteus.describe(result['moteus'], parsed.markdown) + '\n', flush=True)


def _print(parsed: argparse.Namespace, found: dict[str, Any], title: str, plot: str | None) -> None:
    print(field.describe(found, title, parsed.markdown) + '\n', flush=True)
    if plot:
        chart.draw(found, plot, title)
        print(f'plot: {plot}\n', flush=True)


def describe(rows: list[dict[str, Any]]) -> str:
    """Return the lines of one part as text."""
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
    return table(('', 'value', 'median', 'unit', 'required'), lines)


def machine() -> dict[str, str]:
    """Return a description of this machine."""
    return {
        'Python': platform.python_version(),
        'on': f'{platform.system()} {platform.machine()}',
        'cores': str(os.cpu_count()),
    }


def _positive(text: str) -> int:
    value = int(text)
    if value < 4:
        raise argparse.ArgumentTypeError(f'{text} is too small: it must be at least 4')
    return value


COMMAND = Command('speed and accuracy compared with named peers', arguments, run)


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmarks; return the exit code."""
    arguments = sys.argv[1:] if words is None else words
    return cli.guarded(lambda: cli.run(COMMAND, arguments, PROGRAM), PROGRAM)


if __name__ == '__main__':
    sys.exit(main())
