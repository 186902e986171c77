"""Decompression within limits: no bag may unpack to more memory or disk than the user allows."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.optional import Lazy

lz4_frame = Lazy('lz4.frame')
zstandard = Lazy('zstandard')

MIB = 1 << 20
LIMIT = 256 * MIB  # bytes that one chunk or one message may unpack to
RATIO = 100  # a file may unpack to so many times its own size, or to LIMIT if that is more
PIECE = 4 * MIB  # bytes unpacked at a time into a file


def damaged() -> tuple[type[Exception], ...]:
    """Return what damaged data raises when it is unpacked."""
    return zstandard.ZstdError, RuntimeError, ValueError, MemoryError


class TooLargeError(UserError):
    """Something would unpack to more than the user allows."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the option of every command that reads bags."""
    parser.add_argument(
        '--unpack-limit',
        metavar='MIB',
        type=_limit,
        default=LIMIT,
        help='most that a compressed chunk or message of the bag may unpack to '
        f'(default {LIMIT // MIB}); a compressed file may unpack to {RATIO} '
        'times its size if that is more',
    )


def _limit(text: str) -> int:
    """Bytes from a number of MiB on the command line."""
    value = float(text)  # argparse reports a ValueError
    if not (math.isfinite(value) and value > 0.0):
        raise UsageError(f'--unpack-limit {text}: it must be above 0 MiB')
    return int(value * MIB)


def check(what: str, size: int, limit: int) -> None:
    """Raise TooLargeError where `what` unpacks to more than `limit` bytes.

    Parameters
    ----------
    size : bytes that it declares or has.
    """
    if size > limit:
        raise TooLargeError(
            f'{what} unpacks to more than {limit / MIB:.6g} MiB: if you trust the '
            'bag, raise --unpack-limit'
        )


def declared(packed: bytes | memoryview) -> int | None:
    """Return the size [bytes] that a zstd frame declares; None where it declares none.

    Raises
    ------
    zstandard.ZstdError : it is no zstd frame.
    """
    size = zstandard.get_frame_parameters(packed).content_size
    return None if size in (zstandard.CONTENTSIZE_UNKNOWN, zstandard.CONTENTSIZE_ERROR) else size


def unpack(packed: bytes, compression: str, size: int) -> bytes:
    """Return the `size` bytes that `packed` holds; never more than these are unpacked.

    Raises
    ------
    one of DAMAGED : it holds another number of bytes, or is damaged.
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
    """Return what can be unpacked of a chunk whose end is missing, at most `size` bytes."""
    if compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(packed) as reader:
            return reader.read(size)
    if compression == 'lz4':
        return lz4_frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
    return packed[:size] if not compression else b''


def unpack_message(packed: memoryview, what: str, limit: int) -> bytes:
    """Return a message that was compressed by itself.

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
        raise zstandard.ZstdError('it is cut off')
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
