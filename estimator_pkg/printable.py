# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Make text from outside (names of joints, topics and frames, paths, file contents) printable.

Such a name may clear the screen, reverse the line, or forge a second one.
"""

from __future__ import annotations

from typing import Any, TextIO


def printable(text: object) -> str:
    r"""Return `text` in one line that a person can read: unprintable characters become escapes.

    These are control characters, line ends, direction marks, invisible characters and lone
    surrogates: U+202E becomes ``\u202e``.
    """
    line = str(text)
    if line.isprintable():
        return line
    return ''.join(
        each if each.isprintable() else each.encode('unicode_escape').decode() for each in line
    )


def show(*lines: object, file: TextIO | None = None) -> None:
    """Print each of `lines` as one `printable` line."""
    print('\n'.join(map(printable, lines)), file=file)


def drawn(text: object) -> str:
    """Return `text` for matplotlib: `printable`, with mathematics escaped."""
    return printable(text).replace('$', r'\$')


def terminal(stream: TextIO) -> TextIO:
    """Return the terminal of `stream`, for a display that moves the cursor and uses colours.

    Such a display must make every text from outside `printable` itself.
    """
    return getattr(stream, 'terminal', stream)


class PrintableStream:
    """A text stream on which only line ends and tabs act on the terminal; lines keep their length.

    Parameters
    ----------
    stream : the stream that the text is written to.

    Attributes
    ----------
    terminal : `stream`, for a display that draws on the terminal and makes its texts printable.
    """

    def __init__(self, stream: TextIO) -> None:
        self.terminal = stream

    def write(self, text: str) -> int:
        """Write `text`; all unprintable characters but line ends and tabs become escapes."""
        if not text.isprintable():
            text = '\n'.join(
                '\t'.join(map(printable, line.split('\t'))) for line in text.split('\n')
            )
        try:
            self.terminal.write(text)
        except UnicodeEncodeError:  # a terminal that is not UTF-8
            code = self.terminal.encoding
            self.terminal.write(text.encode(code, 'backslashreplace').decode(code))
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write each of the texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.terminal, name)


class PrintableLogger:
    """A node's logger that makes every text `printable`.

    Each severity has a line of its own, because rclpy allows one severity per calling line.

    Parameters
    ----------
    logger : from `rclpy.node.Node.get_logger`.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger

    def debug(self, text: str) -> None:
        """Log for developers; the lines of a traceback stay separate."""
        self._logger.debug('\n'.join(map(printable, text.split('\n'))))

    def info(self, text: str) -> None:
        """Log normal operation."""
        self._logger.info(printable(text))

    def warning(self, text: str) -> None:
        """Log a problem that the user should check."""
        self._logger.warning(printable(text))

    def error(self, text: str) -> None:
        """Log a failure."""
        self._logger.error(printable(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._logger, name)
