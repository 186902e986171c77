# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The live table of the demo: that of `watch`, and the truth; plain lines without a terminal."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from estimator_pkg.nodes.watching import Joint
from estimator_pkg.printable import printable
from estimator_pkg.watch import Screen, table
from sim_pkg.demo.listener import Snapshot

BARS = ' ▁▂▃▄▅▆▇█'
TRACE = 36  # columns of the traces, one per frame
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
        self._screen = Screen(0.0, console)
        self._title = printable(title)
        self._traces = {
            name: deque([0.0] * TRACE, maxlen=TRACE) for name in ('truth', 'difference', 'error')
        }
        self._next_line = 0.0

    def __enter__(self) -> Display:
        self._screen.__enter__()
        self._screen.show(self._waiting(), lambda: self._title)
        return self

    def __exit__(self, *problem: object) -> None:
        self._screen.__exit__(*problem)

    def show(self, moment: Snapshot, joints: Mapping[str, Joint] | None = None) -> None:
        """Show this snapshot; without a terminal at most about one per second.

        Parameters
        ----------
        joints : what the observer says of its joints, see `estimator_pkg.nodes.watching`.
        """
        if self._screen.moves:
            self._traces['truth'].append(moment.true_velocity)
            self._traces['difference'].append(moment.finite_difference - moment.true_velocity)
            self._traces['error'].append(moment.error)
        elif moment.seconds < self._next_line:
            return
        self._next_line = moment.seconds + LINE_PERIOD
        self._screen.show(self._table(moment, joints or {}), lambda: line(moment))

    def _waiting(self) -> Text:
        return Text(f'{self._title}\nwaiting for the first estimate ...')

    def _table(self, moment: Snapshot, joints: Mapping[str, Joint]) -> Group:
        span = max(1.0, *(abs(value) for value in self._traces['truth']))
        compared = Table(box=None, pad_edge=False)
        compared.add_column('')
        compared.add_column('now, rad/s', justify='right', width=10)
        compared.add_column(f'last {TRACE * FRAME:.0f} s', width=TRACE)
        compared.add_column('')
        for name, now, trace in (
            ('true velocity', f'{moment.true_velocity:+.3f}', 'truth'),
            ('difference', _shown(moment.finite_difference, '+.3f'), 'difference'),
            ('estimate', f'{moment.velocity:+.3f}', 'error'),
            ('  its error', f'{moment.error:+.3f}', ''),
        ):
            full = span if trace == 'truth' else ERROR_SPAN
            compared.add_row(
                name,
                now,
                sparkline(self._traces[trace], full) if trace else '',
                f'{"" if trace == "truth" else "error "}+-{full:.0f}' if trace else '',
                style='bold green' if name == 'estimate' else '',
            )
        return Group(
            Text(self._title, style='bold', no_wrap=True),
            Text(f't {moment.seconds:.1f} s, {moment.messages} estimates', style='dim'),
            Text(f'\n{table(joints)}\n' if joints else '', no_wrap=True),
            compared,
        )


def line(moment: Snapshot) -> str:
    """Return a snapshot in one line."""
    return (
        f't {moment.seconds:5.2f} s  angle {moment.angle:+.4f} rad  '
        f'true {moment.true_velocity:+8.3f}  finite difference '
        f'{_shown(moment.finite_difference, "+8.3f")}  estimate {moment.velocity:+8.3f} '
        f'+- {_shown(moment.stddev, ".3f")}  error {moment.error:+.3f} rad/s'
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
