# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Read files that end; write files completely or not at all."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

NOT_A_FILE = 'it is a pipe, socket or device: name a file'


def broken_link(path: Path) -> str:
    """Return to what a link leads that leads to no file, as text; '' if it is no such link."""
    if not path.is_symlink() or path.exists():
        return ''
    target = path.readlink()
    try:
        path.stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            return 'a link to itself'
    return f'a link to {target}, which does not exist'


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a new file next to `path`, which replaces `path` when the context ends without error.

    After an error the new file is deleted and `path` is unchanged. A special file (/dev/null), or
    one in a folder that is not writable, is written directly.

    Raises
    ------
    OSError : it cannot be written; its file name is `path`.
    """
    place = beside = Path(os.path.realpath(path))  # a link stays one
    try:
        if place.exists() and not (place.is_file() and os.access(place.parent, os.W_OK)):
            yield Path(path)
            return
        while True:
            beside = place.with_name(f'.{place.name}.{secrets.token_hex(4)}.part')
            with suppress(FileExistsError):
                beside.open('xb').close()
                break
        yield beside
        os.replace(beside, place)
    except BaseException as error:
        if beside != place:
            beside.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(beside)):
            error.filename = str(path)
        raise


def write_text(path: str | Path, text: str) -> None:
    """Write a file, completely or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding='utf-8')


def read_text(path: str | Path) -> str:
    """Return the text of a file.

    Raises
    ------
    OSError : it cannot be read, or is a pipe, socket or device, which may never end.
    UnicodeDecodeError : it is not text.
    """
    place = Path(path)
    if place.exists() and not place.is_file() and not place.is_dir():
        raise OSError(errno.EINVAL, NOT_A_FILE, str(path))
    return place.read_text(encoding='utf-8')
