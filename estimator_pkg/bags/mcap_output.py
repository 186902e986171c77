# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes one MCAP file, block by block: the mcap library's records around messages in arrays.

The library's own writer takes single messages, which takes three times as long, and ends a chunk
only when it is full, so that a killed recorder would lose more than its last two seconds. That of
rosbags keeps no time of publishing, from which a replay of messages without stamps is made.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace
from typing import BinaryIO

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from numpy.typing import NDArray

from estimator_pkg import __version__
from estimator_pkg.bags import qos
from estimator_pkg.bags.mcap_file import MAGIC, MESSAGE, RECORD
from estimator_pkg.bags.source import Topic
from estimator_pkg.messages.block import Block

CHUNK_SIZE = 1 << 20  # bytes of messages per chunk, before compression
ZSTD_LEVEL = 1  # compression level of zstd


class McapOutput:
    """An MCAP file that is being written. The same calls write the same bytes.

    Parameters
    ----------
    stream : open for writing, at its start.

    Attributes
    ----------
    statistics : number of messages, also by channel, and their first and last time.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._at = 0  # position in the stream
        self._schemas: dict[str, records.Schema] = {}
        self._channels: list[records.Channel] = []
        self._chunks: list[records.ChunkIndex] = []
        self._compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        self.statistics = records.Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
        self._put(MAGIC)
        self._record(records.Header('ros2', f'velocity_estimator {__version__}'))

    def add_channel(self, topic: Topic) -> int:
        """Add a channel; return its id."""
        schema = self._schemas.get(topic.type)
        if schema is None:
            schema = records.Schema(
                id=len(self._schemas) + 1,
                name=topic.type,
                encoding=topic.definition_format if topic.definition else '',
                data=topic.definition.encode(),
            )
            self._schemas[topic.type] = schema
            self._record(schema)
        channel = records.Channel(
            id=len(self._channels) + 1,
            topic=topic.name,
            message_encoding=topic.serialization,
            metadata={
                'offered_qos_profiles': qos.to_text(topic.qos),
                'topic_type_hash': topic.type_hash,
            },
            schema_id=schema.id,
        )
        self._channels.append(channel)
        self._record(channel)
        self.statistics.channel_message_counts[channel.id] = 0
        return channel.id

    def write(self, block: Block) -> None:
        """Write messages, whose `topic` are channel ids, as one or more chunks."""
        block = replace(block, log_ns=np.maximum(block.log_ns, 0))  # negative in a damaged bag
        sizes = np.cumsum(block.end - block.start + MESSAGE.itemsize)
        done = 0
        while done < len(block):
            before = sizes[done - 1] if done else 0
            upto = max(int(np.searchsorted(sizes, before + CHUNK_SIZE, 'right')), done + 1)
            self._write_chunk(block.take(slice(done, upto)))
            done = upto

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Write the end of the file: the metadata record and the summary."""
        index = records.MetadataIndex(offset=self._at, length=0, name='rosbag2')
        self._record(records.Metadata(name='rosbag2', metadata=dict(metadata)))
        index.length = self._at - index.offset
        self._record(records.DataEnd(0))
        self.statistics.schema_count = len(self._schemas)
        self.statistics.channel_count = len(self._channels)
        self.statistics.metadata_count = 1
        self.statistics.chunk_count = len(self._chunks)
        start = self._at
        self._record(
            *self._schemas.values(),
            *self._channels,
            self.statistics,
            *self._chunks,
            index,
            records.Footer(start, 0, 0),
        )
        self._put(MAGIC)

    def _write_chunk(self, block: Block) -> None:
        """Write messages as a chunk, and the message index of each channel behind it."""
        messages, starts = frame(block)
        data = messages.tobytes()
        packed = self._compressor.compress(data)
        times = {
            'message_start_time': int(block.log_ns.min()),
            'message_end_time': int(block.log_ns.max()),
        }
        at = self._at
        self._record(
            records.Chunk(
                compression='zstd',
                data=packed,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
                **times,
            )
        )
        end, found, offsets = self._at, self.statistics, {}
        for channel in np.unique(block.topic).tolist():
            mine = block.topic == channel
            found.channel_message_counts[channel] += int(mine.sum())
            offsets[channel] = self._at
            self._put(_index(channel, block.log_ns[mine], starts[mine]))
        index = records.ChunkIndex(
            chunk_length=end - at,
            chunk_start_offset=at,
            compression='zstd',
            compressed_size=len(packed),
            message_index_length=self._at - end,
            message_index_offsets=offsets,
            uncompressed_size=len(data),
            **times,
        )
        self._chunks.append(index)
        first = found.message_start_time if found.message_count else index.message_start_time
        found.message_start_time = min(first, index.message_start_time)
        found.message_end_time = max(found.message_end_time, index.message_end_time)
        found.message_count += len(block)

    def _record(self, *group: records.McapRecord) -> None:
        builder = RecordBuilder()
        for record in group:
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
    heads['length'] = lengths + (MESSAGE.itemsize - RECORD.size)
    heads['channel'] = block.topic
    heads['log_ns'] = block.log_ns
    heads['publish_ns'] = block.publish_ns
    ends = np.cumsum(lengths + MESSAGE.itemsize)
    bodies = ends - lengths
    starts = bodies - MESSAGE.itemsize
    out = np.empty(int(ends[-1]), np.uint8)
    _windows(out, MESSAGE.itemsize)[starts] = heads.view(np.uint8).reshape(len(block), -1)
    for length in np.unique(lengths[lengths > 0]).tolist():
        mine = lengths == length
        _windows(out, length)[bodies[mine]] = _windows(block.data, length)[block.start[mine]]
    return out, starts


def _windows(data: NDArray[np.uint8], length: int) -> NDArray[np.uint8]:
    return np.lib.stride_tricks.as_strided(data, (len(data) - length + 1, length), (1, 1))


def _index(channel: int, log_ns: NDArray[np.int64], starts: NDArray[np.int64]) -> bytes:
    """Return the message index record of a channel; the library's takes a list of tuples."""
    pairs = np.stack([log_ns, starts], axis=1).astype('<u8').tobytes()
    head = RECORD.pack(Opcode.MESSAGE_INDEX, 6 + len(pairs))
    return head + channel.to_bytes(2, 'little') + len(pairs).to_bytes(4, 'little') + pairs
