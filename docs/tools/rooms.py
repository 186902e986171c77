# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The table of rooms in docs/architecture.md, from the imports.

    python -m docs.tools.rooms        # prints it

A room is a folder of `estimator_pkg`. The small files at the top of `estimator_pkg` are for every
room and are left out, as are `sim_pkg` and `benchmarks`, which may import every room and which no
room imports.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from estimator_pkg.evaluation.text import markdown

PACKAGE = Path(__file__).resolve().parents[2] / 'estimator_pkg'
CAPTIONS = {  # what is above may import what is below
    'export': 'a tuned observer as a C99 header',
    'evaluation': 'compare, reference, report, tune, identify',
    'nodes': 'a stream wired to ROS',
    'bags': 'a stream wired to a bag; record and play',
    'ros': 'executor, QoS and losses, as rclpy needs them',
    'streams': 'messages in, messages out: one family a file',
    'driver': 'samples through sensor and observer',
    'messages': 'CDR bytes of a few message types',
    'observers': 'the mathematics: one family a folder',
    'models': 'mechanisms and motors',
    'sensor': 'guard, clock, quantum and noise: what a reading is worth',
    'engine': 'the observers as C: translator, build, calls',
}


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


def table() -> str:
    """Return the rooms from the top down, and what each imports, as Markdown."""
    found = arrows()
    return markdown(
        ('room', 'has', 'imports'),
        [
            (f'`{room}`', has, ', '.join(each for each in CAPTIONS if (room, each) in found) or '-')
            for room, has in CAPTIONS.items()
        ],
    )


if __name__ == '__main__':
    print(table())
