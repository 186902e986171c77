"""``velocity_estimator bench``: speed and accuracy, beside named peers."""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Callable
from typing import Any

from estimator_pkg.cli import Command
from estimator_pkg.evaluation import bench_accuracy, bench_field
from estimator_pkg.evaluation.bench_drive import drives
from estimator_pkg.evaluation.bench_live import live
from estimator_pkg.evaluation.bench_replay import MESSAGES, replays
from estimator_pkg.evaluation.bench_update import batches, updates
from estimator_pkg.evaluation.text import number, table

SPEED, ACCURACY = 'speed', 'accuracy'
QUICK_MESSAGES = 50_000
PARTS: dict[str, Callable[[bool, int | None], list[dict[str, Any]]]] = {
    'update': lambda quick, messages: updates(5 if quick else 15),
    'batch': lambda quick, messages: batches(300_000 if quick else 2_000_000, 3 if quick else 7),
    'replay': lambda quick, messages: replays(
        messages or (QUICK_MESSAGES if quick else MESSAGES), 1 if quick else 2),
    'live': lambda quick, messages: live(),
    'drive': lambda quick, messages: drives(3 if quick else 7),
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument('group', nargs='?', choices=(SPEED, ACCURACY),
                        help='which group; default: both')
    parser.add_argument('--part', action='append', choices=tuple(PARTS), default=[],
                        help='of speed, only this part (may be repeated)')
    parser.add_argument('--draws', type=_positive, metavar='N',
                        help='of accuracy, also N random phases and speeds per column')
    parser.add_argument('--field', action='store_true',
                        help='of accuracy, also ours and installed peers, each at one setting and '
                             'at its best per column')
    parser.add_argument('--plot', metavar='FILE', help='draw the field')
    parser.add_argument('--quick', action='store_true',
                        help='fewer rounds and shorter bags: a look, not a measurement')
    parser.add_argument('--messages', type=_positive, metavar='N',
                        help=f'length of the replayed bag (default {MESSAGES})')


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Measures and prints group after group."""
    result: dict[str, Any] = {'machine': machine()}
    print(', '.join(f'{name} {value}' for name, value in result['machine'].items()) + '\n')
    if parsed.group in (None, ACCURACY) and not parsed.part:
        result[ACCURACY] = bench_accuracy.run()
        print(bench_accuracy.describe(result[ACCURACY]) + '\n')
        if parsed.draws:
            result['drawn'] = bench_accuracy.spread(draws=parsed.draws, fast=True)
            print(bench_accuracy.describe_spread(result['drawn']) + '\n')
        if parsed.field or parsed.plot:
            result['field'] = bench_field.run()
            print(bench_field.describe(result['field']) + '\n')
            if parsed.plot:
                bench_field.draw(result['field'], parsed.plot)
                print(f'plot: {parsed.plot}')
    if parsed.group in (None, SPEED):
        rows: list[dict[str, Any]] = []
        for part in parsed.part or PARTS:
            found = PARTS[part](parsed.quick, parsed.messages)
            print(f'{part}\n{describe(found)}\n', flush=True)
            rows += [{'part': part, **row} for row in found]
        result[SPEED] = {'rows': rows, 'quick': parsed.quick}
        missed = [row['name'] for row in rows if row['ok'] is False]
        if missed:
            print('required and not reached here: ' + '; '.join(missed))
    return result


def describe(rows: list[dict[str, Any]]) -> str:
    """The lines of one part as text."""
    lines = []
    for row in rows:
        if row['value'] is None:
            lines.append((row['name'], 'not run', '', '', row.get('why', '')))
            continue
        required = ''
        if row['limit'] is not None:
            required = f'{row["required"]} {number(row["limit"])}: ' + (
                'yes' if row['ok'] else 'NO')
        lines.append((row['name'], number(row['value']), number(row.get('median')), row['unit'],
                      required))
    return table(('', 'value', 'median', 'unit', 'required'), lines)


def machine() -> dict[str, str]:
    """Where this was measured."""
    return {'Python': platform.python_version(), 'on': f'{platform.system()} {platform.machine()}',
            'cores': str(os.cpu_count())}


def _positive(text: str) -> int:
    value = int(text)
    if value < 4:
        raise argparse.ArgumentTypeError('must be at least 4')
    return value


COMMAND = Command('speed and accuracy beside named peers', arguments, run)
