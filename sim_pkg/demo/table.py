# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The live table of the demo: a terminal table, or plain lines without a terminal."""

from __future__ import annotations

import math
import sys
from collections import deque

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from estimator_pkg.printable import printable, terminal
from sim_pkg.demo.listener import Snapshot

BARS = ' ▁▂▃▄▅▆▇█'
TRACE = 40  # columns of the traces, one per frame
FRAME = 0.1  # time between two frames of the table [s]
ERROR_SPAN = 1.0  # full scale of the error traces [rad/s]
LINE_PERIOD = 1.0  # time between lines without a terminal [s]


class Display:
    """Shows snapshots; used as a context manager.

    Parameters
    ----------
    title : one line above the table.
    """

    def __init__(self, title: str, console: Console | None = None) -> None:
        self._console = console or Console(file=terminal(sys.stdout))
        self._title = printable(title)
        self._live: Live | None = None
        self._traces = {
            name: deque([0.0] * TRACE, maxlen=TRACE) for name in ('truth', 'difference', 'error')
        }
        self._next_line = 0.0

    def __enter__(self) -> Display:
        if self._console.is_terminal:
            self._live = Live(self._waiting(), console=self._console, auto_refresh=False)
            self._live.start()
        else:
            self._console.print(self._title, highlight=False, soft_wrap=True)
        return self

    def __exit__(self, *problem: object) -> None:
        if self._live:
            self._live.stop()

    def show(self, moment: Snapshot) -> None:
        """Show this snapshot; without a terminal at most about one per second."""
        if self._live:
            self._traces['truth'].append(moment.true_velocity)
            self._traces['difference'].append(moment.finite_difference - moment.true_velocity)
            self._traces['error'].append(moment.error)
            self._live.update(self._table(moment), refresh=True)
        elif moment.seconds >= self._next_line:
            self._next_line = moment.seconds + LINE_PERIOD
            self._console.print(
                f't {moment.seconds:5.2f} s  angle {moment.angle:+.4f} rad  '
                f'true {moment.true_velocity:+8.3f}  finite difference '
                f'{_shown(moment.finite_difference, "+8.3f")}  estimate {moment.velocity:+8.3f} '
                f'+- {_shown(moment.stddev, ".3f")}  error {moment.error:+.3f} rad/s',
                highlight=False,
                soft_wrap=True,
            )

    def _waiting(self) -> Text:
        return Text(f'{self._title}\nwaiting for the first estimate ...')

    def _table(self, moment: Snapshot) -> Group:
        span = max(1.0, *(abs(value) for value in self._traces['truth']))
        table = Table(box=None, pad_edge=False)
        table.add_column('')
        table.add_column('now', justify='right', width=10)
        table.add_column('unit')
        table.add_column(f'last {TRACE * FRAME:.0f} s')
        table.add_column('full scale')
        rows = [
            ('measured angle', f'{moment.angle:+.4f}', 'rad', '', ''),
            (
                'true velocity',
                f'{moment.true_velocity:+.3f}',
                'rad/s',
                sparkline(self._traces['truth'], span),
                f'+-{span:.0f} rad/s',
            ),
            (
                'finite difference',
                _shown(moment.finite_difference, '+.3f'),
                'rad/s',
                sparkline(self._traces['difference'], ERROR_SPAN),
                f'error, +-{ERROR_SPAN:g} rad/s',
            ),
            (
                'estimate',
                f'{moment.velocity:+.3f}',
                'rad/s',
                sparkline(self._traces['error'], ERROR_SPAN),
                f'error, +-{ERROR_SPAN:g} rad/s',
            ),
            ('  standard deviation', _shown(moment.stddev, '.3f'), 'rad/s', '', ''),
            ('  error', f'{moment.error:+.3f}', 'rad/s', '', ''),
        ]
        for row in rows:
            style = 'bold green' if row[0] == 'estimate' else ''
            table.add_row(*row, style=style)
        return Group(
            Text(self._title, style='bold'),
            Text(f't {moment.seconds:.1f} s, {moment.messages} estimates', style='dim'),
            table,
        )


def _shown(value: float, form: str) -> str:
    """Return a number in the table's format; a dash if it is not known (yet)."""
    return format(value, form) if math.isfinite(value) else '-'


def sparkline(values: deque[float], span: float) -> str:
    """Return values in [-span, span] as one line of bars; nan is a blank."""
    marks = []
    for value in values:
        if not math.isfinite(value):
            marks.append(' ')
            continue
        part = min(max(0.5 + 0.5 * value / span, 0.0), 1.0)
        marks.append(BARS[round(part * (len(BARS) - 1))])
    return ''.join(marks)
