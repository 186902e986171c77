"""Where results go: checked before the work, written whole, and nothing else is overwritten."""

from __future__ import annotations

import argparse
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from estimator_pkg.errors import UsageError, UserError

STDOUT = '-'  # in place of a file's name
OUTPUTS = ('out', 'html', 'data', 'plot', 'json')  # options that name what a command writes
INPUTS = ('bag', 'bags', 'judge', 'recover')  # and the bags that it reads
METADATA = 'metadata.yaml'
OF_BAGS = ('.mcap', '.db3', '.zstd')  # files in the folder of a bag, beside it


def check(path: str | Path) -> None:
    """Raise UserError unless a file can be written at `path`.

    Raises
    ------
    UserError : there is no such folder, a folder has that name, or it may not be written.
    """
    place = Path(path)
    if place.is_dir():
        raise UserError(f'{path} is a folder: name a file')
    if not place.parent.is_dir():
        raise UserError(f'{path}: there is no folder {place.parent}')
    if not os.access(place if place.exists() else place.parent, os.W_OK):
        raise UserError(f'{path} may not be written')


def check_apart(parsed: argparse.Namespace) -> None:
    """Raise UsageError where two options of a command name one file, or one the command's input."""
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
                    f'{other} and {option} name the same file {path}: give each a name of its own'
                )
        for name in INPUTS:
            value = getattr(parsed, name, None)
            for read in [value] if isinstance(value, str) else value or ():
                if _same(path, Path(read)) or _within(path, Path(read)):
                    raise UsageError(
                        f'{option} {path} would overwrite what is read: name another file'
                    )


def _same(one: Path, other: Path) -> bool:
    with suppress(OSError, ValueError):
        if one.exists() and other.exists():
            return one.samefile(other)
    return os.path.realpath(one) == os.path.realpath(other)


def _within(path: Path, bag: Path) -> bool:
    """True if a file that is there belongs to the bag in this folder."""
    return (
        (path.suffix in OF_BAGS or path.name == METADATA)
        and path.is_file()
        and bag.is_dir()
        and Path(os.path.realpath(path)).is_relative_to(os.path.realpath(bag))
    )


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A new file beside `path`, which takes its place when the context ends well.

    If it does not end well the new file is deleted and `path` is as it was. What is no ordinary
    file (/dev/null), or stands in a folder that may not be written, is written directly.

    Raises
    ------
    OSError : it cannot be written.
    """
    place = Path(os.path.realpath(path))  # a link stays one
    if place.exists() and not (place.is_file() and os.access(place.parent, os.W_OK)):
        yield Path(path)
        return
    while True:
        beside = place.with_name(f'.{place.name}.{secrets.token_hex(4)}.part')
        with suppress(FileExistsError):
            beside.open('xb').close()
            break
    try:
        yield beside
        os.replace(beside, place)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def write_text(path: str | Path, text: str) -> None:
    """Write a file, whole or not at all."""
    with replacing(path) as beside:
        beside.write_text(text, encoding='utf-8')
