# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid continuous-discrete paper: its example and Figures 2 to 4."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim_pkg.reproduce.contract import Reproduction, Table, Values, parts
from sim_pkg.reproduce.hybrid_discrete.runs import example, plant

STEP, EVENTS = 1e-4, 10  # [s]; of 0.5 s each
WHAT = ('zeta2', 'theta1', 'zeta4', 'theta2')
RUNS: dict[str, dict[str, Any]] = {
    'reset (24)': {'reset': 'states'},
    'no reset': {'reset': 'none'},
    'forward Euler': {'reset': 'states', 'form': 'explicit'},
}


def vector_values() -> Values:
    """Test vectors of the example: x and Z at 2 s and at 10 s."""
    _, _, states, z = plant(1e-3)
    for t in (2, 10):
        for name, row in (('x', states[1000 * t]), ('z', z[1000 * t])):
            for j, value in enumerate(row):
                yield f'vector {t} s {name}{j + 1}', value


def run_values() -> Values:
    """Times of convergence [ms] and final errors of each run."""
    for name, changes in RUNS.items():
        run = example(STEP, EVENTS, **changes)
        for what, value in zip(WHAT, run.settling(0, 0, STEP)):
            yield f'run start {what} {name}', 1e3 * value
        for what, value in zip(WHAT, run.settling(3, EVENTS - 1, STEP)):
            yield f'run event {what} {name}', 1e3 * value
        late = np.abs(run.state_error[round(1.0 / STEP) :]).max(axis=0)
        yield f'run final x2 {name}', late[1]
        yield f'run final x4 {name}', late[3]
        yield f'run final Z k=2 {name}', run.discrete_error[2]
        yield f'run final Z k>2 {name}', run.discrete_error[3:].max()


def _table(title: str, columns: dict[str, str]) -> Table:
    body = {name: [f'run {stem} {name}' for stem in columns.values()] for name in RUNS}
    return Table(title, tuple(columns), body)


FINAL = {'x2': 'final x2', 'x4': 'final x4', 'Z k=2': 'final Z k=2', 'Z k>2': 'final Z k>2'}

REPRODUCTION = Reproduction(
    name='hybrid_discrete',
    summary='Barbot, Djemai, Manamanni: State observer and observability conditions for a class '
    'of hybrid continuous-discrete dynamic system (2007)',
    parts=parts('hybrid_discrete', {'vector': vector_values, 'run': run_values}),
    tables=(
        _table(
            'Convergence in the first interval [ms]; (26) claims less than the period, 500',
            {what: f'start {what}' for what in WHAT},
        ),
        _table(
            'Worst convergence after an event, intervals 3 to 9 [ms]',
            {what: f'event {what}' for what in WHAT},
        ),
        _table('Figures 2 to 4: largest errors from 1 s on; of Z at and after event 2', FINAL),
    ),
    figures='sim_pkg.reproduce.hybrid_discrete.figures',
    reasons=(
        (
            r'.*no reset',
            'without the reset (24) the velocities are wrong after each event: this shows that '
            'the paper needs it',
        ),
        (
            r'.*forward Euler',
            'the paper names no way to sample: by forward Euler the second stage differentiates '
            'the chatter of the first; the observer uses the implicit form',
        ),
    ),
    notes=(
        'The paper prints no gains, start values or results as numbers: ours are L = 120, 400 and '
        '60, 150, epsilon = 1e-3, start 1, .5, .5, 0, steps of 0.1 ms.',
        'Meaning of each row, misprints and findings: docs/papers/hybrid_discrete.md',
    ),
)
