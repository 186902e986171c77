# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Expand the paths of a command into bags, and handle bags that cannot be evaluated.

A bag that was named must be evaluated, else the command fails. Bags found in a folder are skipped
if they cannot be evaluated, each with a line that gives the reason.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from estimator_pkg.destination import METADATA
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.workers import Map
from estimator_pkg.printable import show

FILES = ('*.mcap', '*.db3', '*.mcap.zstd', '*.db3.zstd')
FILE_NUMBER = re.compile(r'_\d+(?=\.)')  # number of a file of a split bag


class Meant(NamedTuple):
    """A bag, and the folder in which it was found; '': it was named itself."""

    path: str
    folder: str = ''


class LeftOut(NamedTuple):
    """A bag of a folder that cannot be evaluated, and the reason."""

    path: str
    why: str

    def __str__(self) -> str:
        return f'{self.path} is skipped: {self.why}'


def expanded(paths: Sequence[str]) -> list[Meant]:
    """Return the bags of these paths; a folder is replaced by the bags in it.

    Raises
    ------
    UserError : a folder without any bag.
    """
    meant: dict[str, str] = {}
    for path in dict.fromkeys(paths):
        folder = Path(path)
        found = _bags(folder) if folder.is_dir() else [folder]
        if not found:
            raise UserError(f'{path} contains no bag: name a bag, or a folder with bags')
        if found == [folder]:
            meant[path] = ''
        else:
            for each in found:
                meant.setdefault(str(each), path)
    return [Meant(*each) for each in meant.items()]


def _bags(folder: Path) -> list[Path]:
    """Return [folder] if it is a bag, else the bags in it: single files, and folders.

    A folder without metadata (its recorder was killed) is a bag if the names of its files differ
    only in their number.
    """
    if (folder / METADATA).exists():
        return [folder]
    files = sorted(file for pattern in FILES for file in folder.glob(pattern))
    below = [
        bag
        for each in sorted(folder.iterdir())
        if each.is_dir() and not each.is_symlink() and not each.name.startswith('.')
        for bag in _bags(each)
    ]
    if files and not below and len({FILE_NUMBER.sub('', file.name) for file in files}) == 1:
        return [folder]
    return files + below


def on_each(
    run_many: Map,
    function: Callable[..., Any],
    bags: Sequence[Meant],
    *arguments: Any,
    left_out: list[LeftOut],
) -> Iterator[Any]:
    """Yield ``function(path, *arguments)`` for every bag, in order.

    Parameters
    ----------
    left_out : skipped bags are appended to it, and reported on stderr.

    Raises
    ------
    UserError : a named bag cannot be evaluated, or no bag can.
    UsageError : the call itself is wrong.
    """
    for found in run_many(_attempt, [(function, bag, *arguments) for bag in bags]):
        if isinstance(found, LeftOut):
            left_out.append(found)
            show(f'warning: {found}', file=sys.stderr)
        else:
            yield found
    if bags and {bag.path for bag in bags} <= {each.path for each in left_out}:
        folders = ', '.join(dict.fromkeys(bag.folder for bag in bags))
        raise UserError(f'{folders}: none of the bags in it can be evaluated (reasons above)')


def _attempt(function: Callable[..., Any], bag: Meant, *arguments: Any) -> Any:
    """Return the result or `LeftOut`; a worker's exception would end the work on all bags."""
    try:
        return function(bag.path, *arguments)
    except UsageError:
        raise
    except UserError as error:
        if not bag.folder:
            raise
        return LeftOut(bag.path, str(error).removeprefix(f'{bag.path}: '))
