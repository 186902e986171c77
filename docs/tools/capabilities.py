# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Cost and delay of every observer, for the capability matrix of the documentation.

    python -m docs.tools.capabilities docs/choosing.md

simulates a recording for each kind of observer, runs all observers on it, prints the results, and
writes cost and delay into the last two columns of the matrix in the named file.
"""

from __future__ import annotations

import contextlib
import io
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.cli import main as command
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.compare.sources import measured, recording
from estimator_pkg.evaluation.compare.truth import truth
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.text import markdown, number

ROUNDS = 2  # the fastest counts
SETTLED = 0.3  # fraction of a recording that is ignored at its beginning
LINE = re.compile(r'^\| \[(\w+)\].*\|$')
HEADER = ('observer', 'microseconds per sample', 'delay [ms]', 'rms error [rad/s]')


class Case(NamedTuple):
    """Observers and the simulated recording on which they run, with their parameters."""

    observers: str
    simulated: str
    values: dict[str, Any]


JOINT = {'model_parameters': ['inertia=0.05', 'damping=0.02', 'gravity=1.5', 'coulomb=0.05']}
MOTOR = {'resistance': 0.06, 'inductance': 3.375e-05, 'flux': 0.0019, 'pole_pairs': 7}
ANGLE = 'edge_adaptive hybrid_angle kalman pll finite_difference super_twisting'
CASES = (
    Case(ANGLE, 'encoder --duration 10 --set amplitude=0.3979 --set frequency=2.0', {}),
    Case('geso hgo ehgo smo', 'pendulum --duration 10', JOINT),
    Case('adaptive', 'dc_motor --duration 30', {}),
    Case('pmsm', 'pmsm --duration 2', MOTOR),
    Case('switched', 'gripper --duration 10', {}),
    Case('wheel_odometry', 'base --duration 20', {'radius': [0.1], 'track': 0.5}),
)


class Result(NamedTuple):
    """Cost of one observer [us per sample], its delay [s] and rms error [rad/s]."""

    observer: str
    cost: float
    delay: float
    error: float


def measure(case: Case, path: Path) -> list[Result]:
    """Run every observer of a case at its defaults, with the plant's parameters."""
    with contextlib.redirect_stdout(io.StringIO()):
        if command(['simulate', *case.simulated.split(), '--out', str(path)]) != 0:
            raise SystemExit(1)
    found = []
    with open_bag(str(path)) as bag:
        options = Options()
        series = measured(bag, options)
        true = truth(bag, str(path), series, options)
        for observer in case.observers.split():
            entry = Entry(observer, observer, tuple(case.values.items()))
            record, times = recording(entry, bag, series, options), []
            for _ in range(ROUNDS):
                start = time.process_time()
                estimates = record.run(observer, {})
                times.append(time.process_time() - start)
            joint = next(name for name in estimates if name in true.series)
            made, known = estimates[joint], true.series[joint]
            met = match(made.stamps, known.stamps_ns, known.velocity, known.position, 2.0 * np.pi)
            late = met.time >= SETTLED * met.time[-1]
            errors = metrics.velocity(
                met.time[late], made.velocity[met.rows][late], met.velocity[late], 0.0
            )
            cost = min(times) / made.samples['received'] * 1e6
            found.append(Result(observer, cost, errors['delay_s'], errors['rms']))
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


def main(words: Sequence[str]) -> None:
    """Measure all; print it, and write it into the page that is named."""
    with tempfile.TemporaryDirectory() as folder:
        found = [
            each for k, case in enumerate(CASES) for each in measure(case, Path(folder) / str(k))
        ]
    lines = [
        (name, number(cost, 2), f'{delay * 1e3:.2f}', number(error, 3))
        for name, cost, delay, error in found
    ]
    print(markdown(HEADER, lines))
    for page in map(Path, words):
        page.write_text(filled(page.read_text(), found))


if __name__ == '__main__':
    main(sys.argv[1:])
