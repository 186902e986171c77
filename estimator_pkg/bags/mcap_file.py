# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One MCAP file: opened and indexed by the mcap library, its chunks read as blocks.

A chunk's messages are found through its message index, all at once. If there is no index (the
recorder crashed, or the end of the file is missing), the records are read one by one, as far as
they are complete.
"""

from __future__ import annotations

import io
import mmap
import struct
import zlib
from array import array
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, ChunkIndex, Schema
from numpy.typing import NDArray

from estimator_pkg.bags import unpacking
from estimator_pkg.errors import UserError, first_line
from estimator_pkg.messages.block import Block, rows

MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')  # opcode, length of the body
_CHUNK = struct.Struct('<QQQII')  # start, end, size, checksum, length of the next text
LAST = np.uint64(2**63 - 1)  # [ns] later times than in 2262 are wrong
MESSAGE = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log_ns', '<u8'),
        ('publish_ns', '<u8'),
    ]
)  # packed: 31 bytes
LARGEST = 1 << 32  # allowed size of a chunk [bytes]
CHANNELS = 1 << 16  # allowed number of channels
_FIXED = MESSAGE.itemsize - _RECORD.size  # length of a message record's body without the payload


class _Part(NamedTuple):
    """A chunk, or all records of a file without chunks."""

    at: int  # position of the chunk record; -1: the file has no chunks
    start_ns: int
    index_size: int  # bytes of message index after the chunk; 0: none
    size: int = 0  # bytes of the chunk's records by the index; 0: not declared


class McapFile:
    """An MCAP file that is open for reading.

    Attributes
    ----------
    channels, schemas : by id, in the form of the mcap library.
    counts : channel id -> number of messages.
    metadata : the metadata records by name.

    Parameters
    ----------
    limit : bytes that a chunk may unpack to.

    Raises
    ------
    UserError : it is empty, not an MCAP file, or contains nothing readable.
    """

    def __init__(
        self, path: Path, warn: Callable[[str], None], limit: int = unpacking.LIMIT
    ) -> None:
        self.path = path
        self._warn = warn
        self._limit = limit
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.counts: dict[int, int] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self._parts: list[_Part] = []
        self._file = path.open('rb')  # closed by `close`
        self._size = path.stat().st_size
        try:
            self._open()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _open(self) -> None:
        start = self._file.read(len(MAGIC))
        if not start:
            raise UserError(f'{self.path} is empty (0 bytes): name another file')
        if start != MAGIC:
            raise UserError(f'{self.path} is not an MCAP file: it starts with other bytes')
        if not self._indexed():
            self._scan()

    def _indexed(self) -> bool:
        """Open through the summary at the end of the file; return False without a summary."""
        try:
            self._file.seek(0)
            reader = SeekingReader(self._file)
            summary = reader.get_summary()
            if summary is None or summary.statistics is None or not summary.chunk_indexes:
                return False
            if any(
                channel not in summary.channels
                for channel in summary.statistics.channel_message_counts
            ):
                return False
            for metadata in reader.iter_metadata():
                self.metadata[metadata.name] = metadata.metadata
        except Exception:  # the library may raise anything for a damaged file: read its records
            return False
        self.channels, self.schemas = dict(summary.channels), dict(summary.schemas)
        self.counts = dict(summary.statistics.channel_message_counts)
        self._parts = [_part(index) for index in summary.chunk_indexes]
        return True

    def _scan(self) -> None:
        """Read all records; warn if the end of the file is missing."""
        size = self._size
        at, whole, loose = len(MAGIC), False, False
        view = memoryview(mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ))
        end = size
        while at + _RECORD.size <= size:
            opcode, length = _RECORD.unpack_from(view, at)
            body = at + _RECORD.size
            if opcode == Opcode.CHUNK:
                self._parts.append(_Part(at, 0, 0))
            elif opcode == Opcode.MESSAGE:
                loose = True
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and body + length <= size:
                self._learn(opcode, view[body : body + length])
            elif opcode == Opcode.DATA_END:
                whole = True
                end = at
                break
            elif opcode == 0:  # not a record: the file was truncated and padded
                end = at
                break
            at = body + length
        if loose:
            self._parts = [_Part(-1, 0, end)]  # here the index size is the end of the data
        found = []
        for part in self._parts:
            block = self._load(part)
            if len(block):
                found.append(part._replace(start_ns=int(block.log_ns.min()), size=len(block.data)))
                for channel, count in zip(
                    *(array.tolist() for array in np.unique(block.topic, return_counts=True))
                ):
                    if channel in self.channels:
                        self.counts[channel] = self.counts.get(channel, 0) + count
        self._parts = found
        if not whole and not self.channels:
            raise UserError(
                f'{self.path} ends before its first message: there is nothing to recover'
            )
        if not whole:
            self._warn(
                f'{self.path} ends early (was its recorder killed?): '
                f'reading the {sum(self.counts.values())} complete messages'
            )

    def _learn(self, opcode: int, body: memoryview) -> None:
        stream = ReadDataStream(io.BytesIO(body))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self.schemas[schema.id] = schema
            else:
                channel = Channel.read(stream)
                self.channels[channel.id] = channel
        except (struct.error, UnicodeDecodeError, EndOfFile):
            self._warn(f'{self.path}: the description of a topic is damaged')

    def parts(self) -> Iterator[tuple[int, int, Callable[[], Block]]]:
        """Yield (time of its first message, bytes, function that reads it) for every chunk.

        In the blocks `topic` is the channel id.
        """
        for part in self._parts:
            yield part.start_ns, part.size, partial(self._load, part)

    def _load(self, part: _Part) -> Block:
        if part.at < 0:
            whole = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
            data = np.frombuffer(whole, np.uint8)[: part.index_size]
            return self._block(data, self._walk(data, len(MAGIC))[0])
        try:
            data, cut = self._chunk(part)
        except unpacking.TooLargeError:
            raise
        except UserError as error:
            self._warn(str(error))
            data, cut = np.zeros(0, np.uint8), False
        indexed = self._indexed_offsets(part) if len(data) else None
        if indexed is not None and self._complete(indexed, data):
            return self._block(data, indexed)
        walked, end = self._walk(data, 0)
        if not cut and (end < len(data) or (indexed is not None and len(walked) != len(indexed))):
            self._warn(
                f'{self.path}: the chunk at byte {part.at} is damaged: only {len(walked)} '
                'of its messages can be read'
            )
        return self._block(data, walked)

    def _chunk(self, part: _Part) -> tuple[NDArray[np.uint8], bool]:
        """Return the chunk's unpacked records, and True if its end is missing."""

        def damaged(why: str) -> UserError:
            return UserError(
                f'{self.path}: the chunk at byte {part.at} is damaged ({why}), '
                'its messages are skipped'
            )

        self._file.seek(min(part.at, self._size))
        head = self._file.read(_RECORD.size + _CHUNK.size)
        if len(head) < _RECORD.size + _CHUNK.size or head[0] != Opcode.CHUNK:
            raise damaged('no chunk starts here')
        _, _, size, checksum, text = _CHUNK.unpack_from(head, _RECORD.size)
        size = min(size, part.size or size)
        if size > LARGEST or text > 64:
            raise damaged('wrong size')
        rest = self._file.read(text + 8)
        compression = rest[:text].decode('utf-8', 'replace')
        packed_size = int.from_bytes(rest[text:], 'little')
        if packed_size > LARGEST:
            raise damaged('wrong size')
        packed = self._read(packed_size) if len(rest) == text + 8 else b''
        try:
            cut = len(packed) < packed_size
            unpacking.check(f'{self.path}: the chunk at byte {part.at}', size, self._limit)
            data: Any = unpacking.unpack(packed, compression, size + 1, torn=cut)
            if len(data) != size and not cut:
                raise ValueError('wrong size')
        except unpacking.damaged() as error:
            raise damaged(first_line(error)) from error
        if checksum and not cut and zlib.crc32(data) != checksum:
            raise damaged('wrong checksum')
        return data, cut

    def _read(self, size: int) -> bytes:
        """Read `size` bytes, or up to the end: a damaged size must not use all the memory."""
        return self._file.read(min(size, self._size))

    def _indexed_offsets(self, part: _Part) -> NDArray[np.int64] | None:
        """Return the offsets of message records by the chunk's index; None if there is no index.

        The file must have been read up to the end of the chunk, because the index follows it.
        """
        raw = self._read(part.index_size)
        at, found = 0, []
        while at + _RECORD.size + 6 <= len(raw):
            opcode, length = _RECORD.unpack_from(raw, at)
            if opcode == Opcode.MESSAGE_INDEX:
                count = int.from_bytes(raw[at + 11 : at + 15], 'little') // 16
                if at + 15 + 16 * count > len(raw):
                    return None
                found.append(np.frombuffer(raw, '<u8', 2 * count, at + 15)[1::2])
            at += _RECORD.size + length
        return np.sort(np.concatenate(found).astype(np.int64)) if found else None

    def _complete(self, offsets: NDArray[np.int64], data: NDArray[np.uint8]) -> bool:
        """Return True if message records are at the offsets, and nowhere else in `data`."""
        if not len(offsets) or offsets[0] < 0 or offsets[-1] > len(data) - MESSAGE.itemsize:
            return False
        heads = rows(data, offsets, _RECORD.size)
        lengths = heads[:, 1:].copy().view('<u8')[:, 0].astype(np.int64)
        if np.any(heads[:, 0] != Opcode.MESSAGE) or lengths.min() < _FIXED:
            return False
        before = np.concatenate([[0], offsets + _RECORD.size + lengths])
        after = np.concatenate([offsets, [len(data)]])
        return not np.any(before > after) and not any(
            len(self._walk(data[: after[gap]], int(before[gap]))[0])
            for gap in np.flatnonzero(before != after)
        )

    def _walk(self, data: NDArray[np.uint8], at: int) -> tuple[NDArray[np.int64], int]:
        """Return the offsets of message records in `data` from `at` on, and where they end."""
        view = data.data
        size, found = len(view), array('q')
        while at + _RECORD.size <= size:
            opcode, length = _RECORD.unpack_from(view, at)
            after = at + _RECORD.size + length
            if after > size or opcode == 0:
                break
            if opcode == Opcode.MESSAGE:
                if length >= _FIXED:
                    found.append(at)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._learn(opcode, view[at + _RECORD.size : after])
            at = after
        return np.array(found, np.int64), at

    def _block(self, data: NDArray[np.uint8], offsets: NDArray[np.int64]) -> Block:
        heads = rows(data, offsets, MESSAGE.itemsize).view(MESSAGE)[:, 0]
        log_ns = np.minimum(heads['log_ns'], LAST).astype(np.int64)
        publish_ns = np.minimum(heads['publish_ns'], LAST).astype(np.int64)
        start = offsets + MESSAGE.itemsize
        known = np.zeros(CHANNELS, bool)
        known[list(self.channels)] = True
        strangers = int(np.count_nonzero(~known[heads['channel']]))
        if strangers:
            self._warn(
                f'{self.path} is damaged: {strangers} messages have no topic and are skipped'
            )
        return Block(
            heads['channel'].astype(np.int64),
            log_ns,
            np.where(publish_ns > 0, publish_ns, log_ns),
            data,
            start,
            start + heads['length'].astype(np.int64) - _FIXED,
        ).in_log_order()


def _part(index: ChunkIndex) -> _Part:
    return _Part(
        index.chunk_start_offset,
        index.message_start_time,
        index.message_index_length,
        index.uncompressed_size,
    )
