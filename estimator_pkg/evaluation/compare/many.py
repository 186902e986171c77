"""The bags that a user means, and what becomes of those among them that say nothing.

A bag that was named is judged or the command fails. Of the bags that were found in a folder those
that cannot be judged are left out, each with a line that says why.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from estimator_pkg.bags.reader import METADATA
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.workers import Map
from estimator_pkg.printable import show

FILES = ('*.mcap', '*.db3', '*.mcap.zstd', '*.db3.zstd')
NUMBER = re.compile(r'_\d+(?=\.)')  # of a file of a split bag


class Meant(NamedTuple):
    """A bag, and the folder it was found in; '': it was named itself."""

    path: str
    folder: str = ''


class LeftOut(NamedTuple):
    """A bag of a folder that cannot be judged, and why."""

    path: str
    why: str

    def __str__(self) -> str:
        return f'{self.path} is left out: {self.why}'


def expanded(paths: Sequence[str]) -> list[Meant]:
    """The bags meant: folders with bags in them stand for these.

    Raises
    ------
    UserError : a folder without any bag.
    """
    meant: dict[str, str] = {}
    for path in dict.fromkeys(paths):
        folder = Path(path)
        found = _bags(folder) if folder.is_dir() else [folder]
        if not found:
            raise UserError(f'{path}: no bag in this folder')
        if found == [folder]:
            meant[path] = ''
        else:
            for each in found:
                meant.setdefault(str(each), path)
    return [Meant(*each) for each in meant.items()]


def _bags(folder: Path) -> list[Path]:
    """The folder if it is a bag, else the bags in it: files by themselves, and folders.

    Without metadata (its recorder did not end cleanly) a folder is a bag if its files differ in
    their number alone.
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
    if files and not below and len({NUMBER.sub('', file.name) for file in files}) == 1:
        return [folder]
    return files + below


def on_each(
    run_many: Map,
    function: Callable[..., Any],
    bags: Sequence[Meant],
    *arguments: Any,
    left_out: list[LeftOut],
) -> Iterator[Any]:
    """``function(path, *arguments)`` of every bag, in their order.

    Parameters
    ----------
    left_out : to which those are added that cannot be judged; stderr is told of them as well.

    Raises
    ------
    UserError : a bag that was named cannot be judged, or none at all can.
    UsageError : the call is wrong, whatever the bag.
    """
    judged = 0
    for found in run_many(_attempt, [(function, bag, *arguments) for bag in bags]):
        if isinstance(found, LeftOut):
            left_out.append(found)
            show(f'warning: {found}', file=sys.stderr)
        else:
            judged += 1
            yield found
    if bags and not judged:
        folders = ', '.join(dict.fromkeys(bag.folder for bag in bags))
        raise UserError(f'{folders}: none of the bags in it can be judged')


def _attempt(function: Callable[..., Any], bag: Meant, *arguments: Any) -> Any:
    """The result, or `LeftOut`; here, so that no worker's error ends the work on all the others."""
    try:
        return function(bag.path, *arguments)
    except UsageError:
        raise
    except UserError as error:
        if not bag.folder:
            raise
        return LeftOut(bag.path, str(error).removeprefix(f'{bag.path}: '))
