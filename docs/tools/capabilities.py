# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Cost and delay of every observer, for the capability matrix of the documentation.

    python -m docs.tools.capabilities docs/choosing.md

simulates a recording for each kind of observer, runs all observers on it, prints the results, and
writes cost and delay into the last two columns of the matrix in the named file.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.cli import main as command
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.compare.matching import match
from estimator_pkg.evaluation.compare.sources import measured, recording
from estimator_pkg.evaluation.compare.truth import truth
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.text import markdown, number

ROUNDS = 2  # the fastest counts
SETTLED = 0.3  # fraction of a recording that is ignored at its beginning
LINE = re.compile(r'^\| \[(\w+)\].*\|$')
HEADER = ('observer', 'microseconds per sample', 'delay [ms]', 'rms error [rad/s]', 'recording')


class Case(NamedTuple):
    """Observers and the recording they run on.

    plant : simulator; simulated : its parameters. values : parameters of the observers.
    """

    observers: tuple[str, ...]
    plant: str
    seconds: float
    simulated: tuple[str, ...]
    values: tuple[tuple[str, Any], ...]
    words: str


JOINT = (('model_parameters', ['inertia=0.05', 'damping=0.02', 'gravity=1.5', 'coulomb=0.05']),)
MOTOR = (('resistance', 0.06), ('inductance', 3.375e-05), ('flux', 0.0019), ('pole_pairs', 7))
CASES = (
    Case(
        ('edge_adaptive', 'hybrid_angle', 'kalman', 'pll', 'finite_difference', 'super_twisting'),
        'encoder',
        10.0,
        ('amplitude=0.3979', 'frequency=2.0'),
        (),
        'sine of 5 rad/s at 2 Hz, 4096 counts, 1 kHz',
    ),
    Case(
        ('geso', 'hgo', 'ehgo', 'smo'),
        'pendulum',
        10.0,
        (),
        JOINT,
        'driven pendulum, known model, 4096 counts, 500 Hz',
    ),
    Case(
        ('adaptive',),
        'dc_motor',
        30.0,
        (),
        (),
        'servo motor, parameters learnt, 4096 counts, 1 kHz',
    ),
    Case(('pmsm',), 'pmsm', 2.0, (), MOTOR, 'drive at 20 kHz, no encoder'),
    Case(('switched',), 'gripper', 10.0, (), (), 'joint whose load changes, 65536 counts, 1 kHz'),
)


class Result(NamedTuple):
    """Cost of one observer [us per sample], its delay [s] and rms error [rad/s]."""

    observer: str
    cost: float
    delay: float
    error: float
    words: str


def measure(case: Case, folder: Path) -> list[Result]:
    """Run every observer of a case at its defaults, with the plant's parameters."""
    path = folder / case.plant
    words = ['simulate', case.plant, '--out', str(path), '--duration', str(case.seconds)]
    for each in case.simulated:
        words += ['--set', each]
    with contextlib.redirect_stdout(io.StringIO()):
        if command(words) != 0:
            raise SystemExit(1)
    found = []
    with open_bag(str(path)) as bag:
        options = Options()
        series = measured(bag, options)
        true = truth(bag, str(path), series, options)
        for observer in case.observers:
            record = recording(Entry(observer, observer, case.values), bag, series, options)
            times = []
            for _ in range(ROUNDS):
                start = time.process_time()
                estimates = record.run(observer, {})
                times.append(time.process_time() - start)
            joint = next(name for name in estimates if name in true.series)
            estimate, known = estimates[joint], true.series[joint]
            met = match(
                estimate.stamps, known.stamps_ns, known.velocity, known.position, 2.0 * np.pi
            )
            settled = met.time >= SETTLED * case.seconds
            errors = metrics.velocity(
                met.time[settled], estimate.velocity[met.rows][settled], met.velocity[settled], 0.0
            )
            found.append(
                Result(
                    observer,
                    min(times) / estimate.samples['received'] * 1e6,
                    errors['delay_s'],
                    errors['rms'],
                    case.words,
                )
            )
    return found


def filled(text: str, results: list[Result]) -> str:
    """Return the page with the last two cells of each observer's row measured."""
    known = {each.observer: each for each in results}
    lines = text.split('\n')
    for i, line in enumerate(lines):
        row = LINE.match(line)
        if row and row.group(1) in known:
            result = known[row.group(1)]
            cells = line.split('|')
            late = round(result.delay * 1e3, 1) + 0.0  # avoids -0.0
            cells[-3:-1] = [f' {number(result.cost, 2)} ', f' {late} ']
            lines[i] = '|'.join(cells)
    return '\n'.join(lines)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('page', type=Path, nargs='?', help='Markdown file with the matrix')
    page = parser.parse_args().page
    with tempfile.TemporaryDirectory() as folder:
        results = [result for case in CASES for result in measure(case, Path(folder))]
    print(
        markdown(
            HEADER,
            [
                (
                    each.observer,
                    number(each.cost, 2),
                    f'{each.delay * 1e3:.2f}',
                    number(each.error, 3),
                    each.words,
                )
                for each in results
            ],
        )
    )
    if page:
        page.write_text(filled(page.read_text(), results))


if __name__ == '__main__':
    main()
