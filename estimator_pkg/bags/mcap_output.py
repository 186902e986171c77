# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes one MCAP file, block by block: the mcap library's records, our own message framing."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

from estimator_pkg import __version__
from estimator_pkg.bags.mcap_file import MAGIC, MESSAGE
from estimator_pkg.messages.block import Block

CHUNK_SIZE = 1 << 20  # bytes of messages per chunk, before compression
LEVEL = 1  # compression level of zstd
FEW_LENGTHS = 16  # with more message lengths than this, messages are copied one by one


class McapOutput:
    """An MCAP file that is being written. The same calls write the same bytes.

    Parameters
    ----------
    stream : open for writing, at its start.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._at = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._new: list[Schema | Channel] = []  # not yet in a chunk
        self._chunks: list[ChunkIndex] = []
        self._compressor = zstandard.ZstdCompressor(level=LEVEL)
        self.counts: dict[int, int] = {}
        self.start_ns = 0
        self.end_ns = 0
        self._put(MAGIC)
        self._record(Header('ros2', f'velocity_estimator {__version__}'))

    def add_channel(
        self,
        topic: str,
        type_name: str,
        encoding: str,
        definition: str,
        metadata: Mapping[str, str],
        serialization: str,
    ) -> int:
        """Add a channel; return its id."""
        schema = next((item for item in self._schemas if item.name == type_name), None)
        if schema is None:
            schema = Schema(
                id=len(self._schemas) + 1,
                name=type_name,
                encoding=encoding if definition else '',
                data=definition.encode(),
            )
            self._schemas.append(schema)
            self._new.append(schema)
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=serialization,
            metadata=dict(metadata),
            schema_id=schema.id,
        )
        self._channels.append(channel)
        self._new.append(channel)
        self.counts[channel.id] = 0
        return channel.id

    def write(self, block: Block) -> None:
        """Write messages, whose `topic` are channel ids, as one or more chunks."""
        sizes = np.cumsum(block.end - block.start + MESSAGE.itemsize)
        done = 0
        while done < len(block):
            before = sizes[done - 1] if done else 0
            upto = max(int(np.searchsorted(sizes, before + CHUNK_SIZE, 'right')), done + 1)
            self._write_chunk(block.take(slice(done, upto)))
            done = upto

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Write the end of the file: the metadata record and the summary."""
        if self._new:  # topics without messages
            self._write_chunk(None)
        metadata_at = self._at
        self._record(Metadata(name='rosbag2', metadata=dict(metadata)))
        metadata_size = self._at - metadata_at
        self._record(DataEnd(0))
        summary_start = self._at
        builder = RecordBuilder()
        offsets = []
        statistics = Statistics(
            message_count=sum(self.counts.values()),
            schema_count=len(self._schemas),
            channel_count=len(self._channels),
            attachment_count=0,
            metadata_count=1,
            chunk_count=len(self._chunks),
            message_start_time=self.start_ns,
            message_end_time=self.end_ns,
            channel_message_counts={key: count for key, count in self.counts.items() if count},
        )
        index = MetadataIndex(offset=metadata_at, length=metadata_size, name='rosbag2')
        for opcode, records in (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, [index]),
        ):
            start = builder.count
            for record in records:  # type: ignore[attr-defined]  # lists of several record types
                record.write(builder)
            if builder.count > start:
                offsets.append(SummaryOffset(opcode, summary_start + start, builder.count - start))
        offset_start = summary_start + builder.count
        for offset in offsets:
            offset.write(builder)
        self._put(builder.end())
        self._record(Footer(summary_start, offset_start, 0))
        self._put(MAGIC)

    def _write_chunk(self, block: Block | None) -> None:
        builder = RecordBuilder()
        for record in self._new:
            record.write(builder)
        self._new = []
        data = builder.end()
        indices = b''
        index_offsets: dict[int, int] = {}
        start_ns = end_ns = 0
        if block is not None:
            block = replace(block, log_ns=np.maximum(block.log_ns, 0))  # as of a damaged bag
            messages, starts = frame(block)
            starts += len(data)
            data += messages.tobytes()
            start_ns, end_ns = int(block.log_ns.min()), int(block.log_ns.max())
            if not any(self.counts.values()):
                self.start_ns = start_ns
            self.start_ns = min(self.start_ns, start_ns)
            self.end_ns = max(self.end_ns, end_ns)
            for channel in np.unique(block.topic).tolist():
                mine = block.topic == channel
                index_offsets[channel] = len(indices)
                indices += _index(channel, block.log_ns[mine], starts[mine])
                self.counts[channel] += int(mine.sum())
        packed = self._compressor.compress(data)
        at = self._at
        self._record(
            Chunk(
                compression='zstd',
                data=packed,
                message_start_time=start_ns,
                message_end_time=end_ns,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        size = self._at - at
        self._chunks.append(
            ChunkIndex(
                chunk_length=size,
                chunk_start_offset=at,
                compression='zstd',
                compressed_size=len(packed),
                message_end_time=end_ns,
                message_index_length=len(indices),
                message_index_offsets={
                    key: self._at + offset for key, offset in index_offsets.items()
                },
                message_start_time=start_ns,
                uncompressed_size=len(data),
            )
        )
        self._put(indices)

    def _record(self, record: Header | Metadata | DataEnd | Footer | Chunk) -> None:
        builder = RecordBuilder()
        record.write(builder)
        self._put(builder.end())

    def _put(self, data: bytes) -> None:
        self._stream.write(data)
        self._at += len(data)


def frame(block: Block) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return the message records of a block, one after the other, and the start of each.

    The records are bytes, shape (size,); a start is an index of them, shape (n,).
    """
    lengths = block.end - block.start
    heads = np.zeros(len(block), MESSAGE)
    heads['opcode'] = Opcode.MESSAGE
    heads['length'] = lengths + (MESSAGE.itemsize - 9)
    heads['channel'] = block.topic
    heads['log_ns'] = block.log_ns
    heads['publish_ns'] = block.publish_ns
    ends = np.cumsum(lengths + MESSAGE.itemsize)
    starts = ends - lengths - MESSAGE.itemsize
    out = np.empty(int(ends[-1]), np.uint8)
    _rows(out, MESSAGE.itemsize)[starts] = heads.view(np.uint8).reshape(len(block), -1)
    bodies = starts + MESSAGE.itemsize
    kinds = np.unique(lengths)
    if len(kinds) <= FEW_LENGTHS:
        for length in kinds.tolist():
            if length:
                mine = lengths == length
                _rows(out, length)[bodies[mine]] = _rows(block.data, length)[block.start[mine]]
    else:
        target, source = out.data, block.data.data
        for body, start, length in zip(bodies.tolist(), block.start.tolist(), lengths.tolist()):
            target[body : body + length] = source[start : start + length]
    return out, starts


def _rows(data: NDArray[np.uint8], length: int) -> NDArray[np.uint8]:
    return np.lib.stride_tricks.as_strided(data, (len(data) - length + 1, length), (1, 1))


def _index(channel: int, log_ns: NDArray[np.int64], starts: NDArray[np.int64]) -> bytes:
    pairs = np.stack([log_ns, starts], axis=1).astype('<u8').tobytes()
    return (
        bytes([Opcode.MESSAGE_INDEX])
        + (6 + len(pairs)).to_bytes(8, 'little')
        + channel.to_bytes(2, 'little')
        + len(pairs).to_bytes(4, 'little')
        + pairs
    )
