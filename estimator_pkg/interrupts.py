# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The signals INT, TERM and HUP end a command; its results so far are kept.

A dropped ssh session sends HUP, a service manager TERM, a user INT (Ctrl-C). Within `handled` all
three raise Interrupted. Within `gently` they only set a flag, so that no message is written
incompletely; the loop that writes checks `came` and ends.

Python and libraries drop exceptions in some places, as in `__del__` and in imports. So a timer
raises it again, unless one is being handled, until somebody who has caught it calls `finish`.
"""

from __future__ import annotations

import os
import signal
import stat
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

from estimator_pkg.printable import printable

NUMBERS = tuple(
    getattr(signal, name) for name in ('SIGINT', 'SIGTERM', 'SIGHUP') if hasattr(signal, name)
)
LONGEST_END = 5.0  # time from `limit_end` to the end of the process [s]
AGAIN = 0.05  # time until an interrupt is raised again [s]
ONE_PRESS = 1.0  # signals within this time count as one, because launchers forward Ctrl-C [s]
# Within an import or rclpy an exception would leave incomplete objects.
FRAGILE = ('<frozen importlib._bootstrap>', f'{os.sep}rclpy{os.sep}')


class Interrupted(KeyboardInterrupt):
    """One of the signals came.

    A KeyboardInterrupt that is not of a subclass makes Python end the process by SIGINT once it has
    passed through `exec`, whoever catches it.
    """


class _State:
    """State of the process, which has one handler for each signal."""

    before: dict[int, Any] | None = None  # handlers that ours replace; None: ours are not in use
    gentle = 0  # nesting of `gently`
    number = 0  # the first received signal; 0: none
    at = 0.0  # its time [s]
    report: Any = None  # reports exceptions that nobody can catch


def came() -> int:
    """Return the number of the received signal that ends the command; 0: none."""
    return _State.number


def forget() -> None:
    """Forget the received signal: it ended only a part of the command."""
    _State.number = 0


@contextmanager
def handled(background: bool = False) -> Iterator[None]:
    """Handle the signals of this process; a context that may be nested.

    A signal that was ignored before stays ignored, as by `nohup`.

    Parameters
    ----------
    background : handle INT also in a background job, for which a shell ignores it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    outermost, before = _State.before is None, _State.before or {}
    if outermost:
        _State.before, _State.number, _State.gentle = before, 0, 0
        before[signal.SIGALRM] = signal.signal(signal.SIGALRM, _raise_again)
        _State.report, sys.unraisablehook = sys.unraisablehook, _lost
    for number in NUMBERS:
        handler = signal.getsignal(number)
        if handler != signal.SIG_IGN or (background and number == signal.SIGINT):
            before.setdefault(number, handler)
            signal.signal(number, _take)
    try:
        yield
    finally:
        if outermost:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            sys.unraisablehook = _State.report
            for number, handler in before.items():
                signal.signal(number, handler)
            _State.before = None


@contextmanager
def gently(background: bool = False) -> Iterator[None]:
    """Let the first signal set `came` and raise nothing; `background` as for `handled`."""
    with handled(background):
        _State.gentle += 1
        try:
            yield
        finally:
            _State.gentle -= 1


@contextmanager
def held() -> Iterator[None]:
    """Raise a signal that comes within this context at its end: what it makes is complete."""
    before = _State.number
    with gently():
        yield
    if _State.number != before:
        raise Interrupted


def finish() -> None:
    """Ignore a first signal from now on: the command has its result, or has caught the signal."""
    _State.gentle += 1


def _take(number: int, frame: FrameType | None) -> None:
    if number == getattr(signal, 'SIGHUP', None):
        for stream in (1, 2):  # writing to a terminal that has closed fails
            if stat.S_ISCHR(os.fstat(stream).st_mode) and not os.isatty(stream):
                discard(stream)
    if not _State.number:
        _State.number, _State.at = number, time.monotonic()
        if not _State.gentle:
            signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
            _raise_again(number, frame)
    elif number == signal.SIGINT and time.monotonic() > _State.at + ONE_PRESS:
        raise Interrupted  # a second Ctrl-C ends the command at once


def _raise_again(number: int, frame: FrameType | None) -> None:
    """Raise Interrupted unless one is being handled, or nobody would see it."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, Interrupted):
        error = error.__context__
    while frame is not None and not any(each in frame.f_code.co_filename for each in FRAGILE):
        frame = frame.f_back
    if error is None and frame is None and not _State.gentle:
        raise Interrupted


def _lost(unraisable: Any) -> None:
    """Report an exception that nobody can catch, unless it will be raised again."""
    if not isinstance(unraisable.exc_value, Interrupted):
        _State.report(unraisable)


def discard(number: int) -> None:
    """Discard what is written to the file descriptor `number` from now on."""
    with suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)


def say(text: str) -> None:
    """Print to stderr, if it is still open."""
    with suppress(OSError, ValueError):
        print(printable(text), file=sys.stderr, flush=True)


def limit_end() -> None:
    """Ignore signals, and end the process by an alarm if it is still there after `LONGEST_END`.

    To be called when nothing is left but to end: then DDS may wait for one of its threads for ever.
    """
    for number in NUMBERS:
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_END)
