# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes bags: a rosbag2 folder as ROS 2 Jazzy writes it, MCAP with zstd chunks.

>>> with BagWriter('out') as bag:
...     bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
...     bag.write('/joint_states', log_ns, raw)

The bag is written in a new folder next to its final path and moved there when it is complete, so an
error or an interrupt leaves no incomplete bag. Of a recording, which cannot be repeated, the folder
stays, as after a crash: no other instance changes it, and the next one reports it (`unfinished`).
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

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
    keep : after a failure, keep the written messages in the new folder.

    Raises
    ------
    UserError : the path exists, or cannot be written.
    """

    def __init__(self, path: str | Path, *, keep: bool = False) -> None:
        self._keep = keep
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
        self._file = self.path.name if self._bare else f'{self.path.stem}_0.mcap'
        with self._writing():
            self._folder = _new_folder(self.path)
            self._stream = (self._folder / self._file).open('xb')
            self._mcap = output(self._stream)

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
        else:
            with contextlib.suppress(UserError):  # the first error is the one to report
                self.flush()
            self._give_up()

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
        offered = qos_profiles.profile() if qos is None else qos
        profiles = (offered,) if isinstance(offered, qos_profiles.Qos) else tuple(offered)
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
        with self._writing():
            self._mcap.write(block)
            self._stream.flush()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Raise UserError for an OSError within the block."""
        try:
            yield
        except OSError as error:
            raise UserError(f'{self._name} cannot be written: {error.strerror or error}') from error

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
        try:
            self.flush()
            information = self._information()
            with self._writing():
                text = yaml.safe_dump(information, sort_keys=False).strip()
                self._mcap.finish({'serialized_metadata': text})
                self._stream.close()
                if self._bare:
                    self._move_file()
                    return
                text = yaml.safe_dump({'rosbag2_bagfile_information': information}, sort_keys=False)
                (self._folder / METADATA).write_text(text, encoding='utf-8')
                os.rename(
                    self._folder, self.path
                )  # fails if something but an empty folder is there
        except BaseException:
            self._give_up()
            raise

    def _move_file(self) -> None:
        """Move the file to the path; raise OSError if something is there by now."""
        with open(self.path, 'xb'):  # what is replaced is ours
            pass
        try:
            os.replace(self._folder / self._file, self.path)
        except OSError:
            self.path.unlink()
            raise
        self._folder.rmdir()

    def _give_up(self) -> None:
        """Remove everything that was written; with `keep`, leave it in its folder."""
        with contextlib.suppress(OSError):
            self._stream.close()
        if self._keep and self._mcap.statistics.message_count:
            interrupts.say(f'{self._folder} contains the messages written so far; {REPAIR}')
        else:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _information(self) -> dict[str, Any]:
        """Return the metadata of the bag, as Jazzy writes them."""
        found = self._mcap.statistics
        count = found.message_count
        start = found.message_start_time if count else EMPTY_START_NS
        length = found.message_end_time - start if count else 0

        extent = {
            'duration': {'nanoseconds': length},
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': count,
        }
        return {
            'version': VERSION,
            'storage_identifier': 'mcap',
            **extent,
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
            'files': [{'path': self._file, **deepcopy(extent)}],  # YAML would make a reference
            'custom_data': None,
            'ros_distro': 'jazzy',
        }


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
