# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes bags: a rosbag2 folder as ROS 2 Jazzy writes it, MCAP with zstd chunks.

>>> with BagWriter('out') as bag:
...     bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
...     bag.write('/joint_states', log_ns, raw)

The messages go through the mcap library; the writer of rosbags keeps no time of publishing, from
which a replay of messages without stamps is made. A bag is written next to its final path and moved
there when it is complete, so an error or an interrupt leaves no incomplete bag. A recording, which
cannot be repeated, is written in its place and stays there, also after a crash.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from estimator_pkg import __version__, interrupts
from estimator_pkg.bags.definitions import define
from estimator_pkg.bags.reader import CDR, Topic
from estimator_pkg.bags.unpacking import REPAIR
from estimator_pkg.destination import METADATA
from estimator_pkg.errors import UserError
from estimator_pkg.messages.block import Block
from estimator_pkg.optional import Lazy

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

mcap_writer = Lazy('mcap.writer')
qos_profiles = Lazy('estimator_pkg.bags.qos')
zstandard = Lazy('zstandard')

VERSION = 9  # of metadata.yaml, as Jazzy writes it
CHUNK_SIZE = 1 << 20  # bytes of messages per chunk, before compression
OTHER_SUFFIXES = ('.db3', '.bag', '.zstd', '.lz4')  # files of bags of other kinds
EMPTY_START_NS = 2**63 - 1  # start time of a bag without messages


class BagWriter:
    """A bag that is being written. A context manager: the bag is complete after its block.

    The same calls write the same bytes.

    Parameters
    ----------
    path : of the bag: a folder, or a single file if it ends in .mcap.
    keep : write in place, and keep the messages after a failure.

    Raises
    ------
    UserError : the path exists, or cannot be written.
    """

    def __init__(self, path: str | Path, *, keep: bool = False) -> None:
        self.path = Path(os.path.abspath(path))
        self._name, self._keep = Path(path), keep
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
        # a missing library raises before anything is created
        make, _ = mcap_writer.Writer, zstandard.compress
        self._topics: dict[str, tuple[int, Topic]] = {}
        self._schemas: dict[str, int] = {}
        self._counts = [0]  # by channel, whose numbers start at 1
        self._start_ns, self._end_ns = EMPTY_START_NS, 0
        self._place = self.path
        if not keep:
            self._place = self.path.with_name(f'.{self.path.name}.{secrets.token_hex(4)}.part')
        self._file = self._place
        with self._writing():
            if self.path.suffix != '.mcap':
                self._place.mkdir()
                self._file = self._place / f'{self.path.stem}_0.mcap'
            self._stream = self._file.open('xb')
            self._mcap = make(self._stream, CHUNK_SIZE)
            self._mcap.start('ros2', f'velocity_estimator {__version__}')

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
        with self._writing():
            if topic.type not in self._schemas:
                encoding = topic.definition_format if topic.definition else ''
                self._schemas[topic.type] = self._mcap.register_schema(
                    topic.type, encoding, topic.definition.encode()
                )
            channel: int = self._mcap.register_channel(
                topic.name,
                topic.serialization,
                self._schemas[topic.type],
                {
                    'offered_qos_profiles': qos_profiles.to_text(topic.qos),
                    'topic_type_hash': topic.type_hash,
                },
            )
        self._topics[topic.name] = channel, topic
        self._counts.append(0)
        return channel

    def write(
        self, topic: str, log_ns: int, raw: bytes | memoryview, publish_ns: int | None = None
    ) -> None:
        """Write a message of a declared topic: CDR bytes, times of recording and publishing [ns].

        Raises
        ------
        UserError : it cannot be written (the disk is full, say).
        """
        with self._writing():
            published = log_ns if publish_ns is None else publish_ns
            self._put(self._topics[topic][0], log_ns, published, raw)

    def write_block(self, block: Block) -> None:
        """Write many messages; `block.topic` are numbers from `add_topic` or `add`."""
        view = block.data.data
        columns = block.topic, block.log_ns, block.publish_ns, block.start, block.end
        with self._writing():
            for channel, log_ns, publish_ns, start, end in zip(*map(np.ndarray.tolist, columns)):
                self._put(channel, log_ns, publish_ns, view[start:end])

    def _put(self, channel: int, log_ns: int, publish_ns: int, raw: bytes | memoryview) -> None:
        log_ns = max(log_ns, 0)  # negative in a damaged bag
        self._counts[channel] += 1
        self._start_ns = min(self._start_ns, log_ns)
        self._end_ns = max(self._end_ns, log_ns)
        self._mcap.add_message(channel, log_ns, raw, max(publish_ns, 0))

    def flush(self) -> None:
        """Pass all messages to the operating system; raise UserError if that fails."""
        with self._writing():
            self._mcap.flush()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Raise UserError for an OSError within the block."""
        try:
            yield
        except OSError as error:
            raise UserError(f'{self._name} cannot be written: {error.strerror or error}') from error

    def counts(self) -> dict[str, int]:
        """Return the number of messages written so far, by topic."""
        return {name: self._counts[channel] for name, (channel, _) in self._topics.items()}

    def close(self) -> None:
        """Finish the bag and move it to its path.

        Raises
        ------
        UserError : that failed; nothing is left over, except with `keep`.
        """
        try:
            with self._writing():
                information = self._information()
                text = yaml.safe_dump(information, sort_keys=False).strip()
                self._mcap.flush()
                self._mcap.add_metadata('rosbag2', {'serialized_metadata': text})
                self._mcap.finish()
                self._stream.close()
                if self._file != self._place:
                    text = yaml.safe_dump(
                        {'rosbag2_bagfile_information': information}, sort_keys=False
                    )
                    (self._place / METADATA).write_text(text, encoding='utf-8')
                if not self._keep:
                    if os.path.lexists(self.path):  # by now
                        raise FileExistsError(f'{self.path} exists already')
                    os.rename(self._place, self.path)
        except BaseException:
            self._give_up()
            raise

    def _give_up(self) -> None:
        """Remove everything that was written; with `keep`, only if there is no message."""
        with contextlib.suppress(OSError):
            self._stream.close()
        if self._keep and any(self._counts):
            interrupts.say(f'{self.path} contains the messages written so far; {REPAIR}')
        elif self._file == self._place:
            self._place.unlink(missing_ok=True)
        else:
            shutil.rmtree(self._place, ignore_errors=True)

    def _information(self) -> dict[str, Any]:
        """Return the metadata of the bag, as Jazzy writes them."""
        count = sum(self._counts)
        length = self._end_ns - self._start_ns if count else 0
        name = self.path.name if self._file == self._place else self._file.name

        def extent() -> dict[str, Any]:  # twice: YAML would make a reference to the same one
            return {
                'duration': {'nanoseconds': length},
                'starting_time': {'nanoseconds_since_epoch': self._start_ns},
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
                    'message_count': self._counts[channel],
                }
                for channel, topic in self._topics.values()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [name],
            'files': [{'path': name, **extent()}],
            'custom_data': None,
            'ros_distro': 'jazzy',
        }
