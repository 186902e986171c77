# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One MCAP file: opened and indexed by the mcap library, its chunks read as blocks.

The messages of a chunk are found through its message index, all at once. If there is no index (the
recorder crashed, or the end of the file is missing), the records are read one by one, as far as
they are complete.
"""

from __future__ import annotations

import io
import mmap
import struct
import zlib
from array import array
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Schema
from numpy.typing import NDArray

from estimator_pkg.bags import qos, unpacking
from estimator_pkg.bags.source import REPAIR, PendingBlock, Topic
from estimator_pkg.errors import UserError, first_line
from estimator_pkg.messages.block import Block, rows

MAGIC = b'\x89MCAP0\r\n'
RECORD = struct.Struct('<BQ')  # opcode, length of the body
MESSAGE = np.dtype(
    {
        'names': ['opcode', 'length', 'channel', 'sequence', 'log_ns', 'publish_ns'],
        'formats': ['u1', '<u8', '<u2', '<u4', '<u8', '<u8'],
    }
)  # a message record without its payload; packed: 31 bytes
LATEST_NS = np.uint64(2**63 - 1)  # [ns] later times than in 2262 are wrong
LARGEST_CHUNK = 1 << 32  # allowed size of a chunk [bytes]
ARRAY_BYTES = 96  # bytes in arrays for each message


class _Chunk(NamedTuple):
    """Place of a chunk in the file; -1: of all records of a file without chunks."""

    at: int
    start_ns: int = 0
    size: int = 0  # bytes of its records; 0: as it declares
    index_size: int = 0  # bytes of message index behind it


class McapFile:
    """An MCAP file that is open for reading; see `estimator_pkg.bags.source`.

    Parameters
    ----------
    limit : bytes that a chunk may unpack to.

    Raises
    ------
    UserError : it contains nothing readable.
    """

    sorts = True

    def __init__(self, path: Path, warn: Callable[[str], None], limit: int) -> None:
        self.path = path
        self._warn = warn
        self._limit = limit
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        self._counts: dict[int, int] = {}  # messages by channel
        self._places = np.full(1 << 16, -1)  # in `topics`, by channel
        self._chunks: list[_Chunk] = []
        self._file = path.open('rb')  # closed by `close`
        self._size = path.stat().st_size
        self._summarised = self._has_summary()
        try:
            if not self._summarised:
                self._scan()
        except BaseException:
            self.close()
            raise
        self.topics = [self._topic(channel) for channel in self._channels.values()]

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def pieces(self, places: Sequence[int]) -> Iterator[PendingBlock]:
        """Yield all chunks."""
        for chunk in self._chunks:
            yield PendingBlock(chunk.start_ns, chunk.size, partial(self._load, chunk))

    def _topic(self, channel: Channel) -> Topic:
        schema = self._schemas.get(channel.schema_id)
        return Topic(
            channel.topic,
            schema.name if schema else '',
            self._counts.get(channel.id, 0),
            qos.of_text(channel.metadata.get('offered_qos_profiles', '')),
            schema.data.decode('utf-8', 'replace') if schema else '',
            channel.metadata.get('topic_type_hash', ''),
            schema.encoding if schema else '',
            channel.message_encoding,
        )

    def _has_summary(self) -> bool:
        """Open through the summary at the end of the file; return False without a summary."""
        try:
            summary = SeekingReader(self._file).get_summary()
        except Exception:  # the library may raise anything for a damaged file
            return False
        if summary is None or summary.statistics is None or not summary.chunk_indexes:
            return False
        counts = summary.statistics.channel_message_counts
        if not counts.keys() <= summary.channels.keys():
            return False
        self._channels, self._schemas = summary.channels, summary.schemas
        self._counts = counts
        self._places[list(self._channels)] = range(len(self._channels))
        self._chunks = [
            _Chunk(
                index.chunk_start_offset,
                index.message_start_time,
                index.uncompressed_size,
                index.message_index_length,
            )
            for index in summary.chunk_indexes
        ]
        return True

    def _scan(self) -> None:
        """Read all records; warn if the end of the file is missing."""
        found, loose, whole, end = [], False, False, len(MAGIC)
        view = self._mapped()
        for opcode, start, end in _records(view, len(MAGIC)):
            if opcode == Opcode.CHUNK:
                found.append(_Chunk(start))
            elif opcode == Opcode.MESSAGE:
                loose = True
            elif opcode == Opcode.DATA_END:
                whole = True
                break
            else:
                self._learn(opcode, view[start + RECORD.size : end])
        if not whole and end + RECORD.size <= self._size and view[end] == Opcode.CHUNK:
            found.append(_Chunk(end))  # its end is missing
        if loose:
            found = [_Chunk(-1, size=end)]
        for chunk in found:
            block = self._load(chunk)
            if len(block):
                start_ns, size = int(block.log_ns.min()), len(block.data)
                self._chunks.append(chunk._replace(start_ns=start_ns, size=size))
            for channel, count in zip(self._channels, np.bincount(block.topic).tolist()):
                self._counts[channel] = self._counts.get(channel, 0) + count
        if not whole and not self._channels:
            raise UserError(f'{self.path} ends before its first message: name another file')
        if not whole:
            self._warn(
                f'{self.path} ends early (was its recorder killed?): '
                f'reading the {sum(self._counts.values())} complete messages; {REPAIR}'
            )

    def _mapped(self) -> memoryview:
        return memoryview(mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ))

    def _learn(self, opcode: int, body: memoryview) -> None:
        """Read the record of a topic, if it is one, and no summary has them all."""
        stream = ReadDataStream(io.BytesIO(body))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL and not self._summarised:
                channel = Channel.read(stream)
                self._channels[channel.id] = channel
                self._places[list(self._channels)] = range(len(self._channels))
        except Exception:  # as above
            self._warn(f'{self.path}: the description of a topic is damaged')

    def _load(self, chunk: _Chunk) -> Block:
        """Return the messages of a chunk that belong to a topic."""
        if chunk.at < 0:
            data = np.frombuffer(self._mapped(), np.uint8)[: chunk.size]
            return self._block(data, self._walk(data, len(MAGIC))[0])
        data, torn = self._unpacked(chunk)
        indexed = self._indexed(chunk, data)
        if indexed is not None:
            return indexed
        offsets, end = self._walk(data, 0)
        what = f'{self.path}: the chunk at byte {chunk.at}'
        if end < len(data) and not torn:
            self._warn(f'{what} is damaged: only {len(offsets)} of its messages can be read')
        unpacking.check(what, len(data) + ARRAY_BYTES * len(offsets), self._limit)
        return self._block(data, offsets)

    def _unpacked(self, chunk: _Chunk) -> tuple[NDArray[np.uint8], bool]:
        """Return the chunk's records, and True if its end is missing; none if it is damaged.

        Then the file has been read up to the end of the chunk.
        """
        what, torn = f'{self.path}: the chunk at byte {chunk.at}', False
        try:
            self._file.seek(chunk.at)
            opcode, length = RECORD.unpack(self._file.read(RECORD.size))
            torn = chunk.at + RECORD.size + length > self._size
            if opcode != Opcode.CHUNK:
                raise ValueError('no chunk starts here')
            found = Chunk.read(ReadDataStream(self._file))
            size = found.uncompressed_size
            if size > (chunk.size or LARGEST_CHUNK) and not torn:
                raise ValueError('wrong size')
            unpacking.check(what, size, self._limit)
            data = unpacking.unpack(found.data, found.compression, size + 1, torn=torn)
            if len(data) != size and not torn:
                raise ValueError('wrong size')
            if not torn and found.uncompressed_crc not in (0, zlib.crc32(data.data)):
                raise ValueError('wrong checksum')
            return data[:size], torn
        except unpacking.TooLargeError:
            raise
        except Exception as error:  # as above
            if not torn:
                self._warn(f'{what} is damaged ({first_line(error)}), its messages are skipped')
            return np.zeros(0, np.uint8), torn

    def _indexed(self, chunk: _Chunk, data: NDArray[np.uint8]) -> Block | None:
        """Return the messages that the chunk's index names; None if it does not name them all."""
        raw = self._file.read(min(chunk.index_size, self._size))
        found = [np.zeros(0, np.uint64)]
        for opcode, start, end in _records(raw, 0):
            if opcode == Opcode.MESSAGE_INDEX:
                count = max(end - start - 15, 0) // 16  # pairs of time and offset
                found.append(np.frombuffer(raw, '<u8', 2 * count, start + 15)[1::2])
        offsets = np.sort(np.concatenate(found).astype(np.int64))
        if not len(offsets) or offsets[0] < 0 or offsets[-1] > len(data) - MESSAGE.itemsize:
            return None
        heads = rows(data, offsets, MESSAGE.itemsize).view(MESSAGE)[:, 0]
        ends = offsets + RECORD.size + heads['length'].astype(np.int64)
        before, end = self._walk(data[: offsets[0]], 0)
        whole = (
            np.all(heads['opcode'] == Opcode.MESSAGE)
            and np.all(ends - offsets >= MESSAGE.itemsize)
            and np.array_equal(ends, np.append(offsets[1:], len(data)))
            and not len(before)
            and end == offsets[0]
        )
        return self._block(data, offsets, heads) if whole else None

    def _walk(self, data: NDArray[np.uint8], at: int) -> tuple[NDArray[np.int64], int]:
        """Return the offsets of message records in `data` from `at` on, and where they end."""
        view, end, found = data.data, at, array('q')
        for opcode, start, end in _records(view, at):
            if opcode != Opcode.MESSAGE:
                self._learn(opcode, view[start + RECORD.size : end])
            elif end - start >= MESSAGE.itemsize:
                found.append(start)
        return np.frombuffer(found, np.int64), end

    def _block(
        self, data: NDArray[np.uint8], offsets: NDArray[np.int64], heads: Any = None
    ) -> Block:
        """Return the messages of known topics whose records are at `offsets`."""
        if heads is None:
            heads = rows(data, offsets, MESSAGE.itemsize).view(MESSAGE)[:, 0]
        log_ns = np.minimum(heads['log_ns'], LATEST_NS).astype(np.int64)
        publish_ns = np.minimum(heads['publish_ns'], LATEST_NS).astype(np.int64)
        block = Block(
            self._places[heads['channel']],
            log_ns,
            np.where(publish_ns > 0, publish_ns, log_ns),
            data,
            offsets + MESSAGE.itemsize,
            offsets + RECORD.size + heads['length'].astype(np.int64),
        ).in_log_order()
        strange = np.count_nonzero(block.topic < 0)
        if strange:
            self._warn(f'{self.path} is damaged: {strange} messages have no topic and are skipped')
            block = block.take(block.topic >= 0)
        return block


def _records(view: bytes | memoryview, at: int) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, start, end) of the complete records from `at` on."""
    while at + RECORD.size <= len(view):
        opcode, length = RECORD.unpack_from(view, at)
        end = at + RECORD.size + length
        if end > len(view) or not opcode:  # 0: the file was truncated and padded
            return
        yield opcode, at, end
        at = end
