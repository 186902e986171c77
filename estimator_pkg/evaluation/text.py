# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables for a terminal and for Markdown."""

from __future__ import annotations

import math
import re
import shlex
import textwrap
from collections.abc import Iterable, Sequence

from estimator_pkg.printable import printable

RAD = re.compile(r'(?:(?<=[\d-] )|(?<=\[))rad(/s)?\b')  # as a unit
WIDTH = 80  # columns of a terminal
SHORTEST_NAME = 9  # names are cut to this length at most


def wrapped(line: str, width: int = WIDTH) -> list[str]:
    """Return a sentence as lines of at most `width` columns; a longer word keeps its own line."""
    lead = line[: len(line) - len(line.lstrip())]
    return textwrap.wrap(
        printable(line),
        width,
        subsequent_indent=f'{lead}  ',
        break_long_words=False,
        break_on_hyphens=False,
    ) or ['']


def units(text: str, period: float) -> str:
    """Return a text that has rad with the unit of a joint without a wrap period: m or rad.

    Such a joint is prismatic, or counts turns.
    """
    return text if period else RAD.sub(r'm\1 or rad\1', text)


def started(node: str, path: str, remaps: Iterable[str]) -> list[str]:
    """Return the command that starts a node with a parameter file, a line for each remapping."""
    lines = [f'node: {node} --ros-args --params-file {shlex.quote(path)}']
    lines += [f'  -r {shlex.quote(each)}' for each in remaps]
    return [f'{line} \\' for line in lines[:-1]] + lines[-1:]


def for_node(node: str, remaps: Iterable[str] = ()) -> list[str]:
    """Return the same as lines of a comment in the file itself."""
    return [f'For the {line}' for line in started(node, 'THIS_FILE', ())] + [
        f'  -r {each}' for each in remaps
    ]


def number(value: float | None, digits: int = 4) -> str:
    """Return a number in few characters; '-' for None or nan."""
    if value == math.inf:
        return 'inf'
    if value is None or not math.isfinite(value):
        return '-'
    if abs(value) >= 10.0**digits:
        return f'{value:.0f}'
    return f'{value:.{digits}g}'


def fixed(value: float | None, decimals: int) -> str:
    """Return a number with `decimals` decimals; '-' for None, nan or infinity."""
    if value is None or not math.isfinite(value):
        return '-'
    text = f'{value:.{decimals}f}'
    return text if float(text) else text.lstrip('-')  # no '-0.00'


def error(value: float | None, decimals: int) -> str:
    """Return as `fixed`, but with two digits if the decimals would show fewer."""
    if value is not None and 0.0 < abs(value) < 10.0 ** (1 - decimals):
        return f'{value:.2g}'
    return fixed(value, decimals)


def interval(value: float, half: float, unit: str = '') -> str:
    """Return a number with half of its 95 % interval (two digits, or 0.01); '-' for nan."""
    if not math.isfinite(value + half):
        return '-'
    half = max(half, 0.01)
    decimals = min(2, max(0, 1 - math.floor(math.log10(half))))
    return f'{fixed(value, decimals)} +- {fixed(half, decimals)} {unit}'.rstrip()


def table(
    header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1, width: int | None = None
) -> str:
    """Return columns side by side, the first `left` of them left-aligned, the others right.

    Parameters
    ----------
    width : largest number of columns of the terminal; names are cut to it, numbers never.
    """
    header, rows = filled(header, rows, left)
    lines = [list(header), *[[printable(cell) for cell in row] for row in rows]]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    while width and sum(widths) + 2 * len(widths) - 2 > width:
        widest = max(range(left), key=widths.__getitem__)
        if widths[widest] <= SHORTEST_NAME:
            break
        widths[widest] -= 1
    return '\n'.join(
        '  '.join(
            _cut(cell, width).ljust(width) if i < left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths))
        ).rstrip()
        for line in lines
    )


def filled(
    header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 0
) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """Return a table without the columns, after the first `left`, that have '-' in all rows."""
    kept = [
        i for i in range(len(header)) if i < left or not rows or any(row[i] != '-' for row in rows)
    ]
    return [header[i] for i in kept], [[row[i] for i in kept] for row in rows]


def _cut(name: str, width: int) -> str:
    """Return a name with its middle left out, if it is longer than `width`."""
    if len(name) <= width:
        return name
    end = (width - 3) // 2
    return f'{name[: width - 3 - end]}...{name[len(name) - end :]}'


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return the same as a Markdown table."""
    header, rows = filled(header, rows)

    def line(cells: Sequence[str]) -> str:
        return '| ' + ' | '.join(printable(cell).replace('|', '\\|') for cell in cells) + ' |'

    return '\n'.join([line(header), '|' + '---|' * len(header), *[line(row) for row in rows]])
