# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator watch``: what a running observer estimates, as a live table."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.printable import printable, show, terminal

if TYPE_CHECKING:
    from rich.console import Group

    from estimator_pkg.bags.live import Live
    from estimator_pkg.nodes.watching import Joint, Watching

WIDTH = 80
APPEAR = 5.0  # longest wait for an observer [s]
FRAME = 0.2  # time between two frames [s]
LINES = 1.0  # time between two tables without a terminal [s]
SILENT = 1.5  # a longer silence is shown [s]
COLUMNS = (  # and a space between them: 80
    ('joint', 15, 'left'),
    ('position', 11, 'right'),
    ('velocity', 11, 'right'),
    ('95 % +-', 9, 'right'),
    ('state', 13, 'left'),
    ('rate Hz', 7, 'right'),
    ('dropped', 8, 'right'),
)


class Screen:
    """Shows changing text: in place on a terminal, as lines elsewhere; a context manager."""

    def __init__(self, console: Any = None) -> None:
        from rich.console import Console
        from rich.live import Live as RichLive

        out = terminal(sys.stdout)
        width = None if out.isatty() else WIDTH
        self.console = console or Console(file=out, width=width, markup=False, highlight=False)
        self._live = RichLive(console=self.console, auto_refresh=False)
        self.moves = self.console.is_terminal  # a text replaces the one before
        self._next = -math.inf

    def __enter__(self) -> Screen:
        if self.moves:
            self._live.start()
        return self

    def __exit__(self, *problem: object) -> None:
        if self.moves:
            self._live.stop()

    def show(self, picture: Any, plain: str = '') -> None:
        """Show a picture of rich; without a terminal it or `plain`, about once a second."""
        now = time.monotonic()
        if self.moves:
            self._live.update(picture, refresh=True)
        elif now >= self._next:
            self._next = now + LINES
            self.console.print(plain or picture, soft_wrap=bool(plain))
            self.console.file.flush()


def table(joints: Mapping[str, Joint]) -> Group:
    """Return the joints as a table of 80 columns, and why those that do not track do not."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    grid = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
    for header, width, side in COLUMNS:
        grid.add_column(header, width=width, justify=side, no_wrap=True)  # type: ignore[arg-type]
    for name, joint in joints.items():
        cells = (
            printable(name),
            _signed(joint.position),
            _signed(joint.velocity),
            f'{joint.interval:.3g}',
            joint.state,
            f'{joint.rate:.4g}',
            str(joint.dropped) if joint.dropped < 1e7 else f'{joint.dropped:.1e}',
        )
        grid.add_row(*(Text('-' if cell in ('nan', 'inf') else cell) for cell in cells))
    why = [f'{name}: {joint.state}: {joint.why}' for name, joint in joints.items() if joint.why]
    return Group(grid, *(Text(printable(line)) for line in why))


def _signed(value: float) -> str:
    """Return a number of at most ten characters with its sign."""
    if not math.isfinite(value):
        return 'nan'
    return f'{value:+.4f}' if abs(value) < 1e4 else f'{value:+.3e}'


def picture(watching: Watching, seconds: float) -> Group:
    """Return the whole display of an observer, `seconds` after the start."""
    from rich.console import Group
    from rich.text import Text

    name = printable(watching.name)[: WIDTH - 40]
    lines = []
    if watching.faults not in ('', 'ok'):
        lines.append(f'the node reports: {watching.faults}')
    if watching.silence > SILENT:
        lines.append(f'no message for {watching.silence:.0f} s')
    return Group(
        Text(f'{name}  {seconds:.1f} s, {watching.messages_hz:.0f} estimates/s'),
        table(watching.joints) if watching.joints else Text('no joint yet'),
        *(Text(printable(line)) for line in lines),
    )


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        'node', nargs='?', metavar='NODE', help='the observer (default: the only one that runs)'
    )
    parser.add_argument(
        '--duration', type=float, metavar='S', help='end after S seconds (default: Ctrl-C)'
    )


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Show the observer until Ctrl-C; return the last values of its joints.

    Raises
    ------
    UserError : no such observer, or it has gone.
    """
    if parsed.duration is not None and not parsed.duration > 0.0:
        raise UsageError(f'--duration is {parsed.duration:g} s: it must be above 0')
    from estimator_pkg.bags.live import live
    from estimator_pkg.nodes.watching import Watching

    with live('watch') as here:
        name = _observer(here, parsed.node)
        if not name:
            return {}
        watching = Watching(here.node, name)
        _follow(here, watching, parsed.duration or math.inf)
        count, joints = watching.count, watching.joints
    show(f'{name}: {count} estimates received')
    joints_shown = {each: dict(vars(joint)) for each, joint in joints.items()}
    return {'node': name, 'estimates': count, 'joints': joints_shown}


def _follow(here: Live, watching: Watching, duration: float) -> None:
    """Show the observer until the time is up or Ctrl-C.

    Raises
    ------
    UserError : the observer has gone.
    """
    begun = frame = time.monotonic()
    with Screen() as screen:
        while not here.stopping and time.monotonic() < begun + duration:
            here.spin(0.05)
            now = time.monotonic()
            if now < frame + FRAME:
                continue
            frame = now
            present = watching.look()
            screen.show(picture(watching, now - begun))
            if not present:
                raise UserError(
                    f'{watching.name} has gone from the graph: it ended, or lost its network'
                )


def _observer(here: Live, asked: str | None) -> str:
    """Return the full name of the requested or the only observer; '' after Ctrl-C.

    Raises
    ------
    UserError : it does not appear, or there are several.
    """
    from estimator_pkg.ros.observers import observers

    wanted = asked if asked is None or asked.startswith('/') else f'/{asked}'
    end = time.monotonic() + APPEAR
    found: set[str] = set()
    while not here.stopping and time.monotonic() < end:
        here.spin(0.05)
        new = observers(here.node) - found
        found |= new
        if wanted in found:
            return wanted or ''
        if wanted is None and new:
            end = min(end, time.monotonic() + 0.5)  # others may follow
    if here.stopping:
        return ''
    if wanted is None and len(found) == 1:
        return found.pop()
    names = ', '.join(sorted(found))
    if wanted is None and found:
        raise UserError(f'several observers run: name one of {names}')
    if found:
        raise UserError(f'no observer {wanted} runs: {suggestion(wanted or "", sorted(found))}')
    raise UserError(
        f'no observer {f"{wanted} " if wanted else ""}appeared within {APPEAR:g} s: start one '
        "('ros2 run velocity_estimator joint_observer', or 'joint_observer'), and check "
        'ROS_DOMAIN_ID'
    )


COMMAND = Command(
    'show what a running observer estimates, as a live table',
    arguments,
    run,
    examples=(
        ('', 'the only observer that runs'),
        ('/arm/joint_observer --duration 10', 'this one, for ten seconds'),
    ),
)
