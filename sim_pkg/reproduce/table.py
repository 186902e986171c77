# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The printed table of a reproduction: our values beside their references."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from estimator_pkg.printable import terminal
from sim_pkg.reproduce.contract import Row

NARROW, WIDE = 80, 160  # columns


def number(value: float) -> str:
    """Return a number as text for the tables: at most five digits."""
    if not math.isfinite(value):
        return str(value)
    if value == int(value) and abs(value) < 1e6:
        return f'{int(value)}'
    return f'{value:.5g}' if abs(value) >= 1e-4 else f'{value:.2e}'


def show(rows: Sequence[Row], console: Console | None = None, wide: bool = False) -> None:
    """Print the checks against our own numbers, and how many are within their tolerance.

    Parameters
    ----------
    wide : 160 columns, with what the paper prints.
    """
    console = console or Console(file=terminal(sys.stdout))
    console = Console(
        file=console.file, width=WIDE if wide else NARROW, force_terminal=console.is_terminal
    )
    table = Table(box=None, pad_edge=False, header_style='bold')
    table.add_column('check', no_wrap=wide, overflow='fold')
    for heading in ('ours', 'independent', 'tolerance'):
        table.add_column(heading, justify='right', no_wrap=True)
    if wide:
        table.add_column('paper', overflow='fold', min_width=7)
    table.add_column('ok', no_wrap=True)
    for row in rows:
        reference, paper = row.reference, row.reference.paper
        printed = '' if paper is None else paper if isinstance(paper, str) else number(paper)
        table.add_row(
            Text(reference.id),
            number(row.value),
            number(reference.value),
            reference.tolerance_text,
            *([printed] if wide else []),
            Text('yes', 'green') if row.ok else Text('NO', 'bold red'),
        )
    console.print(table)
    failed = [row for row in rows if not row.ok]
    console.print(
        f'{len(rows) - len(failed)} of {len(rows)} checks against our own independent numbers '
        'are within tolerance',
        highlight=False,
    )
    for row in failed:
        console.print(
            f'failed: {row.reference.id} ({row.reference.what})', highlight=False, markup=False
        )
