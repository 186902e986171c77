"""Writing bags: a rosbag2 folder as ROS 2 Jazzy writes it, MCAP with zstd chunks.

>>> with BagWriter('out') as bag:
...     bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
...     bag.write('/joint_states', log_ns, raw)

The bag is written in a new folder beside its place and moved there when it is whole, so that an
error or an interrupt leaves no half of a bag. What cannot be made again (a recording) is kept all
the same. After a crash that folder stays, with the only copy: no other instance touches it, and the
next one names it (`crashed`).
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shlex
import shutil
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import yaml

from estimator_pkg import interrupts
from estimator_pkg.bags import qos as qos_profiles
from estimator_pkg.bags.definitions import define
from estimator_pkg.errors import UserError
from estimator_pkg.messages.block import Block, from_messages
from estimator_pkg.optional import Lazy

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

mcap_output = Lazy('estimator_pkg.bags.mcap_output')
interfaces = Lazy('rosbags.interfaces')

CHUNK_SIZE = 1 << 20  # bytes of messages that are written together, as one chunk
VERSION = 9  # of metadata.yaml, as Jazzy writes it
OTHERS = ('.db3', '.bag', '.zstd', '.lz4')  # files of bags of other kinds
HOW = '`velocity_estimator record --recover {} --out BAG` makes a bag of it'
LATEST = 2**63 - 1  # the starting time of a bag without messages


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
        self._torn = False  # a write failed: the end of the file is not known
        self.path = Path(os.path.abspath(path))
        self._name = Path(path)
        self._bare = self.path.suffix == '.mcap'
        self._topics: dict[str, tuple[int, dict[str, Any]]] = {}
        self._pending: tuple[list[int], list[int], list[int], list[bytes]] = ([], [], [], [])
        self._pending_size = 0
        if self.path.suffix in OTHERS:
            raise UserError(
                f'{path}: bags are written as MCAP: name a folder, or a file that ends in .mcap'
            )
        if os.path.lexists(self.path):
            raise UserError(f'{path} exists already: name another place, or remove it first')
        if not self.path.parent.is_dir():
            raise UserError(f'{path} cannot be written: there is no folder {self._name.parent}')
        output = mcap_output.McapOutput  # a missing library is found before anything is made
        for folder in crashed(self.path):
            interrupts.say(
                f'warning: {folder} holds what was written when a process that made '
                f'{path} was killed: {HOW.format(shlex.quote(str(folder)))}'
            )
        self._folder: Path | None = None
        self._file = f'{self.path.stem}_0.mcap' if not self._bare else self.path.name
        self._stream: BinaryIO | None = None
        try:
            self._folder = _new_folder(self.path)
            self._stream = (self._folder / self._file).open('xb')
            _mark(self._stream)
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
            with contextlib.suppress(UserError):  # the first error is the one to be told
                self.close()
                self._say_kept()

    def add_topic(
        self,
        name: str,
        type_name: str,
        qos: Sequence[Qos] | Qos | None = None,
        *,
        definition: str = '',
        definition_format: str = 'ros2msg',
        type_hash: str = '',
        serialization: str = 'cdr',
    ) -> int:
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
        profiles: Any = (
            [qos_profiles.profile()]
            if qos is None
            else [qos]
            if isinstance(qos, interfaces.Qos)
            else list(qos)
        )
        known = define(type_name)
        if not definition:
            definition, definition_format = known[0], 'ros2msg'
        type_hash = type_hash or known[1]
        channel = self._mcap.add_channel(
            name,
            type_name,
            definition_format,
            definition,
            {'offered_qos_profiles': qos_profiles.to_text(profiles), 'topic_type_hash': type_hash},
            serialization,
        )
        self._topics[name] = (
            channel,
            {
                'name': name,
                'type': type_name,
                'serialization_format': serialization,
                'offered_qos_profiles': qos_profiles.plain(profiles),
                'type_description_hash': type_hash,
            },
        )
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
        return {
            name: self._mcap.counts[channel] + pending[channel]
            for name, (channel, _) in self._topics.items()
        }

    def close(self) -> None:
        """Finish the bag and move it to its place.

        Raises
        ------
        UserError : that was not possible; nothing is left behind, but for what is to be kept.
        """
        try:
            self.flush()
            information = self._information()
            self._mcap.finish(
                {'serialized_metadata': yaml.safe_dump(information, sort_keys=False).strip()}
            )
            assert self._stream is not None
            self._stream.close()
            if not self._bare:
                text = yaml.safe_dump({'rosbag2_bagfile_information': information}, sort_keys=False)
                assert self._folder is not None
                (self._folder / 'metadata.yaml').write_text(text, encoding='utf-8')
            self._move()
        except OSError as error:
            self._give_up()
            raise self._unwritable(error) from error
        except BaseException:
            self._give_up()
            raise

    def _move(self) -> None:
        """Put what was written in its place; fails where something is by now.

        The place is reserved first, which fails if somebody else has it; only then something is
        replaced: what this instance has just made. So no hard links are needed.
        """
        assert self._folder is not None
        if self._bare:
            with open(self.path, 'xb'):
                pass
            made: Path = self._folder / self._file
        else:
            self.path.mkdir()
            made = self._folder
        try:
            os.replace(made, self.path)
        except OSError:
            if self._bare:
                self.path.unlink()
                raise
            self.path.rmdir()
            os.rename(made, self.path)  # where no folder, even an empty one, can be replaced
        if self._bare:
            self._folder.rmdir()
        self._folder = None

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
        if self._folder is None:
            interrupts.say(f'{self._name} holds what was written until then')
        else:
            interrupts.say(
                f'{self._folder} holds what was written until then: '
                + HOW.format(shlex.quote(str(self._folder)))
            )

    def abort(self) -> None:
        """Leave nothing behind."""
        if self._stream is not None:
            with contextlib.suppress(OSError):
                self._stream.close()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None

    def _write(self, block: Block) -> None:
        if not len(block):
            return
        try:
            self._mcap.write(block)
        except BaseException as error:  # a second Ctrl-C too
            self._torn = True
            if isinstance(error, OSError):
                raise self._unwritable(error) from error
            raise

    def _information(self) -> dict[str, Any]:
        count = sum(self._mcap.counts.values())
        start = {'nanoseconds_since_epoch': self._mcap.start_ns if count else LATEST}
        length = {'nanoseconds': self._mcap.end_ns - self._mcap.start_ns if count else 0}
        return {
            'version': VERSION,
            'storage_identifier': 'mcap',
            'duration': {**length},
            'starting_time': {**start},
            'message_count': count,
            'topics_with_message_count': [
                {'topic_metadata': about, 'message_count': self._mcap.counts[channel]}
                for channel, about in self._topics.values()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self._file],
            'files': [
                {
                    'path': self._file,
                    'starting_time': {**start},
                    'duration': {**length},
                    'message_count': count,
                }
            ],
            'custom_data': None,
            'ros_distro': 'jazzy',
        }

    def _unwritable(self, error: OSError) -> UserError:
        return UserError(f'{self._name} cannot be written: {error.strerror or error}')


def _new_folder(path: Path) -> Path:
    """Make a folder beside `path` that nobody else has; raises OSError if that is not possible."""
    while True:
        folder = path.parent / f'.{path.name}.{secrets.token_hex(4)}.part'
        with contextlib.suppress(FileExistsError):
            folder.mkdir()
            return folder


def _mark(stream: BinaryIO) -> None:
    """Lock the file while this process lives, where the system has such locks."""
    with contextlib.suppress(ImportError, OSError):
        import fcntl

        fcntl.flock(stream.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)


def in_use(file: Path) -> bool:
    """True if a process that lives is writing this file."""
    try:
        import fcntl

        with open(file, 'rb') as stream:
            fcntl.flock(stream.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except (ImportError, OSError):
        pass
    return False


def crashed(path: Path) -> list[Path]:
    """Return the folders beside `path` that writers of it left when they were killed.

    Parameters
    ----------
    path : of the bag that was to be made.
    """
    name = re.compile(re.escape(f'.{path.name}.') + r'[0-9a-f]+\.part')
    try:
        found = sorted(
            folder
            for folder in path.parent.iterdir()
            if name.fullmatch(folder.name) and folder.is_dir()
        )
        return [
            folder
            for folder in found
            if any(folder.iterdir()) and not any(in_use(file) for file in folder.iterdir())
        ]
    except OSError:
        return []
