# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Make a bag of the files of a recorder that was killed, or of a truncated file.

A truncated MCAP file is read record by record (`mcap_file`). An sqlite3 file is restored to its
state before the crash with its journal or write-ahead log. If it is damaged further, its pages are
searched for messages. File format: https://www.sqlite.org/fileformat2.html
"""

from __future__ import annotations

import mmap
import os
import shlex
import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from urllib.parse import quote

from estimator_pkg import interrupts
from estimator_pkg.bags import qos, sqlite_file, unpacking
from estimator_pkg.bags.reader import CDR, Topic, natural, open_bag
from estimator_pkg.bags.writer import BagWriter, in_use
from estimator_pkg.errors import UserError, first_line
from estimator_pkg.optional import Lazy

typesys = Lazy('rosbags.typesys')

FILES = ('.mcap', '.db3', '.zstd')
ENDINGS = ('', '-journal', '-wal')  # of the files of one database
ZSTD = b'\x28\xb5\x2f\xfd'  # starts a compressed message; CDR starts with a zero
LEAF = 13  # type of a page with table rows
SIZES = (0, 1, 2, 3, 4, 6, 8, 8, 0, 0)  # bytes of a column, by its serial type


class Message(NamedTuple):
    """A recovered message and its topic."""

    topic: Topic
    log_ns: int
    publish_ns: int
    raw: bytes


def recover(path: str, out: str, unpack_limit: int = unpacking.LIMIT) -> dict[str, int]:
    """Write every complete message at `path` into a new bag.

    Parameters
    ----------
    path : a file, or a folder with the files of one bag.
    unpack_limit : bytes that a compressed chunk or message may unpack to.

    Returns
    -------
    The number of messages by topic.

    Raises
    ------
    UserError : the path does not exist, is still being written, or has no complete message.
    """
    files = _files(Path(path))
    with interrupts.gently(), BagWriter(out, keep=True) as writer:
        for file in files:
            for message in _messages(file, unpack_limit):
                topic, raw = message.topic, message.raw
                if topic.serialization == CDR and raw.startswith(ZSTD):
                    raw = unpacking.unpack_message(
                        memoryview(raw), f'{file}: a message', unpack_limit
                    )
                writer.add_topic(
                    topic.name,
                    topic.type,
                    topic.qos,
                    definition=topic.definition,
                    definition_format=topic.definition_format,
                    type_hash=topic.type_hash,
                    serialization=topic.serialization,
                )
                writer.write(topic.name, message.log_ns, raw, message.publish_ns)
                if interrupts.came():
                    raise KeyboardInterrupt
        counts = writer.counts()
        if not counts:
            raise UserError(f'{path} contains no complete message: there is nothing to recover')
    return counts


def _files(path: Path) -> list[Path]:
    """Return the files of the bag, in order; raise UserError if there are none."""
    if not path.exists():
        raise UserError(f'{path} does not exist')
    found = [path]
    if path.is_dir():
        found = sorted((file for file in path.iterdir() if file.suffix in FILES), key=natural)
    if not found:
        raise UserError(f'{path} contains no .mcap or .db3 file: name a bag')
    for file in found:
        if in_use(file):
            raise UserError(f'{file} is still being written: end its recorder first')
    return found


def _messages(file: Path, limit: int) -> Iterator[Message]:
    """Yield the messages of one file; warn about unreadable parts."""
    with open(file, 'rb') as stream:
        start = stream.read(len(sqlite_file.MAGIC))
    if start == sqlite_file.MAGIC:
        yield from _of_database(file)
    elif not start:
        interrupts.say(f'warning: {file} is empty')
    else:
        with open_bag(file, limit) as bag:
            for message in bag.messages():
                yield Message(bag.topics[message.topic], *message[1:])


def _of_database(file: Path) -> Iterator[Message]:
    with TemporaryDirectory(prefix='velocity_estimator_') as folder:
        copy = Path(folder, 'bag.db3')  # opening it completes or reverts its last writes
        for ending in ENDINGS:
            sibling = file.with_name(file.name + ending)
            if sibling.exists():
                shutil.copyfile(sibling, f'{copy}{ending}')
        try:
            with closing(sqlite3.connect(copy)) as base:
                base.text_factory = lambda raw: raw.decode('utf-8', 'replace')
                whole = _whole(base)
                base.execute('pragma writable_schema = on')  # to read a truncated file, too
                topics = _topics(base)
                rows = (
                    base.execute('select id, topic_id, timestamp, data from messages order by id')
                    if whole
                    else _rows(copy)
                )
                if not whole:
                    interrupts.say(f'warning: {file} is damaged: its pages are searched')
                for _, number, time_ns, raw in rows:
                    if (
                        number in topics
                        and isinstance(raw, bytes)
                        and isinstance(time_ns, int)
                        and time_ns >= 0
                    ):
                        yield Message(topics[number], time_ns, time_ns, raw)
        except (sqlite3.Error, KeyError, ValueError) as error:  # a damaged file raises any of these
            raise UserError(f'{file} cannot be recovered: {first_line(error)}') from error


def remedy(file: Path) -> str:
    """Return how to save the messages of a damaged database; '' if it has none that is complete."""
    try:
        address = f'file:{quote(os.path.abspath(file))}?immutable=1'
        with closing(sqlite3.connect(address, uri=True)) as base:
            base.text_factory = lambda raw: raw.decode('utf-8', 'replace')
            base.execute('pragma writable_schema = on')
            topics = _topics(base)
        if not any(row[1] in topics for row in _rows(file)):
            return ''
    except (sqlite3.Error, KeyError, ValueError):  # as in `_of_database`
        return ''
    how = f'velocity_estimator record --recover {shlex.quote(str(file))} --out BAG'
    return f'; `{how}` saves its complete messages'


def _whole(base: sqlite3.Connection) -> bool:
    try:
        return base.execute('pragma quick_check(1)').fetchone() == ('ok',)
    except sqlite3.DatabaseError:
        return False


def _topics(base: sqlite3.Connection) -> dict[int, Topic]:
    """Return the topics by their numbers."""

    def rows(table: str) -> list[dict[str, Any]]:
        found = base.execute(f'select * from {table}')
        return [dict(zip([column[0] for column in found.description], row)) for row in found]

    try:
        definitions = {row['topic_type']: row for row in rows('message_definitions')}
    except (sqlite3.Error, KeyError):  # older bags have none
        definitions = {}
    topics = {}
    for row in rows('topics'):
        about = definitions.get(row['type'], {})
        if not _sound(about):
            about = {}  # the definition is looked up
        topics[row['id']] = Topic(
            str(row['name']),
            str(row['type']),
            0,
            tuple(qos.parse(row.get('offered_qos_profiles'))),
            about.get('encoded_message_definition') or '',
            row.get('type_description_hash') or '',
            about.get('encoding') or 'ros2msg',
            str(row['serialization_format']),
        )
    return topics


def _sound(about: dict[str, Any]) -> bool:
    """Return True if other tools can read this message definition."""
    if about.get('encoding') == 'ros2msg':
        try:
            typesys.get_types_from_msg(about['encoded_message_definition'], about['topic_type'])
        except Exception:  # the parser may raise anything for a damaged definition
            return False
    return about.get('encoding') in ('ros2msg', 'ros2idl')


def _rows(file: Path) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield the rows of the message table in all pages of a database, referenced or not."""
    with open(file, 'rb') as stream:
        data = memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
    size = int.from_bytes(data[16:18], 'big')
    size = 65536 if size == 1 else size
    usable = size - data[20]
    seen = set()
    for page in range(size, len(data) - size + 1, size):
        if data[page] != LEAF:
            continue
        count = int.from_bytes(data[page + 3 : page + 5], 'big')
        for cell in range(page + 8, page + min(8 + 2 * count, usable), 2):
            at = page + int.from_bytes(data[cell : cell + 2], 'big')
            try:
                number, row = _row(data, at, size, usable)
            except (IndexError, ValueError, struct.error):
                continue
            if number not in seen and len(row) == 4 and isinstance(row[3], bytes):
                seen.add(number)
                yield number, row[1], row[2], row[3]


