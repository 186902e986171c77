# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One MCAP file: described by the mcap library, the messages of its chunks read into arrays.

Without a summary (the recorder crashed, or the end of the file is missing), the records are read
one by one, as far as they are complete.
"""

from __future__ import annotations

import io
import mmap
import struct
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Schema
from numpy.typing import NDArray

from estimator_pkg.bags import qos, unpacking
from estimator_pkg.bags.reader import Bag, PendingBlock, Topic
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
ARRAY_BYTES = 96  # bytes in arrays for each message
WHOLE_FILE = -1  # the place of a file's messages outside of chunks


class McapFile:
    """An MCAP file that is open for reading; raises UserError if it has nothing readable."""

    SORTS = True

    def __init__(self, path: Path, bag: Bag) -> None:
        self._path, self._bag = path, bag
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        self._counts: dict[int, int] = {}  # messages by channel
        self._pieces: list[PendingBlock] = []
        with path.open('rb') as file:
            self._raw = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
            self._summarised = self._has_summary(file)
        if not self._summarised:
            self._scan()
        self._numbers = np.zeros(1 << 16, np.int64)  # of the bag's topics, by channel
        for channel in self._channels.values():
            self._numbers[channel.id] = bag.number(self._topic(channel))

    def close(self) -> None:
        """Do nothing: the file is unmapped with its last block."""

    def pieces(self, keep: np.ndarray) -> list[PendingBlock]:
        """Return all chunks."""
        return self._pieces

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

    def _has_summary(self, file: io.BufferedReader) -> bool:
        """Read the summary at the end of the file; return False without one that is complete."""
        try:
            found = SeekingReader(file).get_summary()
        except Exception:  # the library may raise anything for a damaged file
            return False
        if found is None or found.statistics is None:
            return False
        counts = found.statistics.channel_message_counts
        if (sum(counts.values()) and not found.chunk_indexes) or not (
            counts.keys() <= found.channels.keys()
        ):
            return False
        self._channels, self._schemas, self._counts = found.channels, found.schemas, counts
        self._pieces = [
            PendingBlock(
                each.message_start_time,
                each.uncompressed_size,
                partial(self._numbered, each.chunk_start_offset),
            )
            for each in found.chunk_indexes
        ]
        return True

    def _scan(self) -> None:
        """Read all records; warn if the end of the file is missing."""
        places, loose, whole, end = [], False, False, len(MAGIC)
        for opcode, start, end in _records(self._raw, len(MAGIC)):
            if opcode == Opcode.CHUNK:
                places.append(start - RECORD.size)
            elif opcode == Opcode.MESSAGE:
                loose = True
            elif opcode == Opcode.DATA_END:
                whole = True
                break
            else:
                self._learn(opcode, self._raw[start:end])
        if not whole and end + RECORD.size <= len(self._raw) and self._raw[end] == Opcode.CHUNK:
            places.append(end)  # its end is missing
        for place in [WHOLE_FILE] if loose else places:
            block = self._load(place)
            if len(block):
                load = partial(self._numbered, place)
                self._pieces.append(PendingBlock(int(block.log_ns[0]), len(block.data), load))
            for channel, count in zip(*np.unique(block.topic, return_counts=True)):
                self._counts[channel] = self._counts.get(channel, 0) + int(count)
        if not whole and not self._channels:
            raise UserError(f'{self._path} ends before its first message: name another file')
        if not whole:
            self._bag.warn(
                f'{self._path} ends early (was its recorder killed?): '
                f'reading the {sum(self._counts.values())} complete messages; {unpacking.REPAIR}'
            )

    def _learn(self, opcode: int, body: memoryview) -> None:
        """Read the record of a topic, if it is one, and no summary has them all."""
        stream = ReadDataStream(io.BytesIO(body))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                self._channels[channel.id] = channel
        except Exception:  # as above
            self._bag.warn(f'{self._path}: the description of a topic is damaged')

    def _numbered(self, at: int) -> Block:
        """As `_load`, with the numbers of the bag's topics."""
        block = self._load(at)
        return replace(block, topic=self._numbers[block.topic])

    def _load(self, at: int) -> Block:
        """Return the messages of the chunk at this byte; `topic` are channels that are known."""
        if at == WHOLE_FILE:
            what, data, first = str(self._path), np.frombuffer(self._raw, np.uint8), len(MAGIC)
        else:
            what, first = f'{self._path}: the chunk at byte {at}', 0
            data = self._unpacked(at, what)
        starts, shortest = array('q'), MESSAGE.itemsize - RECORD.size
        for opcode, start, end in _records(data.data, first):
            if opcode == Opcode.MESSAGE and end - start >= shortest:
                starts.append(start - RECORD.size)
            elif opcode != Opcode.MESSAGE and not self._summarised:
                self._learn(opcode, data.data[start:end])
        if at != WHOLE_FILE:  # which is not unpacked
            unpacking.check(what, len(data) + ARRAY_BYTES * len(starts), self._bag.limit)
        return self._block(data, np.frombuffer(starts, np.int64))

    def _unpacked(self, at: int, what: str) -> NDArray[np.uint8]:
        """Return the records of a chunk: none if it is damaged, the first ones if it is torn."""
        torn = False
        try:
            opcode, length = RECORD.unpack_from(self._raw, at)
            body = self._raw[at + RECORD.size : at + RECORD.size + length]
            torn = len(body) < length
            if opcode != Opcode.CHUNK:
                raise ValueError('no chunk starts here')
            chunk = Chunk.read(ReadDataStream(io.BytesIO(body)))
            unpacking.check(what, chunk.uncompressed_size, self._bag.limit)
            data = unpacking.unpack(chunk.data, chunk.compression, chunk.uncompressed_size + 1)
            if torn:
                return data
            if len(data) != chunk.uncompressed_size:
                raise ValueError('wrong size')
            if chunk.uncompressed_crc not in (0, zlib.crc32(data.data)):
                raise ValueError('wrong checksum')
            return data
        except unpacking.TooLargeError:
            raise
        except Exception as error:  # as above
            if not torn:
                self._bag.warn(f'{what} is damaged ({first_line(error)}), its messages are skipped')
            return np.zeros(0, np.uint8)

    def _block(self, data: NDArray[np.uint8], starts: NDArray[np.int64]) -> Block:
        """Return the messages of known channels whose records are at these bytes of `data`."""
        heads = rows(data, starts, MESSAGE.itemsize).view(MESSAGE)[:, 0]
        log_ns = np.minimum(heads['log_ns'], LATEST_NS).astype(np.int64)
        publish_ns = np.minimum(heads['publish_ns'], LATEST_NS).astype(np.int64)
        block = Block(
            heads['channel'].astype(np.int64),
            log_ns,
            np.where(publish_ns > 0, publish_ns, log_ns),
            data,
            starts + MESSAGE.itemsize,
            starts + RECORD.size + heads['length'].astype(np.int64),
        )
        known = np.isin(block.topic, list(self._channels))
        strange = np.count_nonzero(~known)
        if strange:
            self._bag.warn(
                f'{self._path} is damaged: {strange} messages have no topic and are skipped'
            )
            block = block.take(known)
        return block.in_log_order()


def _records(view: memoryview, at: int) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, start, end of its body) of the complete records from `at` on."""
    while at + RECORD.size <= len(view):
        opcode, length = RECORD.unpack_from(view, at)
        start = at + RECORD.size
        at = start + length
        if at > len(view) or not opcode:  # 0: the file was truncated and padded
            return
        yield opcode, start, at
