# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One sqlite3 file of a bag, read through rosbags in blocks."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import quote

import apsw
from rosbags.interfaces import Connection
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from estimator_pkg.bags import unpacking
from estimator_pkg.errors import UserError, first_line
from estimator_pkg.messages.block import Block, from_messages

MAGIC = b'SQLite format 3\0'
ENDINGS = ('', '-wal', '-journal')  # of the files of one database
ROWS = 4096  # messages per block, if they are small


class SqliteFile:
    """A sqlite3 file that is open for reading.

    Parameters
    ----------
    limit : bytes that a message may have, if the file is not larger: its columns can be computed.

    Attributes
    ----------
    connections : its topics, in the form of rosbags.

    Raises
    ------
    UserError : it is empty, damaged, or not a bag.
    """

    def __init__(self, path: Path, warn: Callable[[str], None], limit: int) -> None:
        self.path = path
        self._warn = warn
        for ending in ENDINGS[1:]:
            log = path.with_name(path.name + ending)
            if log.exists() and log.stat().st_size:
                warn(
                    f'{path} was not closed and is read without {log.name}: `velocity_estimator '
                    f'record --recover {shlex.quote(str(path))} --out BAG` makes it complete'
                )
        with open(path, 'rb') as file:
            start = file.read(len(MAGIC))
        if not start:
            raise UserError(f'{path} is empty (0 bytes): name another file')
        if start != MAGIC:
            raise UserError(f'{path} is not an sqlite3 file: it starts with other bytes')
        for_library = _within_uri(path)
        self._reader = Sqlite3Reader(for_library)
        try:
            self._reader.open()
        except Exception as error:  # the library may raise anything for a damaged file
            why = first_line(error).replace(str(for_library), str(path))
            raise UserError(f'{path} cannot be read as a bag: {why}') from error
        assert self._reader.dbconn is not None
        self._most = min(max(limit, path.stat().st_size), 2**31 - 1)
        self._reader.dbconn.limit(apsw.SQLITE_LIMIT_LENGTH, self._most)
        every = list(self._reader.connections)
        self.connections: list[Connection] = [
            item for item in every if isinstance(item.topic, str) and isinstance(item.msgtype, str)
        ]
        if len(self.connections) < len(every):
            warn(f'{path}: the description of a topic is damaged')
        self._places = {item.id: place for place, item in enumerate(self.connections)}

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def parts(self, topics: set[int]) -> Iterator[tuple[int, Callable[[], Block]]]:
        """Yield (time of its first message, function that returns it) for each block.

        Parameters
        ----------
        topics : indices in `connections`; the blocks' `topic` are such indices, too.
        """
        connections = [self.connections[place] for place in sorted(topics)]
        if not connections:
            return
        topic: list[int] = []
        times: list[int] = []
        raws: list[bytes] = []
        size = 0

        def full() -> tuple[int, Callable[[], Block]]:
            block = from_messages(topic, times, times, raws)
            return times[0], lambda: block

        strange = 0
        try:
            for connection, time_ns, raw in self._reader.messages(connections):
                if not isinstance(raw, bytes) or not isinstance(time_ns, int):
                    strange += 1
                    continue
                if len(raws) == ROWS or (raws and size + len(raw) > unpacking.PIECE):
                    yield full()
                    topic, times, raws, size = [], [], [], 0
                topic.append(self._places[connection.id])
                times.append(time_ns)
                raws.append(raw)
                size += len(raw)
        except apsw.TooBigError:
            unpacking.check(f'{self.path}: a message', self._most + 1, self._most)
        except (apsw.Error, UnicodeDecodeError) as error:
            raise UserError(f'{self.path} is damaged: {first_line(error)}') from error
        if raws:
            yield full()
        if strange:
            self._warn(f'{self.path} is damaged: {strange} messages are not bytes and are skipped')


def _within_uri(path: Path) -> Path:
    """Return the path quoted for rosbags, which puts it unquoted into a URI."""
    whole = os.fsencode(os.path.abspath(path))
    return Path('/' + quote(whole.lstrip(b'/')) if whole.startswith(b'/') else quote(whole))
