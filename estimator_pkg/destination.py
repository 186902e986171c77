# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Output files: checked before the work, never an input."""

from __future__ import annotations

import argparse
import os
from contextlib import suppress
from pathlib import Path

from estimator_pkg.errors import UsageError, UserError

STDOUT = '-'  # instead of a file name
OUTPUTS = ('out', 'html', 'data', 'plot', 'json')  # options with output files
INPUTS = ('bag', 'bags', 'judge', 'recover')  # options with input bags
METADATA = 'metadata.yaml'
OF_BAGS = ('.mcap', '.db3', '.zstd')  # data files in the folder of a bag


def check(path: str | Path) -> None:
    """Raise UserError unless a file can be written at `path`.

    Raises
    ------
    UserError : the folder does not exist, the path is a folder, or it is not writable.
    """
    place = Path(path)
    if place.is_dir():
        raise UserError(f'{path} is a folder: name a file')
    if not place.parent.is_dir():
        raise UserError(f'{path}: the folder {place.parent} does not exist: create it first')
    if not os.access(place if place.exists() else place.parent, os.W_OK):
        raise UserError(f'{path} is not writable: name another file, or change its permissions')


def check_distinct(parsed: argparse.Namespace) -> None:
    """Raise UsageError if two outputs of a command are the same file, or one is an input."""
    outputs = [
        (f'--{name}', Path(value))
        for name in OUTPUTS
        if isinstance(value := getattr(parsed, name, None), str)
        and value
        and not (name == 'json' and value == STDOUT)
    ]
    for number, (option, path) in enumerate(outputs):
        for other, taken in outputs[:number]:
            if _same(path, taken):
                raise UsageError(
                    f'{other} and {option} name the same file {path}: give each its own name'
                )
        for name in INPUTS:
            value = getattr(parsed, name, None)
            for read in [value] if isinstance(value, str) else value or ():
                if _same(path, Path(read)) or _within(path, Path(read)):
                    raise UsageError(f'{option} {path} would overwrite an input: name another file')


def _same(one: Path, other: Path) -> bool:
    with suppress(OSError, ValueError):
        if one.exists() and other.exists():
            return one.samefile(other)
    return os.path.realpath(one) == os.path.realpath(other)


def _within(path: Path, bag: Path) -> bool:
    """Return True if an existing file belongs to the bag in this folder."""
    return (
        (path.suffix in OF_BAGS or path.name == METADATA)
        and path.is_file()
        and bag.is_dir()
        and Path(os.path.realpath(path)).is_relative_to(os.path.realpath(bag))
    )
