# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables 1, 2, 5, 6 and 7 in the paper's layout, our results next to the printed numbers."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from estimator_pkg.observers.mechanism.state import Coefficients
from sim_pkg.reproduce.claims import agrees
from sim_pkg.reproduce.contract import Row
from sim_pkg.reproduce.mechanical.cart import cart_of
from sim_pkg.reproduce.mechanical.runs import METRICS, make
from sim_pkg.reproduce.table import number

PRINTED_7 = {'GESO': 466.0, 'SMO-BL': 551.0, 'EHGO-BL': 472.0}  # us on an Arduino Nano
OURS_7: dict[str, tuple[str, dict[str, Any]]] = {
    'GESO': ('geso', {'L': [10.0], 'Gamma': [70.0]}),
    'SMO-BL': ('smo', {'mu': [29.0, 10.0]}),
    'EHGO-BL': ('ehgo', {'h': [5.0, 5.0, 4.0], 'epsilon': 0.0126}),
}
STEPS, REPEATS = 400, 5
WIDTH = 80
LEGEND = 'ours, and in brackets what the paper prints; * does not agree with it'


def lines(rows: Sequence[Row]) -> list[str]:
    """Return, as lines, the tables whose entries are all in `rows`."""
    found = {row.reference.id: row for row in rows}
    first = [
        f'{name}{joint}{unit}' for joint in (1, 2) for name, unit in (('ME', 'e2'), ('MSE', 'e4'))
    ]
    three = ['ME1e2', 'MSE1e4', 'ME2e2']
    plans: list[tuple[str, list[str], dict[str, list[str]]]] = [
        (
            'Table 1: cart-pendulum, simulated (20 seeds)',
            first,
            {name: [f'B4.{name}.{metric}' for metric in first] for name in ('HGO', 'SMO', 'GESO')},
        ),
        (
            'Table 2: robotic leg, simulated (median of 20 seeds)',
            list(METRICS),
            {
                name: [f'C3.{name}.{metric}' for metric in METRICS]
                for name in ('HGO', 'SMO', 'GESO')
            },
        ),
    ]
    for kind in ('nominal', 'mismatch'):
        for scenario, words in (('HPM', 'high'), ('LPM', 'low')):
            plans.append(
                (
                    f'Table 5: open loop, {words}-precision measurements, {kind} plant',
                    three,
                    {
                        name: [f'D3.{kind}.{scenario}.{name}.{metric}' for metric in three]
                        for name in ('GESO', 'SMO-BL', 'EHGO-BL', 'SMO-CV', 'EHGO-CV')
                    },
                )
            )
    for scenario, words, names in (('HPM', 'high', ('GESO', 'SMO-BL')), ('LPM', 'low', ('GESO',))):
        plans.append(
            (
                f'Table 6: closed loop, {words}-precision measurements',
                ['mean|q1|e2', 'mean q1^2 e4'],
                {name: [f'E2.{name}.{scenario}', f'E3.{name}.{scenario}'] for name in names},
            )
        )
    out: list[str] = []
    for title, columns, body in plans:
        if all(name in found for names in body.values() for name in names):
            out += [
                '',
                *_table(
                    title,
                    columns,
                    {name: [_entry(found[each]) for each in names] for name, names in body.items()},
                ),
            ]
    if out:
        out += ['', *table_7()]
    return ['', LEGEND, *out, ''] if out else out


def _entry(row: Row) -> str:
    paper = row.reference.paper
    printed = paper if isinstance(paper, str) else number(paper) if paper is not None else '-'
    return f'{row.value:.4g} ({printed})' + ('' if agrees(row, []) else ' *')


def _table(title: str, columns: list[str], body: dict[str, list[str]]) -> list[str]:
    """Return a table as lines; one of more than 80 columns in two halves."""
    cells = [['', *columns], *([name, *entries] for name, entries in body.items())]
    widths = [max(len(row[k]) for row in cells) for k in range(len(cells[0]))]
    if sum(widths) + 2 * len(widths) > WIDTH:
        half = (len(columns) + 1) // 2
        return [
            *_table(title, columns[:half], {name: each[:half] for name, each in body.items()}),
            *_table('', columns[half:], {name: each[half:] for name, each in body.items()}),
        ]
    return [title] * bool(title) + [
        '  ' + '  '.join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip()
        for row in cells
    ]


def costs() -> dict[str, float]:
    """Return the time of one forward Euler step of each observer, plain Python, best of 5 [s]."""
    found = {}
    for name, (observer, gains) in OURS_7.items():
        plan = make(observer, 'cart_pendulum', cart_of(), **gains)
        state, coefficients, module = plan.state(), Coefficients(), plan.module
        module.prepare(coefficients, plan.design, 1e-3)
        state.before[:2], state.work.moved[:2] = (0.1, 0.2), (1e-3, 1e-3)
        given = state, coefficients, plan.design, [0.1, 0.2], [0.1]
        times = []
        for _ in range(REPEATS):
            begun = time.perf_counter()
            for _ in range(STEPS):
                module.advance(module.model, *given)
            times.append((time.perf_counter() - begun) / STEPS)
        found[name] = min(times)
    return found


def table_7() -> list[str]:
    """Cost of a step relative to GESO's."""
    ours = costs()
    body = {
        'relative cost': [
            f'{ours[name] / ours["GESO"]:.2f} ({PRINTED_7[name] / PRINTED_7["GESO"]:.2f})'
            for name in ours
        ]
    }
    return _table('Table 7: one forward Euler step, GESO = 1', list(ours), body)
