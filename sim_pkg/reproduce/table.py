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

PLAIN_WIDTH = 160  # columns if the output is not a terminal


def number(value: float) -> str:
    """Return a number as text for the tables: at most five digits."""
    if not math.isfinite(value):
        return str(value)
    if value == int(value) and abs(value) < 1e6:
        return f'{int(value)}'
    return f'{value:.5g}' if abs(value) >= 1e-4 else f'{value:.2e}'


def show(rows: Sequence[Row], console: Console | None = None) -> None:
    """Print the table and a line with the number of rows within their tolerance."""
    console = console or Console(file=terminal(sys.stdout))
    if not console.is_terminal:
        console = Console(file=console.file, width=PLAIN_WIDTH)
    table = Table(box=None, pad_edge=False, header_style='bold')
    table.add_column('row', no_wrap=True)
    for heading in ('ours', 'reference', 'tolerance'):
        table.add_column(heading, justify='right', no_wrap=True)
    table.add_column('paper', overflow='fold', min_width=7)
    table.add_column('ok', no_wrap=True)
    for row in rows:
        reference = row.reference
        paper = reference.paper
        table.add_row(
            Text(reference.id),
            number(row.value),
            number(reference.value),
            reference.tolerance_text,
            '' if paper is None else paper if isinstance(paper, str) else number(paper),
            Text('yes', 'green') if row.ok else Text('NO', 'bold red'),
        )
    console.print(table)
    failed = [row for row in rows if not row.ok]
    console.print(
        f'{len(rows) - len(failed)} of {len(rows)} rows within their tolerance', highlight=False
    )
    for row in failed:
        console.print(
            f'failed: {row.reference.id} ({row.reference.what})', highlight=False, markup=False
        )
