# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

r"""A drive's log as CSV into a bag for pmsm_observer, and a bag into CSV.

    python docs/examples/drive_csv.py to-bag LOG.csv BAG --time time_s \
        --current i_a,i_b,i_c --voltage u_a,u_b,u_c --speed speed_rad_s
    python docs/examples/drive_csv.py to-csv BAG LOG.csv

Two columns of currents (or voltages) are alpha and beta, three are the phases a, b and c. With
--phases, two columns are the phases a and b, and c = -a - b. The first row of the file has the
names. Columns separated by semicolons have decimal commas. docs/first_drive.md has the sign
conventions.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import whole_file
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.errors import UserError
from estimator_pkg.messages import drive_samples, joint_state

Array = NDArray[np.float64]
SAMPLES, TRUTH = '/drive_samples', '/ground_truth/joint_states'
FIRST = 1_000_000_000  # [s] added to the times: a stamp of zero means that there is none
UNITS = {'s': 1e9, 'ms': 1e6, 'us': 1e3, 'ns': 1.0}
SPEEDS = {'rad/s': 1.0, 'rpm': np.pi / 30.0}


def columns(path: Path, names: list[str]) -> list[Array]:
    """Return these columns of a CSV file; raise UserError with the missing name, or the line."""
    # a spreadsheet begins a file with a byte order mark
    lines = whole_file.read_text(path).removeprefix('\ufeff').splitlines()
    separator, decimal = (';', ',') if lines and ';' in lines[0] else (',', '.')
    rows = csv.DictReader(lines, delimiter=separator)
    for name in names:
        if name not in (rows.fieldnames or ()):
            raise UserError(f"{path} has no column '{name}', only {rows.fieldnames}")
    try:
        table = [[float((row[name] or '').replace(decimal, '.')) for name in names] for row in rows]
    except ValueError as error:
        raise UserError(f'{path}, line {rows.line_num}: {error}') from None
    if not table:
        raise UserError(f'{path} has no row below its names')
    return list(np.array(table).T)


def alpha_beta(parts: list[Array], phases: bool) -> list[Array]:
    """Return alpha and beta, amplitude-invariant: alpha points along phase a."""
    if len(parts) == 2 and not phases:
        return parts
    a, b, *rest = parts
    c = rest[0] if rest else -a - b
    return [(2.0 * a - b - c) / 3.0, (b - c) / np.sqrt(3.0)]


def hint(speed: Array, voltage: list[Array], stamps: NDArray[np.int64]) -> str:
    """Return a hint if the voltages turn slower than a motor of one pole pair at this speed."""
    vector = voltage[0] + 1j * voltage[1]
    turned = np.abs(np.angle(vector[1:] * np.conj(vector[:-1]))) / (np.diff(stamps) * 1e-9)
    electrical, mechanical = float(np.median(turned)), float(np.median(np.abs(speed)))
    if electrical > 0.9 * mechanical:
        return ''
    return (
        f'the voltages turn at {electrical:.4g} rad/s, slower than the speed of {mechanical:.4g} '
        'rad/s: is it in rpm? Add --speed-unit rpm'
    )


def to_bag(given: argparse.Namespace) -> str:
    """Write the bag; return what it has."""
    current, voltage = given.current.split(','), given.voltage.split(',')
    if not {len(current), len(voltage)} <= {2, 3}:
        raise UserError('--current and --voltage need two or three columns, separated by commas')
    if given.batch < 1:
        raise UserError(f'--batch is {given.batch}: it must be at least 1')
    names = [given.time, *current, *voltage, *([given.speed] if given.speed else [])]
    time, *values = columns(given.log, names)
    stamps = FIRST * 10**9 + np.round((time - time[0]) * UNITS[given.time_unit]).astype(np.int64)
    if not np.all(np.diff(stamps) > 0):
        row = int(np.argmin(np.diff(stamps) > 0)) + 3
        raise UserError(f'{given.log}, line {row}: the time does not increase: sort the rows')
    i = alpha_beta(values[: len(current)], given.phases)
    u = alpha_beta(values[len(current) : len(current) + len(voltage)], given.phases)
    samples = np.column_stack([*i, *u])
    if given.speed:
        values[-1] *= SPEEDS[given.speed_unit]
        said = hint(values[-1], u, stamps)
        if said:
            print(f'hint: {said}', file=sys.stderr)
    with BagWriter(given.bag) as bag:
        bag.add_topic(SAMPLES, drive_samples.TYPE)
        if given.speed:
            bag.add_topic(TRUTH, joint_state.TYPE)
        encoder = joint_state.Encoder()
        for first in range(0, len(stamps), given.batch):
            rows = slice(first, first + given.batch)
            at = int(stamps[rows][-1])
            bag.write(SAMPLES, at, drive_samples.encode(stamps[rows], samples[rows]))
            if given.speed:
                for stamp, speed in zip(stamps[rows].tolist(), values[-1][rows].tolist()):
                    raw = encoder.encode(stamp, '', [given.joint], [float('nan')], [speed], [])
                    bag.write(TRUTH, at, raw)
    rate = 1e9 * (len(stamps) - 1) / float(stamps[-1] - stamps[0])
    return f'{given.bag}: {len(stamps)} samples at {rate:.0f} Hz, {given.batch} in a message'


def to_csv(given: argparse.Namespace) -> str:
    """Write the phases of a bag's samples, and the true speed of its motor if it has one."""
    with open_bag(given.bag) as bag:
        bag.require(SAMPLES)
        batches = [drive_samples.decode(bytes(each.raw)) for each in bag.messages([SAMPLES])]
        truth = joint_series(bag, TRUTH).get(given.joint) if TRUTH in bag.topics else None
    stamps = np.concatenate([batch.stamps_ns for batch in batches])
    i_alpha, i_beta, u_alpha, u_beta = np.concatenate([batch.values for batch in batches]).T
    names, table = ['time_s'], [(stamps - stamps[0]) * 1e-9]
    for letter, alpha, beta in (('i', i_alpha, i_beta), ('u', u_alpha, u_beta)):
        names += [f'{letter}_{phase}' for phase in 'abc']
        side = 0.5 * np.sqrt(3.0) * beta
        table += [alpha, -0.5 * alpha + side, -0.5 * alpha - side]
    if truth is not None:
        names.append('speed_rad_s')
        table.append(np.interp(stamps, truth.stamps_ns, truth.velocity))
    with given.log.open('w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([f'{value:.9g}' for value in row] for row in zip(*table))
    return f'{given.log}: {len(stamps)} rows, columns {", ".join(names)}'


def main() -> int:
    """Run the script; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    commands = parser.add_subparsers(required=True)
    into = commands.add_parser('to-bag', help='CSV to a bag')
    into.add_argument('log', type=Path)
    into.add_argument('bag', type=Path)
    into.add_argument('--time', required=True, metavar='COLUMN')
    into.add_argument('--time-unit', default='s', choices=UNITS)
    into.add_argument('--current', required=True, metavar='COLUMNS', help='[A]')
    into.add_argument('--voltage', required=True, metavar='COLUMNS', help='phase voltages [V]')
    into.add_argument('--phases', action='store_true', help='two columns are the phases a and b')
    into.add_argument('--speed', metavar='COLUMN', help='measured, mechanical: the truth')
    into.add_argument('--speed-unit', default='rad/s', choices=SPEEDS)
    into.add_argument('--batch', type=int, default=200, help='samples in a message (200)')
    into.set_defaults(run=to_bag)
    out = commands.add_parser('to-csv', help='a bag to CSV')
    out.add_argument('bag', type=Path)
    out.add_argument('log', type=Path)
    out.set_defaults(run=to_csv)
    for command in (into, out):
        command.add_argument('--joint', default='motor', help='name of the motor in the truth')
    given = parser.parse_args()
    try:
        print(given.run(given))
    except (UserError, OSError) as error:
        print(f'{parser.prog}: {error}', file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
