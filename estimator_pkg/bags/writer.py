# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes bags: a rosbag2 folder as ROS 2 Jazzy writes it, MCAP with zstd chunks.

>>> with BagWriter('out') as bag:
...     bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
...     bag.write('/joint_states', log_ns, raw)

The bag is written in a new folder next to its final path and moved there when it is complete, so an
error or an interrupt leaves no incomplete bag. A recording, which cannot be repeated, is kept in
any case. After a crash the new folder stays, with the only copy: no other instance changes it, and
the next one reports it (`unfinished`).
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import yaml

from estimator_pkg import interrupts
from estimator_pkg.bags.definitions import define
from estimator_pkg.bags.source import CDR, REPAIR, Topic
from estimator_pkg.destination import METADATA
from estimator_pkg.errors import UserError
from estimator_pkg.messages.block import Block, from_messages
from estimator_pkg.optional import Lazy

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

mcap_output = Lazy('estimator_pkg.bags.mcap_output')
qos_profiles = Lazy('estimator_pkg.bags.qos')

VERSION = 9  # of metadata.yaml, as Jazzy writes it
OTHER_SUFFIXES = ('.db3', '.bag', '.zstd', '.lz4')  # files of bags of other kinds
EMPTY_START_NS = 2**63 - 1  # start time of a bag without messages


