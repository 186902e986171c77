# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags of every kind for tests, made with the libraries that others use."""

from __future__ import annotations

import resource
import shutil
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.joint_state import TYPE, Encoder

STATES = '/joint_states'
OTHER = '/chatter'
TEXT = 'std_msgs/msg/String'
STORE = get_typestore(Stores.ROS2_JAZZY)
START = 1_700_000_000_000_000_000


def text(content: str) -> bytes:
    return bytes(STORE.serialize_cdr(STORE.types[TEXT](content), TEXT))


def content(count: int = 50, step_ns: int = 1_000_000) -> list[tuple[str, int, bytes]]:
    """(topic, log time, bytes) of joint states with texts of different lengths among them."""
    encode = Encoder().encode
    found = []
    for i in range(count):
        now = START + i * step_ns
        found.append((STATES, now, encode(now - 100, 'base', ['a', 'b'], [0.01 * i, -0.02 * i])))
        if i % 3 == 0:
            found.append((OTHER, now, text('x' * (i % 7))))
    return found


def types(messages) -> dict[str, str]:
    return {topic: TYPE if topic == STATES else TEXT for topic, _, _ in messages}


def ours(path: Path, messages) -> Path:
    with BagWriter(path) as bag:
        for topic, kind in types(messages).items():
            bag.add_topic(topic, kind)
        for topic, log_ns, raw in messages:
            bag.write(topic, log_ns, raw)
    return path


def mcap(
    path: Path,
    messages,
    *,
    compression=CompressionType.ZSTD,
    chunk_size=1 << 20,
    chunks=True,
    index=IndexType.ALL,
    publish_ns=None,
    encoding='cdr',
) -> Path:
    """A single MCAP file by the mcap library."""
    path = path.with_suffix('.mcap')
    with open(path, 'wb') as stream:
        writer = McapWriter(
            stream,
            compression=compression,
            chunk_size=chunk_size,
            use_chunking=chunks,
            index_types=index,
        )
        writer.start('ros2', 'a test')
        channels = {}
        for topic, kind in types(messages).items():
            definition, _ = STORE.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, 'ros2msg', definition.encode())
            channels[topic] = writer.register_channel(topic, encoding, schema)
        for topic, log_ns, raw in messages:
            writer.add_message(
                channels[topic], log_ns, raw, log_ns if publish_ns is None else publish_ns
            )
        writer.finish()
    return path


def rosbags(
    path: Path, messages, *, plugin=StoragePlugin.SQLITE3, mode=CompressionMode.NONE, version=9
) -> Path:
    """A rosbag2 folder by rosbags."""
    writer = RosbagsWriter(path, version=version, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=STORE)
            for topic, kind in types(messages).items()
        }
        for topic, log_ns, raw in messages:
            writer.write(connections[topic], log_ns, raw)
    return path


def split(path: Path, messages, make, parts: int = 3) -> Path:
    """A bag in several files, as `ros2 bag record --max-bag-size` leaves it."""
    path.mkdir()
    size = -(-len(messages) // parts)
    names = []
    for part in range(parts):
        single = make(
            path.with_name(f'{path.name}_single_{part}'), messages[part * size : (part + 1) * size]
        )
        files = (
            [single]
            if single.is_file()
            else [file for file in single.iterdir() if file.suffix in ('.mcap', '.db3')]
        )
        names.append(f'{path.name}_{part}{".db3" if files[0].suffix == ".db3" else ".mcap"}')
        shutil.move(files[0], path / names[-1])
    information = {'version': 5, 'relative_file_paths': names}
    (path / 'metadata.yaml').write_text(
        yaml.safe_dump({'rosbag2_bagfile_information': information})
    )
    return path


@contextmanager
def no_file_above(size: int):
    """Within the block a file that grows beyond this many bytes is an OSError."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def opened_by_others(path: Path) -> list[tuple[str, int, bytes]]:
    """The bag as rosbags reads it; the mcap library finds no fault in its file."""
    for file in path.glob('*.mcap'):
        with open(file, 'rb') as stream:
            count = len(list(make_reader(stream, validate_crcs=True).iter_messages()))
    with AnyReader([path]) as reader:
        found = [
            (connection.topic, time, bytes(raw)) for connection, time, raw in reader.messages()
        ]
    assert len(found) == count
    return found


FOLDER = {'plugin': StoragePlugin.MCAP}
KINDS = {
    'ours': ours,
    'mcap zstd': mcap,
    'mcap lz4': partial(mcap, compression=CompressionType.LZ4),
    'mcap plain': partial(mcap, compression=CompressionType.NONE),
    'mcap small chunks': partial(mcap, chunk_size=600),
    'mcap without index': partial(mcap, index=IndexType.NONE, chunk_size=900),
    'mcap without message index': partial(mcap, index=IndexType.CHUNK, chunk_size=900),
    'mcap without chunks': partial(mcap, chunks=False),
    'mcap folder': partial(rosbags, **FOLDER),
    'mcap folder, zstd': partial(rosbags, **FOLDER, mode=CompressionMode.STORAGE),
    'mcap folder, file compressed': partial(rosbags, **FOLDER, mode=CompressionMode.FILE),
    'sqlite3': rosbags,
    'sqlite3, older': partial(rosbags, version=8),
    'sqlite3, file compressed': partial(rosbags, mode=CompressionMode.FILE),
    'sqlite3, messages compressed': partial(rosbags, mode=CompressionMode.MESSAGE),
    'mcap split': partial(split, make=mcap),
    'sqlite3 split': partial(split, make=rosbags),
}
