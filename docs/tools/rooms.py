# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The picture of the rooms in docs/architecture.md, drawn from the imports.

    python -m docs.tools.rooms        # writes docs/figures/rooms.svg

A room is a folder of `estimator_pkg`. An arrow points from a room to one that it imports. The small
files at the top of `estimator_pkg` are for every room and are left out, as are `sim_pkg` and
`benchmarks`, which may import every room and which no room imports.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / 'estimator_pkg'
PICTURE = ROOT / 'docs' / 'figures' / 'rooms.svg'

CAPTIONS = {  # what is above may import what is below
    'evaluation': 'compare, reference, report, tune, identify',
    'nodes': 'a stream wired to ROS',
    'bags': 'a stream wired to a bag; record and play',
    'ros': 'executor, QoS and losses, as rclpy needs them',
    'streams': 'messages in, messages out: one family a file',
    'driver': 'samples through guard and observer',
    'messages': 'CDR bytes of a few message types',
    'observers': 'the mathematics: one family a folder',
    'models': 'mechanisms and motors',
    'sensor': 'stamps, quantum and noise of readings',
    'engine': 'the same mathematics as compiled C',
}
WIDTH, HEIGHT, ROW, MARGIN = 300, 44, 58, 12  # of a box, from box to box, at the border [px]
BOW = 46  # how far an arrow bows out for each row that it passes [px]


def imported(path: Path) -> Iterator[str]:
    """Yield the dotted name of each module that a file imports, also within functions."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module == PACKAGE.name:
            yield from (f'{PACKAGE.name}.{alias.name}' for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module


def rooms() -> set[str]:
    """Return the names of the folders of `estimator_pkg`."""
    return {path.parent.name for path in PACKAGE.glob('*/__init__.py')}


def arrows() -> set[tuple[str, str]]:
    """Return (room, room that it imports) for all rooms."""
    names = rooms()
    return {
        (room, inner.split('.')[0])
        for room in names
        for path in (PACKAGE / room).rglob('*.py')
        for package, _, inner in (name.partition('.') for name in imported(path))
        if package == PACKAGE.name and inner.split('.')[0] in names - {room}
    }


def _arrow(start: str, end: str, leaving: list[str], arriving: list[str]) -> str:
    """Return an arc at the right of the boxes; arcs that begin or end at one box are spread."""
    order = list(CAPTIONS)
    first, last = order.index(start), order.index(end)
    y0 = MARGIN + first * ROW + HEIGHT * (0.55 + 0.4 * leaving.index(end) / len(leaving))
    y1 = MARGIN + last * ROW + HEIGHT * (0.08 + 0.4 * arriving.index(start) / len(arriving))
    x, bow = MARGIN + WIDTH, MARGIN + WIDTH + 24 + BOW * (last - first)
    return (
        f'<path class="arrow" d="M{x} {y0:.0f} C{bow} {y0:.0f} {bow} {y1:.0f} {x} {y1:.0f}">'
        f'<title>{start} imports {end}</title></path>'
    )


def _box(room: str, row: int) -> str:
    x, y = MARGIN + WIDTH / 2, MARGIN + row * ROW
    return (
        f'<rect x="{MARGIN}" y="{y}" width="{WIDTH}" height="{HEIGHT}" rx="6"/>'
        f'<text class="name" x="{x:.0f}" y="{y + 18}">{room}</text>'
        f'<text x="{x:.0f}" y="{y + 35}">{CAPTIONS[room]}</text>'
    )


def picture() -> str:
    """Return the SVG; raises ValueError for an arrow that points upwards, or a room unnamed."""
    order, found = list(CAPTIONS), arrows()
    if set(order) != rooms() or any(order.index(a) > order.index(b) for a, b in found):
        raise ValueError(f'CAPTIONS does not order the rooms {rooms()} for {found}')
    below = {a: sorted((b for b in order if (a, b) in found), key=order.index)[::-1] for a in order}
    above = {b: sorted((a for a in order if (a, b) in found), key=order.index)[::-1] for b in order}
    width = 2 * MARGIN + WIDTH + BOW * (len(order) - 1) * 0.8
    return '\n'.join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" '
            f'height="{2 * MARGIN + HEIGHT + (len(order) - 1) * ROW}">',
            '<title>Rooms of estimator_pkg, and which imports which</title>',
            '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
            'markerHeight="7" orient="auto"><path d="M0 0 L8 4 L0 8 z" fill="#5b7083"/></marker>'
            '</defs>',
            '<style>rect{fill:#eef3f7;stroke:#5b7083}text{font:12px sans-serif;text-anchor:middle;'
            'fill:#33414d}.name{font:bold 14px sans-serif}'
            '.arrow{fill:none;stroke:#5b7083;marker-end:url(#head)}</style>',
            '<rect width="100%" height="100%" style="fill:#fff;stroke:none"/>',
            *(_arrow(a, b, below[a], above[b]) for a, b in sorted(found)),
            *(_box(room, row) for row, room in enumerate(order)),
            '</svg>\n',
        ]
    )


if __name__ == '__main__':
    PICTURE.write_text(picture())
    print(f'{PICTURE}: {len(rooms())} rooms, {len(arrows())} arrows')
