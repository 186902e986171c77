"""Single keys from a terminal, without waiting for Enter."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def keys() -> Iterator[Callable[[], str]]:
    """A function that gives the key pressed since, or an empty text; always that off a terminal.

    The terminal is as before at the end, whatever happens.
    """
    try:
        import termios
        import tty
        number = sys.stdin.fileno()
        # A job in the background would be stopped for touching its terminal.
        if not os.isatty(number) or os.tcgetpgrp(number) != os.getpgrp():
            raise OSError
        before = termios.tcgetattr(number)
    except (ImportError, OSError, ValueError, AttributeError):
        yield lambda: ''
        return

    def pressed() -> str:
        if select.select([number], [], [], 0.0)[0]:
            return os.read(number, 1).decode('utf-8', 'ignore')
        return ''

    tty.setcbreak(number)
    try:
        yield pressed
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)
