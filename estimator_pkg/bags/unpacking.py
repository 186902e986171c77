# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Decompress within limits: a bag must not unpack to more memory or disk than the user allows."""

from __future__ import annotations

import argparse
import io
import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.optional import Lazy

lz4_frame = Lazy('lz4.frame')
zstandard = Lazy('zstandard')

MIB = 1 << 20
UNPACK_LIMIT = 256 * MIB  # default limit for one unpacked chunk or message [bytes]
UNPACK_RATIO = 100  # largest unpacked size of a file over its size, if that is above UNPACK_LIMIT
PIECE_SIZE = 4 * MIB  # bytes of a file unpacked at a time

REPAIR = (
    'to repair it, use `mcap recover FILE -o NEW` (.mcap) or '
    '`sqlite3 FILE .recover | sqlite3 NEW` (.db3)'
)  # of a file whose recorder was killed


class TooLargeError(UserError):
    """Something unpacks to more than the user allows."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the option of every command that reads bags."""
    parser.add_argument(
        '--unpack-limit',
        metavar='MIB',
        type=_limit,
        default=UNPACK_LIMIT,
        help='largest size of an unpacked chunk or message of the bag '
        f'(default {UNPACK_LIMIT // MIB}); the limit of a compressed file is {UNPACK_RATIO} '
        'times its size if that is more',
    )


def _limit(text: str) -> int:
    """Return bytes from a number of MiB on the command line."""
    value = float(text)  # argparse reports a ValueError
    if not (math.isfinite(value) and value > 0.0):
        raise UsageError(f'--unpack-limit is {text} MiB: it must be above 0')
    return int(value * MIB)


def check(what: str, size: int, limit: int, does: str = 'unpacks to') -> None:
    """Raise TooLargeError if `what` does something with more than `limit` bytes.

    Parameters
    ----------
    size : bytes, declared or actual.
    """
    if size > limit:
        raise TooLargeError(
            f'{what} {does} more than {limit / MIB:.6g} MiB: if you trust the '
            'bag, raise --unpack-limit'
        )


def unpack(packed: bytes | memoryview, compression: str, most: int) -> NDArray[np.uint8]:
    """Return what is packed, shape (n,): at most `most` bytes, and those before any damage.

    Raises
    ------
    ValueError : the compression is unknown.
    """
    reader: Any
    if not compression:
        return np.frombuffer(packed, np.uint8)[:most]
    if compression == 'zstd':
        reader = zstandard.ZstdDecompressor().stream_reader(packed)
    elif compression == 'lz4':
        reader = lz4_frame.open(io.BytesIO(packed))
    else:
        raise ValueError(f"unknown compression '{compression}'")
    data, done = np.empty(most, np.uint8), 0  # takes no memory before it is written to
    with suppress(zstandard.ZstdError, RuntimeError, ValueError, MemoryError, EOFError):
        while done < most and (size := reader.readinto(data[done : done + PIECE_SIZE])):
            done += size
    return data[:done]


def unpack_message(packed: bytes | memoryview, what: str, limit: int) -> bytes:
    """Return a message that was compressed on its own.

    Raises
    ------
    TooLargeError : it declares more than `limit` bytes.
    ValueError : it is damaged, or unpacks to more than `limit` bytes without declaring so.
    """
    try:
        check(what, zstandard.frame_content_size(packed), limit)  # -1: not declared
        return bytes(zstandard.decompress(packed, limit))
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error


def unpack_file(packed: Path, target: Path, limit: int) -> None:
    """Unpack a file.

    Raises
    ------
    TooLargeError : it unpacks to more than `limit` bytes and `UNPACK_RATIO` times its size.
    UserError : it is damaged.
    """
    most = max(limit, UNPACK_RATIO * packed.stat().st_size)
    try:
        with (
            open(packed, 'rb') as source,
            open(target, 'wb') as plain,
            zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True) as reader,
        ):
            done = 0
            while piece := reader.read(min(PIECE_SIZE, most + 1 - done)):
                done += len(piece)
                check(str(packed), done, most)
                plain.write(piece)
    except zstandard.ZstdError as error:
        raise UserError(f'{packed} is damaged: {error}') from error
