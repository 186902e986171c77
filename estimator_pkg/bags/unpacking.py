# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Decompress within limits: a bag must not unpack to more memory or disk than the user allows."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.optional import Lazy

lz4_frame = Lazy('lz4.frame')
zstandard = Lazy('zstandard')

MIB = 1 << 20
LIMIT = 256 * MIB  # default limit for one unpacked chunk or message [bytes]
RATIO = 100  # a file may unpack to RATIO times its size, or to LIMIT if that is more
PIECE = 4 * MIB  # bytes of a file unpacked at a time


def damaged() -> tuple[type[Exception], ...]:
    """Return the exceptions that damaged data raise when unpacked."""
    return zstandard.ZstdError, RuntimeError, ValueError, MemoryError


class TooLargeError(UserError):
    """Something unpacks to more than the user allows."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the option of every command that reads bags."""
    parser.add_argument(
        '--unpack-limit',
        metavar='MIB',
        type=_limit,
        default=LIMIT,
        help='largest size of an unpacked chunk or message of the bag '
        f'(default {LIMIT // MIB}); the limit of a compressed file is {RATIO} '
        'times its size if that is more',
    )


def _limit(text: str) -> int:
    """Return bytes from a number of MiB on the command line."""
    value = float(text)  # argparse reports a ValueError
    if not (math.isfinite(value) and value > 0.0):
        raise UsageError(f'--unpack-limit is {text} MiB: it must be above 0')
    return int(value * MIB)


def check(what: str, size: int, limit: int) -> None:
    """Raise TooLargeError if `what` unpacks to more than `limit` bytes.

    Parameters
    ----------
    size : bytes, declared or actual.
    """
    if size > limit:
        raise TooLargeError(
            f'{what} unpacks to more than {limit / MIB:.6g} MiB: if you trust the '
            'bag, raise --unpack-limit'
        )


def declared(packed: bytes | memoryview) -> int | None:
    """Return the size [bytes] that a zstd frame declares; None if it declares none.

    Raises
    ------
    zstandard.ZstdError : it is not a zstd frame.
    """
    size = zstandard.get_frame_parameters(packed).content_size
    return None if size in (zstandard.CONTENTSIZE_UNKNOWN, zstandard.CONTENTSIZE_ERROR) else size


def unpack(packed: bytes, compression: str, size: int) -> bytes:
    """Return the `size` bytes in `packed`; never unpack more.

    Raises
    ------
    one of `damaged()` : it contains another number of bytes, or is damaged.
    """
    if compression == 'zstd':
        if declared(packed) not in (None, size):
            raise ValueError('wrong size')
        data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    elif compression == 'lz4':
        data = lz4_frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1)
    elif compression:
        raise ValueError(f"unknown compression '{compression}'")
    else:
        data = packed
    if len(data) != size:
        raise ValueError('wrong size')
    return data


def unpack_partly(packed: bytes, compression: str, size: int) -> bytes:
    """Return the readable part of a chunk without its end, at most `size` bytes."""
    if compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(packed) as reader:
            return reader.read(size)
    if compression == 'lz4':
        return lz4_frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
    return packed[:size] if not compression else b''


def unpack_message(packed: memoryview, what: str, limit: int) -> bytes:
    """Return a message that was compressed on its own.

    Raises
    ------
    TooLargeError : it unpacks to more than `limit` bytes.
    zstandard.ZstdError : it is damaged.
    """
    size = declared(packed)
    check(what, size or 0, limit)
    with zstandard.ZstdDecompressor().stream_reader(packed) as reader:
        data = reader.read(limit + 1 if size is None else size)
    check(what, len(data), limit)
    if size is not None and len(data) != size:
        raise zstandard.ZstdError('it is truncated')
    return data


def unpack_file(packed: Path, target: Path, limit: int) -> None:
    """Unpack a file.

    Raises
    ------
    TooLargeError : it unpacks to more than `limit` bytes and `RATIO` times its size.
    UserError : it is damaged.
    """
    most = max(limit, RATIO * packed.stat().st_size)
    try:
        with (
            open(packed, 'rb') as source,
            open(target, 'wb') as plain,
            zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True) as reader,
        ):
            done = 0
            while piece := reader.read(min(PIECE, most + 1 - done)):
                done += len(piece)
                check(str(packed), done, most)
                plain.write(piece)
    except zstandard.ZstdError as error:
        raise UserError(f'{packed} is damaged: {error}') from error
