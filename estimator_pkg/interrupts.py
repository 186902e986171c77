# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The signals INT, TERM and HUP end a command; its results so far are kept.

A dropped ssh session sends HUP, a service manager TERM, a user INT (Ctrl-C). Within `handled` all
three raise KeyboardInterrupt. Within `gently` they only set a flag, so that no message is written
incompletely; the loop that writes checks `came` and ends.
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
LONGEST_END = 5.0  # time from `limit_end` to the end of the process [s]
ONE_PRESS = 1.0  # signals within this time count as one, because launchers forward Ctrl-C [s]


class _State:
    """State of the process, which has one handler for each signal."""

    depth = 0  # nesting of `handled`
    gentle = 0  # nesting of `gently`
    number = 0  # the first received signal; 0: none
    at = 0.0  # its time [s]
    terminals: tuple[int, ...] = ()


def came() -> int:
    """Return the number of the received signal that ends the command; 0: none."""
    return _State.number


def forget() -> None:
    """Forget the received signal: it ended only a part of the command."""
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
    background : handle INT also in a background job, for which a shell ignores it.
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
    """Ignore a first signal from now on: the command has its result and writes it."""
    _State.gentle += 1


def _take(number: int, frame: FrameType | None) -> None:
    if number == HANGUP:
        _leave_terminal()
    if not _State.number:
        _State.number, _State.at = number, time.monotonic()
        if not _State.gentle:
            raise KeyboardInterrupt
    elif number == signal.SIGINT and time.monotonic() > _State.at + ONE_PRESS:
        raise KeyboardInterrupt  # a second Ctrl-C ends the command at once


def _leave_terminal() -> None:
    """Discard output whose terminal has closed: each write would fail."""
    for number in _State.terminals:
        if not os.isatty(number):
            with suppress(OSError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, number)
                os.close(nowhere)


def say(text: str) -> None:
    """Print to stderr, if it is still open."""
    with suppress(OSError, ValueError):
        print(printable(text), file=sys.stderr, flush=True)


def limit_end() -> None:
    """End the process by an alarm if it is still there after `LONGEST_END`.

    To be called when nothing is left to do: then DDS may wait for one of its threads for ever.
    """
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_END)
