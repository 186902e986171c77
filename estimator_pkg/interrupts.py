"""INT, TERM and HUP end a command with what it has.

A dropped ssh session sends HUP, a service manager TERM, a person INT (Ctrl-C). Within `handled` all
three raise KeyboardInterrupt. Within `gently` they only set a flag, so that no message is written
by half; what is written then looks at `came` and ends by itself.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from estimator_pkg.printable import printable

NUMBERS = tuple(
    getattr(signal, name) for name in ('SIGINT', 'SIGTERM', 'SIGHUP') if hasattr(signal, name)
)
HANGUP = getattr(signal, 'SIGHUP', None)
ONE_WISH = 1.0  # [s] signals so close together mean the same: launchers pass Ctrl-C on


class _State:
    """Of the process, which has one handler for each signal."""

    depth = 0  # of `handled`
    gentle = 0  # of `gently`
    number = 0  # the first signal that came; 0: none
    at = 0.0  # when [s]
    terminals: tuple[int, ...] = ()


def came() -> int:
    """Return the number of the signal that is to end the command; 0 if none came."""
    return _State.number


def forget() -> None:
    """Go on: the signal that came was meant for what has ended."""
    _State.number = 0


@contextmanager
def handled() -> Iterator[None]:
    """Handle the signals of this process; a context that may be nested.

    A signal that was ignored before stays ignored, as by `nohup`.
    """
    if _State.depth or threading.current_thread() is not threading.main_thread():
        yield
        return
    _State.depth, _State.number, _State.gentle = 1, 0, 0
    _State.terminals = tuple(number for number in (1, 2) if os.isatty(number))
    before = {
        number: signal.signal(number, _take)
        for number in NUMBERS
        if signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _State.depth = 0


@contextmanager
def gently(background: bool = False) -> Iterator[None]:
    """Let the first signal set `came` and raise nothing.

    Parameters
    ----------
    background : take INT too where a shell ignores it for a job in the background.
    """
    with handled():
        ignored = (
            background
            and signal.getsignal(signal.SIGINT) == signal.SIG_IGN
            and threading.current_thread() is threading.main_thread()
        )
        if ignored:
            signal.signal(signal.SIGINT, _take)
        _State.gentle += 1
        try:
            yield
        finally:
            _State.gentle -= 1
            if ignored:
                signal.signal(signal.SIGINT, signal.SIG_IGN)


def finish() -> None:
    """Let no first signal interrupt the command any more: it has its result and writes it."""
    _State.gentle += 1


def _take(number: int, frame: FrameType | None) -> None:
    if number == HANGUP:
        _leave_terminal()
    if not _State.number:
        _State.number, _State.at = number, time.monotonic()
        if not _State.gentle:
            raise KeyboardInterrupt
    elif number == signal.SIGINT and time.monotonic() > _State.at + ONE_WISH:
        raise KeyboardInterrupt  # Ctrl-C again: at once


def _leave_terminal() -> None:
    """Send output nowhere where its terminal is gone: each write would fail."""
    for number in _State.terminals:
        if not os.isatty(number):
            with suppress(OSError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, number)
                os.close(nowhere)


def say(text: str) -> None:
    """Print to stderr, if that is still there."""
    with suppress(OSError, ValueError):
        print(printable(text), file=sys.stderr, flush=True)
