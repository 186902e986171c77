"""Text of others (names of joints, topics and frames, paths, contents of files) made printable.

A bag may name a joint so that it clears the screen, turns the line round or forges a second one.
"""

from __future__ import annotations

import html
from typing import Any, TextIO


def printable(text: object) -> str:
    r"""Return `text` in one line, with an escape for every character that no reader sees.

    These are control characters, line ends, what changes the direction of writing, what is
    invisible and lone surrogates: U+202E becomes ``\u202e``.
    """
    line = str(text)
    if line.isprintable():
        return line
    return ''.join(
        each if each.isprintable() else each.encode('unicode_escape').decode() for each in line
    )


def show(*lines: object, file: TextIO | None = None) -> None:
    """Print each of `lines` as one line, as `printable` makes it."""
    print('\n'.join(map(printable, lines)), file=file)


def escaped(text: object) -> str:
    """Return `text` for a page: `printable`, and nothing in it is HTML."""
    return html.escape(printable(text))


def drawn(text: object) -> str:
    """Return `text` for matplotlib: `printable`, and nothing in it is mathematics."""
    return printable(text).replace('$', r'\$')


def terminal(stream: TextIO) -> TextIO:
    """Return what `stream` writes to, for a display that moves the cursor and colours.

    Such a display makes every text of others `printable` by itself.
    """
    return getattr(stream, 'terminal', stream)


class PrintableStream:
    """A text stream on which only line ends and tabs act on the terminal.

    Parameters
    ----------
    stream : where the text goes.

    Attributes
    ----------
    terminal : `stream`, for what draws on the terminal and makes its texts printable itself.
    """

    def __init__(self, stream: TextIO) -> None:
        self.terminal = stream

    def write(self, text: str) -> int:
        """Write `text`; everything but line ends and tabs goes through `printable`."""
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
    logger : as `rclpy.node.Node.get_logger` returns it.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger

    def debug(self, text: str) -> None:
        """Log for developers; the lines of a traceback stay lines."""
        self._logger.debug('\n'.join(map(printable, text.split('\n'))))

    def info(self, text: str) -> None:
        """Log what is as it should be."""
        self._logger.info(printable(text))

    def warning(self, text: str) -> None:
        """Log what a user should look at."""
        self._logger.warning(printable(text))

    def error(self, text: str) -> None:
        """Log what does not work."""
        self._logger.error(printable(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._logger, name)
