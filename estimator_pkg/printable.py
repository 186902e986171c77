"""Text of others (names of joints, topics and frames, paths, contents of files) made printable.

A bag may name a joint so that it clears the screen, turns the line round or forges a second one.
"""

from __future__ import annotations

from typing import Any, TextIO


def printable(text: object) -> str:
    r"""Return `text` in one line, with an escape for every character that no reader sees.

    These are control characters, line ends, what changes the direction of writing, what is
    invisible and lone surrogates: U+202E becomes ``\u202e``.
    """
    line = str(text)
    if line.isprintable():
        return line
    return ''.join(each if each.isprintable() else each.encode('unicode_escape').decode()
                   for each in line)


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
            text = '\n'.join('\t'.join(map(printable, line.split('\t')))
                             for line in text.split('\n'))
        self.terminal.write(text)
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write each of the texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.terminal, name)
