# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid continuous-discrete paper: its example and Figures 2 to 4."""

from __future__ import annotations

import numpy as np

from sim_pkg.reproduce.contract import Reproduction, Values
from sim_pkg.reproduce.hybrid_discrete.runs import example

STEP, EVENTS = 1e-4, 10  # [s]; of 0.5 s each
WHAT = ('zeta2', 'theta1', 'zeta4', 'theta2')
RESET = 'reset (24)'


def run_values() -> Values:
    """Times of convergence [ms] and final errors."""
    run = example(STEP, EVENTS)
    for stem, first, last in (('start', 0, 0), ('event', 3, EVENTS - 1)):
        for what, value in zip(WHAT, run.settling(first, last, STEP)):
            yield f'run {stem} {what} {RESET}', 1e3 * value
    late = np.abs(run.state_error[round(1.0 / STEP) :]).max(axis=0)
    yield f'run final x2 {RESET}', late[1]
    yield f'run final x4 {RESET}', late[3]
    yield f'run final Z k=2 {RESET}', run.discrete_error[2]
    yield f'run final Z k>2 {RESET}', run.discrete_error[3:].max()


REPRODUCTION = Reproduction(
    name='hybrid_discrete',
    summary='Barbot, Djemai, Manamanni: State observer and observability conditions for a class '
    'of hybrid continuous-discrete dynamic system (2007)',
    parts={
        'run': (
            'Figures 2 to 4. start: time of convergence [ms], of which (26) claims less than the '
            'period, 500; event: the worst one after an event, intervals 3 to 9 [ms]; final: '
            'largest errors from 1 s on, of Z at and after event 2',
            run_values,
        )
    },
    notes=(
        'The paper prints no gains, start values or results as numbers: ours are L = 120, 400 and '
        '60, 150, epsilon = 1e-3, start 1, .5, .5, 0, steps of 0.1 ms.',
        'Meaning of each row, misprints and findings: docs/papers/hybrid_discrete.md',
    ),
)
