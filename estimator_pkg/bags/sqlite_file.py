# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One sqlite3 file of a bag, read through rosbags in blocks."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import apsw
import numpy as np
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from estimator_pkg.bags.reader import Bag, PendingBlock, Topic
from estimator_pkg.bags.unpacking import PIECE_SIZE, REPAIR
from estimator_pkg.errors import UserError, first_line
from estimator_pkg.messages.block import from_messages

ROWS = 4096  # messages per block, if they are small


class SqliteFile:
    """A sqlite3 file that is open for reading; raises UserError if it cannot be read as a bag."""

    SORTS = False

    def __init__(self, path: Path, bag: Bag) -> None:
        self._path, self._bag = path, bag
        for log in (path.with_name(path.name + end) for end in ('-wal', '-journal')):
            if log.is_file() and log.stat().st_size:
                raise UserError(
                    f'{path} was not closed, and {log.name} has a part of it: complete it with '
                    f"`sqlite3 FILE 'pragma journal_mode = delete'`"
                )
        quoted = Path(quote(os.fsencode(os.path.abspath(path))))  # rosbags puts it into a URI
        self._reader = Sqlite3Reader(quoted)
        try:
            self._reader.open()
        except Exception as error:  # the library may raise anything for a damaged file
            why = first_line(error).replace(str(quoted), str(path))
            raise UserError(f'{path} cannot be read as a bag: {why}; {REPAIR}') from error
        assert self._reader.dbconn is not None
        # a message larger than its file is computed, or its pages point to themselves
        largest = min(path.stat().st_size, 2**31 - 1)
        self._reader.dbconn.limit(apsw.SQLITE_LIMIT_LENGTH, largest)
        self._numbers: dict[int, int] = {}  # of the bag's topics, by id
        for item in self._reader.connections:
            if not (isinstance(item.topic, str) and isinstance(item.msgtype, str)):
                bag.warn(f'{path}: the description of a topic is damaged')
                continue
            extension: Any = item.ext  # rosbag2's; rosbags has the same class for rosbag1
            self._numbers[item.id] = bag.number(
                Topic(
                    item.topic,
                    item.msgtype,
                    item.msgcount,
                    tuple(extension.offered_qos_profiles),
                    item.msgdef.data,
                    item.digest,
                    serialization=str(extension.serialization_format),
                )
            )

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def pieces(self, keep: np.ndarray) -> Iterator[PendingBlock]:
        """Yield the messages of the topics with `keep`, by number."""
        wanted = [
            item
            for item in self._reader.connections
            if item.id in self._numbers and keep[self._numbers[item.id]]
        ]
        found: list[tuple[int, int, bytes]] = []  # topic, time, message
        size = strange = 0
        try:
            for item, time_ns, raw in self._reader.messages(wanted):
                if not isinstance(raw, bytes) or not isinstance(time_ns, int):
                    strange += 1
                    continue
                if len(found) == ROWS or (found and size + len(raw) > PIECE_SIZE):
                    yield _piece(found, size)
                    found, size = [], 0
                found.append((self._numbers[item.id], time_ns, raw))
                size += len(raw)
        except (apsw.Error, UnicodeDecodeError) as error:
            raise UserError(f'{self._path} is damaged: {first_line(error)}; {REPAIR}') from error
        if found:
            yield _piece(found, size)
        if strange:
            self._bag.warn(
                f'{self._path} is damaged: {strange} messages are not bytes and are skipped'
            )


def _piece(found: list[tuple[int, int, bytes]], size: int) -> PendingBlock:
    topics, times, raws = zip(*found)
    return PendingBlock(times[0], size, lambda: from_messages(topics, times, times, raws))
