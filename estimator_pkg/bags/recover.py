# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Make a bag of the files of a recorder that was killed, or of a truncated file.

A truncated MCAP file is read record by record (`mcap_file`). An sqlite3 file is restored to its
state before the crash with its journal or write-ahead log.
"""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from estimator_pkg import interrupts, whole_file
from estimator_pkg.bags import sqlite_file, unpacking
from estimator_pkg.bags.reader import CDR, Message, Topic, natural, open_bag
from estimator_pkg.bags.writer import BagWriter, in_use
from estimator_pkg.errors import UserError, first_line

FILES = ('.mcap', '.db3', '.zstd')
ZSTD = b'\x28\xb5\x2f\xfd'  # starts a compressed message; CDR starts with a zero


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
            for topic, message in _messages(file, unpack_limit):
                raw: Any = message.raw
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
        if not file.is_file():
            raise UserError(f'cannot read {file}: {whole_file.NOT_A_FILE}')
        if in_use(file):
            raise UserError(f'{file} is still being written: end its recorder first')
    return found


def _messages(file: Path, limit: int) -> Iterator[tuple[Topic, Message]]:
    """Yield the messages of one file with their topics; warn about unreadable parts."""
    with open(file, 'rb') as stream:
        start = stream.read(len(sqlite_file.MAGIC))
    if not start:
        interrupts.say(f'warning: {file} is empty')
        return
    with TemporaryDirectory(prefix='velocity_estimator_') as folder:
        if start == sqlite_file.MAGIC:
            file = _finished(file, Path(folder))
        with open_bag(file, limit) as bag:
            for message in bag.messages():
                yield bag.topics[message.topic], message


def _finished(file: Path, folder: Path) -> Path:
    """Return a copy of a database with its last writes completed or reverted, and without a log."""
    copy = folder / file.name
    for ending in sqlite_file.ENDINGS:
        sibling = file.with_name(file.name + ending)
        if sibling.exists():
            shutil.copyfile(sibling, f'{copy}{ending}')
    try:
        with closing(sqlite3.connect(copy)) as base:
            base.execute('pragma journal_mode = delete')
    except sqlite3.Error as error:
        raise UserError(f'{file} cannot be recovered: {first_line(error)}') from error
    return copy
