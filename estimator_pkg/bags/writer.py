"""Writing bags: a rosbag2 folder as ROS 2 Jazzy writes it, MCAP with zstd chunks.

>>> with BagWriter('out') as bag:
...     bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
...     bag.write('/joint_states', log_ns, raw)

The bag is written beside its place and moved there when it is whole, so that neither an error nor
an interrupt leaves half a bag. What cannot be made again (a recording) is kept all the same.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import yaml

from estimator_pkg.bags import qos as qos_profiles
from estimator_pkg.bags.block import Block, from_messages
from estimator_pkg.bags.definitions import define
from estimator_pkg.errors import UserError
from estimator_pkg.optional import Lazy
from estimator_pkg.printable import show

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

mcap_output = Lazy('estimator_pkg.bags.mcap_output')
interfaces = Lazy('rosbags.interfaces')

CHUNK_SIZE = 1 << 20   # bytes of messages that are written together, as one chunk
VERSION = 9            # of metadata.yaml, as Jazzy writes it
OTHERS = ('.db3', '.bag', '.zstd', '.lz4')  # files of bags of other kinds
LATEST = 2**63 - 1     # the starting time of a bag without messages


class BagWriter:
    """A bag that is being written. A context manager: the bag is there once it ends well.

    Parameters
    ----------
    path : where the bag will be: a folder, or a single file if it ends in .mcap.
    keep : what was written stays, whatever goes wrong; if need be without its end.

    Raises
    ------
    UserError : something is there already, or it cannot be written.
    """

    def __init__(self, path: str | Path, *, keep: bool = False) -> None:
        self._keep = keep
        self._torn = False      # a write failed: the end of the file is not known
        self.path = Path(os.path.abspath(path))
        self._name = Path(path)
        self._bare = self.path.suffix == '.mcap'
        self._topics: dict[str, tuple[int, dict[str, Any]]] = {}
        self._pending: tuple[list[int], list[int], list[int], list[bytes]] = ([], [], [], [])
        self._pending_size = 0
        if self.path.suffix in OTHERS:
            raise UserError(f'{path}: bags are written as MCAP: name a folder, or a file that ends '
                            'in .mcap')
        if os.path.lexists(self.path):
            raise UserError(f'{path} exists already: name another place, or remove it first')
        if not self.path.parent.is_dir():
            raise UserError(f'{path} cannot be written: there is no folder {self._name.parent}')
        output = mcap_output.McapOutput  # a missing library is found before anything is made
        self._folder = self.path.parent / f'.{self.path.name}.{os.getpid()}.part'
        self._file = f'{self.path.stem}_0.mcap' if not self._bare else self.path.name
        self._stream: BinaryIO | None = None
        try:
            self._folder.mkdir()
            self._stream = (self._folder / self._file).open('wb')
            self._mcap = output(self._stream)
        except OSError as error:
            self.abort()
            raise self._unwritable(error) from error

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if kind is None:
            self.close()
        elif not self._keep or not any(self.counts().values()):
            self.abort()
        elif self._torn:
            self._give_up()
        else:
            with contextlib.suppress(UserError):  # the first error is the one to be told
                self.close()
                self._say_kept()

    def add_topic(self, name: str, type_name: str, qos: Sequence[Qos] | Qos | None = None, *,
                  definition: str = '', definition_format: str = 'ros2msg', type_hash: str = '',
                  serialization: str = 'cdr') -> int:
        """Declare a topic; returns the number that `write_block` takes for it.

        Parameters
        ----------
        name, type_name : as in '/joint_states', 'sensor_msgs/msg/JointState'.
        qos : the profile or profiles its publishers offer; None: reliable, volatile, keep last 10.
        definition, definition_format, type_hash : as another bag has them; else they are looked up.
        serialization : of its messages, as another bag has it.
        """
        if name in self._topics:
            return self._topics[name][0]
        profiles: Any = ([qos_profiles.profile()] if qos is None else
                    [qos] if isinstance(qos, interfaces.Qos) else list(qos))
        known = define(type_name)
        if not definition:
            definition, definition_format = known[0], 'ros2msg'
        type_hash = type_hash or known[1]
        channel = self._mcap.add_channel(
            name, type_name, definition_format, definition,
            {'offered_qos_profiles': qos_profiles.to_text(profiles),
             'topic_type_hash': type_hash}, serialization)
        self._topics[name] = channel, {
            'name': name, 'type': type_name, 'serialization_format': serialization,
            'offered_qos_profiles': qos_profiles.plain(profiles),
            'type_description_hash': type_hash}
        return channel

    def write(self, topic: str, log_ns: int, raw: bytes, publish_ns: int | None = None) -> None:
        """One message of a declared topic: its CDR bytes, when it was recorded and published [ns].

        Raises
        ------
        UserError : the disk is full or the like.
        """
        channels, logs, publishes, raws = self._pending
        channels.append(self._topics[topic][0])
        logs.append(log_ns)
        publishes.append(log_ns if publish_ns is None else publish_ns)
        raws.append(raw)
        self._pending_size += len(raw)
        if self._pending_size >= CHUNK_SIZE:
            self.flush()

    def write_block(self, block: Block) -> None:
        """Many messages; `block.topic` are the numbers that `add_topic` gave."""
        self.flush()
        self._write(block)

    def flush(self) -> None:
        """Hand what `write` gathered to the operating system.

        Raises
        ------
        UserError : the disk is full or the like.
        """
        if self._pending[0]:
            block = from_messages(*self._pending)
            self._pending = ([], [], [], [])
            self._pending_size = 0
            self._write(block)
        if self._stream is not None:
            try:
                self._stream.flush()
            except OSError as error:
                self._torn = True
                raise self._unwritable(error) from error

    def counts(self) -> dict[str, int]:
        """Messages written so far, by topic."""
        pending = np.bincount(self._pending[0], minlength=len(self._topics) + 1).tolist()
        return {name: self._mcap.counts[channel] + pending[channel]
                for name, (channel, _) in self._topics.items()}

    def close(self) -> None:
        """Finish the bag and move it to its place.

        Raises
        ------
        UserError : that was not possible; nothing is left behind, but for what is to be kept.
        """
        try:
            self.flush()
            information = self._information()
            self._mcap.finish({'serialized_metadata': yaml.safe_dump(information,
                                                                     sort_keys=False).strip()})
            assert self._stream is not None
            self._stream.close()
            if not self._bare:
                text = yaml.safe_dump({'rosbag2_bagfile_information': information},
                                      sort_keys=False)
                (self._folder / 'metadata.yaml').write_text(text, encoding='utf-8')
            self._move()
        except OSError as error:
            self._give_up()
            raise self._unwritable(error) from error
        except BaseException:
            self._give_up()
            raise

    def _move(self) -> None:
        """Put what was written in its place; fails where something is by now."""
        if self._bare:
            os.link(self._folder / self._file, self.path)
            shutil.rmtree(self._folder)
        else:
            os.rename(self._folder, self.path)

    def _give_up(self) -> None:
        """Leave nothing behind; of what is to be kept, all that can be read of it."""
        if not self._keep or not any(self._mcap.counts.values()):
            self.abort()
            return
        if self._stream is not None:
            with contextlib.suppress(OSError):
                self._stream.close()
        with contextlib.suppress(OSError):
            self._move()
        self._say_kept()

    def _say_kept(self) -> None:
        place = self._folder if self._folder.exists() else self._name
        show(f'{place} holds what was written until then', file=sys.stderr)

    def abort(self) -> None:
        """Leave nothing behind."""
        if self._stream is not None:
            with contextlib.suppress(OSError):
                self._stream.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _write(self, block: Block) -> None:
        if not len(block):
            return
        try:
            self._mcap.write(block)
        except OSError as error:
            self._torn = True
            raise self._unwritable(error) from error

    def _information(self) -> dict[str, Any]:
        count = sum(self._mcap.counts.values())
        start = {'nanoseconds_since_epoch': self._mcap.start_ns if count else LATEST}
        length = {'nanoseconds': self._mcap.end_ns - self._mcap.start_ns if count else 0}
        return {
            'version': VERSION, 'storage_identifier': 'mcap', 'duration': {**length},
            'starting_time': {**start}, 'message_count': count,
            'topics_with_message_count': [
                {'topic_metadata': about, 'message_count': self._mcap.counts[channel]}
                for channel, about in self._topics.values()],
            'compression_format': '', 'compression_mode': '',
            'relative_file_paths': [self._file],
            'files': [{'path': self._file, 'starting_time': {**start}, 'duration': {**length},
                       'message_count': count}],
            'custom_data': None, 'ros_distro': 'jazzy'}

    def _unwritable(self, error: OSError) -> UserError:
        return UserError(f'{self._name} cannot be written: {error.strerror or error}')