def _row(data: memoryview, at: int, size: int, usable: int) -> tuple[int, list[Any]]:
    """Return (row id, columns) of the cell at byte `at`.

    Raises
    ------
    IndexError, ValueError, struct.error : there is no cell, or a part of it is missing.
    """
    length, at = _varint(data, at)
    number, at = _varint(data, at)
    local, most = length, usable - 35
    if length > most:
        least = (usable - 12) * 32 // 255 - 23
        local = least + (length - least) % (usable - 4)
        local = local if local <= most else least
    payload = bytearray(data[at : at + local])
    following = int.from_bytes(data[at + local : at + local + 4], 'big') if local < length else 0
    while len(payload) < length:
        start = (following - 1) * size
        if following < 2 or start + size > len(data):
            raise ValueError('a page is missing')
        payload += data[start + 4 : start + 4 + min(usable - 4, length - len(payload))]
        following = int.from_bytes(data[start : start + 4], 'big')
    return number, _columns(memoryview(payload))


def _columns(payload: memoryview) -> list[Any]:
    """Return the columns of a record: integers, bytes, None for everything else."""
    head, at = _varint(payload, 0)
    kinds = []
    while at < head:
        kind, at = _varint(payload, at)
        kinds.append(kind)
    columns: list[Any] = []
    for kind in kinds:
        width = (kind - 12) // 2 if kind >= 12 else SIZES[kind]
        part = payload[at : at + width]
        if len(part) < width:
            raise ValueError('a record is truncated')
        at += width
        columns.append(
            int.from_bytes(part, 'big', signed=True)
            if 1 <= kind <= 6
            else kind - 8
            if kind in (8, 9)
            else bytes(part)
            if kind >= 12 and kind % 2 == 0
            else None
        )
    return columns


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    """Decode a number in 1 to 9 bytes; return (number, position after it)."""
    value = 0
    for place in range(at, at + 8):
        value = value << 7 | data[place] & 127
        if data[place] < 128:
            return value, place + 1
    return value << 8 | data[at + 8], at + 9
