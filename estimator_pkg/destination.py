# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Output files: checked before the work, and never an input."""

from __future__ import annotations

import argparse
import os
from contextlib import suppress
from pathlib import Path

from estimator_pkg.errors import UsageError, UserError

STDOUT = '-'  # instead of a file name
OUTPUTS = ('out', 'html', 'data', 'plot', 'json')  # options with output files
INPUTS = ('bag', 'bags', 'judge')  # options with input bags
METADATA = 'metadata.yaml'
OF_BAGS = ('.mcap', '.db3', '.zstd', '.db3-wal', '.db3-journal', '.db3-shm')  # data files of bags


def check(path: str | Path) -> None:
    """Raise UserError unless a file, which is no bag, can be written at `path`.

    Raises
    ------
    UserError : the folder does not exist, the path is a folder or a file of a bag, or it is not
        writable.
    """
    place = Path(path)
    if _of_bag(place) and place.is_file():
        raise UserError(f'{path} is a file of a bag: name another file')
    if place.is_dir():
        raise UserError(f'{path} is a folder: name a file')
    if not place.parent.is_dir():
        raise UserError(f'{path}: the folder {place.parent} does not exist: create it first')
    if not os.access(place if place.exists() else place.parent, os.W_OK):
        raise UserError(f'{path} is not writable: name another file, or change its permissions')


def check_distinct(parsed: argparse.Namespace) -> None:
    """Raise UsageError if two outputs of a command are the same file, or one is of an input bag."""
    outputs = [
        (f'--{name}', Path(value))
        for name in OUTPUTS
        if isinstance(value := getattr(parsed, name, None), str)
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
                if _changes(path, Path(read)):
                    raise UsageError(
                        f'{option} {path} would change the input {read}: name another file'
                    )


def _same(one: Path, other: Path) -> bool:
    with suppress(OSError, ValueError):
        if one.exists() and other.exists():
            return one.samefile(other)
    return os.path.realpath(one) == os.path.realpath(other)


def _of_bag(path: Path) -> bool:
    """Return True if the name, or that of the file that it links to, is that of a bag's file."""
    place = Path(os.path.realpath(path))
    return place.suffix in OF_BAGS or place.name == METADATA


def _changes(path: Path, bag: Path) -> bool:
    """Return True if an output is the bag at this path, or a file of it, or would become one.

    In a folder without metadata another bag may lie next to a file, and gets no metadata either.
    """
    folder = bag if bag.is_dir() else bag.parent
    whole = bag.is_dir() or (bag.parent / METADATA).exists() or path.name == METADATA
    below = Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))
    return _same(path, bag) or (whole and below and (_of_bag(path) or not path.suffix))
