# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator watch``: what a running observer estimates, as a live table."""

from __future__ import annotations

import argparse
import math
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.printable import printable, show, terminal

if TYPE_CHECKING:
    from estimator_pkg.bags.live import Live
    from estimator_pkg.nodes.watching import Joint, Watching

WIDTH = 80
APPEAR = 5.0  # longest wait for an observer [s]
FRAME = 0.2  # time between two frames [s]
LINES = 1.0  # time between two tables without a terminal [s]
SILENT = 1.5  # a longer silence is shown [s]
CALM = ('', 'ok')
HEADER = ('joint', 'position', 'velocity', '95 % +-', 'state', 'rate Hz', 'dropped')
COLUMNS = (15, 11, 11, 9, 13, 7, 8)  # and a space between them: 80
GONE = '{} has gone from the graph: it ended, or lost its network'


class Screen:
    """Shows changing text: in place on a terminal, as lines elsewhere; a context manager.

    Parameters
    ----------
    period : time between two texts without a terminal [s].
    """

    def __init__(self, period: float = LINES, console: Any = None) -> None:
        from rich.console import Console
        from rich.live import Live as RichLive

        self._console = console or Console(file=terminal(sys.stdout))
        self._live = (
            RichLive(console=self._console, auto_refresh=False)
            if self._console.is_terminal
            else None
        )
        self._period, self._next = period, -math.inf

    def __enter__(self) -> Screen:
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *problem: object) -> None:
        if self._live:
            self._live.stop()

    @property
    def moves(self) -> bool:
        """True on a terminal, where a text replaces the one before."""
        return self._live is not None

    def show(self, picture: Any, plain: Callable[[], str]) -> None:
        """Show a picture of rich (or a text); without a terminal `plain()`, about once a period."""
        if self._live:
            self._live.update(picture, refresh=True)
            return
        now = time.monotonic()
        if now >= self._next:
            self._next = now + self._period
            print(plain(), file=self._console.file, flush=True)


def table(joints: Mapping[str, Joint], lines: int | None = None) -> str:
    """Return the joints as a table of 80 columns, and why those that do not track do not.

    Parameters
    ----------
    lines : largest number of joints that are shown; None: all.
    """
    shown = list(joints.items())[:lines]
    rows = [HEADER] + [
        (
            _cut(printable(name), COLUMNS[0]),
            _signed(joint.position),
            _signed(joint.velocity),
            f'{joint.interval:.3g}' if math.isfinite(joint.interval) else '-',
            _cut(joint.state, COLUMNS[4]),
            _rate(joint.rate),
            _count(joint.dropped),
        )
        for name, joint in shown
    ]
    found = [
        ' '.join(
            cell.ljust(width) if column in (0, 4) else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, COLUMNS))
        ).rstrip()
        for row in rows
    ]
    if len(joints) > len(shown):
        found.append(f'and {len(joints) - len(shown)} more joints')
    for name, joint in shown:
        if joint.why:
            found += wrapped(f'{name}: {joint.state}: {joint.why}')
    return '\n'.join(found)


def wrapped(text: str) -> list[str]:
    """Return a text in lines of 80 columns, the later ones indented."""
    return textwrap.wrap(printable(text), WIDTH, subsequent_indent='  ', break_on_hyphens=False)


def _signed(value: float) -> str:
    """Return a number of at most ten characters with its sign; '-' if it is unknown."""
    if not math.isfinite(value):
        return '-'
    return f'{value:+.4f}' if abs(value) < 1e4 else f'{value:+.3e}'


def _rate(hertz: float) -> str:
    if not math.isfinite(hertz):
        return '-'
    return f'{hertz:.4g}' if hertz < 1e3 else f'{hertz:.0f}' if hertz < 1e6 else f'{hertz:.0e}'


def _count(number: int) -> str:
    return str(number) if number < 1e7 else f'{number:.1e}'


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 3] + '...'


def picture(watching: Watching, seconds: float, height: int | None = None) -> str:
    """Return the whole display of an observer.

    Parameters
    ----------
    seconds : time since the start. height : lines of the terminal; None: any number.
    """
    room = None if height is None else max(1, (height - 6) // 2)
    lines = [
        _cut(printable(watching.name), WIDTH - 40)
        + f'  {seconds:.1f} s, {watching.messages_hz:.0f} estimates/s'
    ]
    if watching.joints:
        lines.append(table(watching.joints, room))
    else:
        lines.append('no joint yet')
    if watching.faults not in CALM:
        lines += wrapped(f'the node reports: {watching.faults}')
    if watching.silence > SILENT:
        lines.append(f'no message for {watching.silence:.0f} s')
    return '\n'.join(lines)


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
        present = _follow(here, watching, parsed.duration)
        count, joints = watching.count, dict(watching.joints)
    if not present:
        raise UserError(GONE.format(name))
    show(f'{name}: {count} estimates received')
    return {
        'node': name,
        'estimates': count,
        'joints': {
            each: {key: value for key, value in vars(joint).items() if key != 'arrived'}
            for each, joint in joints.items()
        },
    }


def _follow(here: Live, watching: Watching, duration: float | None) -> bool:
    """Show the observer until the time is up or Ctrl-C; return False if it has gone."""
    begun = time.monotonic()
    frame = begun + FRAME
    with Screen() as screen:
        while not here.stopping and (duration is None or time.monotonic() < begun + duration):
            here.spin(0.05)
            now = time.monotonic()
            if now < frame:
                continue
            frame = now + FRAME
            present = watching.look()
            height = shutil.get_terminal_size().lines if screen.moves else None
            shown = picture(watching, now - begun, height)
            screen.show(_text(shown) if screen.moves else shown, partial(str, shown + '\n'))
            if not present:
                return False
    return True


def _text(shown: str) -> Any:
    from rich.text import Text

    return Text(shown, no_wrap=True)


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