class BagWriter:
    """A bag that is being written. A context manager: the bag is complete after its block.

    Parameters
    ----------
    path : of the bag: a folder, or a single file if it ends in .mcap.
    keep : keep the written messages after any failure, if need be without the end of the file.

    Raises
    ------
    UserError : the path exists, or cannot be written.
    """

    def __init__(self, path: str | Path, *, keep: bool = False) -> None:
        self._keep = keep
        self._torn = False  # a write failed: the state of the file's end is unknown
        self.path = Path(os.path.abspath(path))
        self._name = Path(path)
        self._bare = self.path.suffix == '.mcap'
        self._topics: dict[str, tuple[int, Topic]] = {}
        self._pending: tuple[list, ...] = ([], [], [], [])  # channels, both times, messages
        self._pending_size = 0
        if self.path.suffix in OTHER_SUFFIXES:
            raise UserError(
                f'{path}: bags are written as MCAP: name a folder, or a file that ends in .mcap'
            )
        if os.path.lexists(self.path):
            raise UserError(f'{path} exists already: choose another path, or remove it first')
        if not self.path.parent.is_dir():
            raise UserError(
                f'{path} cannot be written: the folder {self._name.parent} does not exist'
            )
        output = mcap_output.McapOutput  # a missing library raises before anything is created
        for folder in unfinished(self.path):
            interrupts.say(
                f'warning: {folder} contains an incomplete {path} of a process that was killed or '
                f'still writes; {REPAIR}'
            )
        self._folder: Path | None = None
        self._file = self.path.name if self._bare else f'{self.path.stem}_0.mcap'
        self._stream: BinaryIO | None = None
        try:
            self._folder = _new_folder(self.path)
            self._stream = (self._folder / self._file).open('xb')
            self._mcap = output(self._stream)
        except OSError as error:
            self.abort()
            raise self._unwritable(error) from error

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        elif not self._keep or not any(self.counts().values()):
            self.abort()
        elif self._torn:
            self._give_up()
        else:
            with contextlib.suppress(UserError):  # the first error is the one to report
                self.close()
                self._print_kept()

    def add_topic(
        self,
        name: str,
        type_name: str,
        qos: Sequence[Qos] | Qos | None = None,
        *,
        type_hash: str = '',
        serialization: str = CDR,
    ) -> int:
        """Declare a topic; return its number for `write_block`.

        Parameters
        ----------
        name, type_name : as in '/joint_states', 'sensor_msgs/msg/JointState'.
        qos : the offered profile or profiles; None: reliable, volatile, keep last 10.
        type_hash : by default looked up.
        serialization : of its messages.
        """
        if qos is None:
            qos = qos_profiles.profile()
        profiles = (qos,) if isinstance(qos, qos_profiles.Qos) else tuple(qos)
        return self.add(
            Topic(name, type_name, qos=profiles, type_hash=type_hash, serialization=serialization)
        )

    def add(self, topic: Topic) -> int:
        """Declare a topic like one of another bag; return its number for `write_block`."""
        if topic.name in self._topics:
            return self._topics[topic.name][0]
        definition, type_hash = define(topic.type)
        if not topic.definition:
            topic = replace(topic, definition=definition, definition_format='ros2msg')
        topic = replace(topic, type_hash=topic.type_hash or type_hash)
        channel: int = self._mcap.add_channel(topic)
        self._topics[topic.name] = channel, topic
        return channel

    def write(
        self, topic: str, log_ns: int, raw: bytes | memoryview, publish_ns: int | None = None
    ) -> None:
        """Write a message of a declared topic: CDR bytes, times of recording and publishing [ns].

        Raises
        ------
        UserError : it cannot be written (the disk is full, say).
        """
        channels, logs, publishes, raws = self._pending
        channels.append(self._topics[topic][0])
        logs.append(log_ns)
        publishes.append(log_ns if publish_ns is None else publish_ns)
        raws.append(raw)
        self._pending_size += len(raw)
        if self._pending_size >= mcap_output.CHUNK_SIZE:
            self.flush()

    def write_block(self, block: Block) -> None:
        """Write many messages; `block.topic` are numbers from `add_topic` or `add`."""
        self.flush()
        with self._writing():
            self._mcap.write(block)

    def flush(self) -> None:
        """Pass the messages of `write` to the operating system.

        Raises
        ------
        UserError : they cannot be written (the disk is full, say).
        """
        block = from_messages(*self._pending)
        self._pending, self._pending_size = ([], [], [], []), 0
        with self._writing() as stream:
            self._mcap.write(block)
            stream.flush()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[BinaryIO]:
        """Yield the stream; after any error, such as a second Ctrl-C, its end is unknown."""
        assert self._stream is not None
        try:
            yield self._stream
        except BaseException as error:
            self._torn = True
            if isinstance(error, OSError):
                raise self._unwritable(error) from error
            raise

    def counts(self) -> dict[str, int]:
        """Return the number of messages written so far, by topic."""
        pending = np.bincount(self._pending[0], minlength=len(self._topics) + 1).tolist()
        written = self._mcap.statistics.channel_message_counts
        return {
            name: written[channel] + pending[channel] for name, (channel, _) in self._topics.items()
        }

    def close(self) -> None:
        """Finish the bag and move it to its path.

        Raises
        ------
        UserError : that failed; nothing is left over, except with `keep`.
        """
        assert self._stream is not None and self._folder is not None
        try:
            self.flush()
            information = self._information()
            self._mcap.finish(
                {'serialized_metadata': yaml.safe_dump(information, sort_keys=False).strip()}
            )
            self._stream.close()
            if not self._bare:
                text = yaml.safe_dump({'rosbag2_bagfile_information': information}, sort_keys=False)
                (self._folder / METADATA).write_text(text, encoding='utf-8')
            self._move()
        except BaseException as error:
            self._give_up()
            if isinstance(error, OSError):
                raise self._unwritable(error) from error
            raise

    def _move(self) -> None:
        """Move the new bag to its path; raise OSError if the path exists by now.

        The path is reserved first, which fails if another process has it. Only the reservation
        that this instance made is replaced, so no hard links are needed.
        """
        assert self._folder is not None
        if self._bare:
            with open(self.path, 'xb'):
                pass
        else:
            self.path.mkdir()
        made = self._folder / self._file if self._bare else self._folder
        try:
            os.replace(made, self.path)
        except OSError:
            if self._bare:
                self.path.unlink()
                raise
            self.path.rmdir()
            os.rename(made, self.path)  # for systems that cannot replace an empty folder
        if self._bare:
            self._folder.rmdir()
        self._folder = None

    def _give_up(self) -> None:
        """Remove everything; with `keep`, keep all that is readable."""
        if not self._keep or not self._mcap.statistics.message_count:
            self.abort()
            return
        self._close_stream()
        with contextlib.suppress(OSError):
            self._move()
        self._print_kept()

    def _print_kept(self) -> None:
        where = f'{self._folder or self._name} contains the messages written so far'
        interrupts.say(f'{where}; {REPAIR}' if self._folder else where)

    def abort(self) -> None:
        """Remove everything that was written."""
        self._close_stream()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None

    def _close_stream(self) -> None:
        if self._stream is not None:
            with contextlib.suppress(OSError):
                self._stream.close()

    def _information(self) -> dict[str, Any]:
        """Return the metadata of the bag, as Jazzy writes them."""
        found = self._mcap.statistics
        count = found.message_count
        start = found.message_start_time if count else EMPTY_START_NS
        length = found.message_end_time - start if count else 0

        def extent() -> dict[str, Any]:
            return {
                'duration': {'nanoseconds': length},
                'starting_time': {'nanoseconds_since_epoch': start},
                'message_count': count,
            }

        return {
            'version': VERSION,
            'storage_identifier': 'mcap',
            **extent(),
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic.name,
                        'type': topic.type,
                        'serialization_format': topic.serialization,
                        'offered_qos_profiles': qos_profiles.plain(topic.qos),
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': found.channel_message_counts[channel],
                }
                for channel, topic in self._topics.values()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self._file],
            'files': [{'path': self._file, **extent()}],
            'custom_data': None,
            'ros_distro': 'jazzy',
        }

    def _unwritable(self, error: OSError) -> UserError:
        return UserError(f'{self._name} cannot be written: {error.strerror or error}')


def _new_folder(path: Path) -> Path:
    """Make a new folder next to `path`; raise OSError if that is not possible."""
    while True:
        folder = path.parent / f'.{path.name}.{secrets.token_hex(4)}.part'
        with contextlib.suppress(FileExistsError):
            folder.mkdir()
            return folder


def unfinished(path: Path) -> list[Path]:
    """Return the folders next to `path` in which its writers have not finished.

    Parameters
    ----------
    path : path of the requested bag.
    """
    name = re.compile(re.escape(f'.{path.name}.') + r'[0-9a-f]+\.part')
    return sorted(
        folder
        for folder in path.parent.glob('.*.part')
        if name.fullmatch(folder.name) and any(folder.glob('*.mcap'))
    )
