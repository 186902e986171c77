# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The live table of the demo: that of `watch`, and the truth; plain lines without a terminal."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from estimator_pkg.nodes.watching import Joint
from estimator_pkg.watch import Screen, table
from sim_pkg.demo.listener import Snapshot

BARS = ' ▁▂▃▄▅▆▇█'
TRACE = 36  # columns of the traces, one per frame
FRAME = 0.1  # time between two frames of the table [s]
ERROR_SPAN = 1.0  # full scale of the error traces [rad/s]


class Display(Screen):
    """Shows snapshots; used as a context manager."""

    def __init__(self, console: Console | None = None) -> None:
        super().__init__(console)
        self._past: deque[Snapshot] = deque(maxlen=TRACE)

    def frame(self, moment: Snapshot, joints: Mapping[str, Joint]) -> None:
        """Show a snapshot, and what the observer reports of its joints."""
        self._past.append(moment)
        self.show(self._table(moment, joints), line(moment))

    def _table(self, moment: Snapshot, joints: Mapping[str, Joint]) -> Group:
        span = max(1.0, *(abs(each.true_velocity) for each in (moment, *self._past)))
        compared = Table(box=None, pad_edge=False)
        compared.add_column('')
        compared.add_column('now, rad/s', justify='right', width=10)
        compared.add_column(f'last {TRACE * FRAME:.0f} s', width=TRACE)
        compared.add_column('')
        compared.add_row(
            'true velocity',
            f'{moment.true_velocity:+.3f}',
            sparkline((each.true_velocity for each in self._past), span),
            f'+-{span:.0f}',
        )
        for name, now, errors, style in (
            ('difference', moment.difference, (e.difference_error for e in self._past), ''),
            ('estimate', moment.velocity, (e.error for e in self._past), 'bold green'),
        ):
            bars = sparkline(errors, ERROR_SPAN)
            compared.add_row(
                name, _shown(now, '+.3f'), bars, f'error +-{ERROR_SPAN:.0f}', style=style
            )
        compared.add_row('  its error', f'{moment.error:+.3f}')
        return Group(
            Text(f't {moment.seconds:.1f} s, {moment.messages} estimates\n', style='dim'),
            table(joints),
            Text(),
            compared,
        )


def line(moment: Snapshot) -> str:
    """Return a snapshot in one line."""
    return (
        f't {moment.seconds:5.2f} s  angle {moment.angle:+.4f} rad  '
        f'true {moment.true_velocity:+8.3f}  finite difference '
        f'{_shown(moment.difference, "+8.3f")}  estimate {moment.velocity:+8.3f} '
        f'+- {_shown(moment.stddev, ".3f")}  error {moment.error:+.3f} rad/s'
    )


def _shown(value: float, form: str) -> str:
    """Return a number in the table's format; a dash if it is not known (yet)."""
    return format(value, form) if math.isfinite(value) else '-'


def sparkline(values: Iterable[float], span: float) -> str:
    """Return values in [-span, span] as one line of bars; nan is a blank."""
    most = len(BARS) - 1
    return ''.join(
        BARS[round(min(max(0.5 + 0.5 * value / span, 0.0), 1.0) * most)] if value == value else ' '
        for value in values
    )
