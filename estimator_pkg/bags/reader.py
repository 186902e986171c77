# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads bags: rosbag2 folders and single files, MCAP and sqlite3, split and compressed.

>>> with open_bag('recording') as bag:
...     for message in bag.messages(['/joint_states']):
...         print(message.log_ns, len(message.raw))
"""

from __future__ import annotations

import difflib
import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import yaml

from estimator_pkg import whole_file
from estimator_pkg.bags import qos as qos_profiles
from estimator_pkg.bags import unpacking
from estimator_pkg.destination import METADATA
from estimator_pkg.errors import UserError
from estimator_pkg.messages.block import Block, compact, from_messages, join
from estimator_pkg.optional import Lazy
from estimator_pkg.printable import show

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

    from estimator_pkg.bags.mcap_file import McapFile
    from estimator_pkg.bags.sqlite_file import SqliteFile

mcap_file = Lazy('estimator_pkg.bags.mcap_file')
sqlite_file = Lazy('estimator_pkg.bags.sqlite_file')
zstandard = Lazy('zstandard')

INFORMATION = 'rosbag2_bagfile_information'
CDR = 'cdr'
ROS1 = b'#ROSBAG'


class UnreadableError(UserError):
    """A topic exists, but none of its messages can be decoded."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag.

    Attributes
    ----------
    name, type : as in '/joint_states', 'sensor_msgs/msg/JointState'.
    count : messages in the bag.
    qos : the profiles that its publishers offered.
    definition, type_hash : the message definition and RIHS01 hash; empty if the bag has none.
    definition_format : 'ros2msg' or 'ros2idl'.
    serialization : 'cdr', or another format of a foreign recorder.
    """

    name: str
    type: str
    count: int
    qos: tuple[Qos, ...] = ()
    definition: str = field(default='', repr=False)
    type_hash: str = ''
    definition_format: str = 'ros2msg'
    serialization: str = CDR


class Message(NamedTuple):
    """One message: topic, time of recording and publishing [ns], CDR bytes."""

    topic: str
    log_ns: int
    publish_ns: int
    raw: bytes


class Bag:
    """A bag that is open for reading; use `open_bag`.

    Attributes
    ----------
    path : its path.
    topics : name -> Topic.
    warnings : problems of the bag that did not prevent reading it.
    """

    def __init__(self, path: Path, unpack_limit: int = unpacking.LIMIT) -> None:
        self.path = path
        self._limit = unpack_limit
        self._size = 0  # bytes of all files
        self.warnings: list[str] = []
        self.topics: dict[str, Topic] = {}
        self._names: list[str] = []
        self._mcaps: list[tuple[McapFile, np.ndarray]] = []  # with channel id -> topic index
        self._sqlites: list[tuple[SqliteFile, np.ndarray]] = []  # with place -> topic index
        self._unpack_messages = False
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all files."""
        for mcap, _ in self._mcaps:
            mcap.close()
        for sqlite, _ in self._sqlites:
            sqlite.close()
        if self._folder is not None:
            self._folder.cleanup()

    @property
    def count(self) -> int:
        """Number of messages in the bag."""
        return sum(topic.count for topic in self.topics.values())

    def require(self, topic: str, types: Sequence[str] = ()) -> Topic:
        """Return the topic called `topic`.

        Parameters
        ----------
        types : accepted message types; empty: any.

        Raises
        ------
        UserError : the bag has no such topic (the message lists its topics), or the topic has no
            messages or another type.
        """
        found = self.topics.get(topic)
        if found is None:
            near = difflib.get_close_matches(topic, self.topics, n=1, cutoff=0.7)
            raise UserError(
                f"{self.path} has no topic '{topic}'"
                + (f" (did you mean '{near[0]}'?)" if near else '')
                + f': it has {self.listing()}'
            )
        if found.serialization != CDR:
            raise UnreadableError(
                f"topic '{topic}' of {self.path} cannot be read: its messages "
                f"are '{found.serialization}', and ROS 2 needs CDR"
            )
        if types and found.type not in types:
            raise UserError(
                f"topic '{topic}' of {self.path} is {found.type}, not {' or '.join(types)}"
            )
        if not found.count:
            raise UserError(f"topic '{topic}' of {self.path} has 0 messages: name another")
        return found

    def check_messages(self) -> None:
        """Raise UserError if the bag has no message at all."""
        if not self.count:
            raise UserError(f'{self.path} is an empty bag: it has {self.listing()}; name another')

    def listing(self) -> str:
        """Return the topics with their types and counts, as text."""
        return ', '.join(
            f'{topic.name} ({topic.type}, {topic.count} message{"s" * (topic.count != 1)})'
            for topic in sorted(self.topics.values(), key=lambda item: item.name)
        )

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[Message]:
        """Yield the messages of these topics (None: all), in log order."""
        for names, block in self.blocks(topics):
            view = block.data.data
            for row in zip(
                block.topic.tolist(),
                block.log_ns.tolist(),
                block.publish_ns.tolist(),
                block.start.tolist(),
                block.end.tolist(),
            ):
                yield Message(names[row[0]], row[1], row[2], bytes(view[row[3] : row[4]]))

    def blocks(self, topics: Iterable[str] | None = None) -> Iterator[tuple[list[str], Block]]:
        """Yield (names, block): many messages at a time; `block.topic` are indices of `names`."""
        chosen = set(self.topics if topics is None else topics)
        keep = np.array([name in chosen for name in self._names] + [False])
        for block in _merged(
            sorted(self._parts(keep), key=lambda part: part[0])
            if not self._sqlites
            else self._sqlite_parts(keep),
            self._has_room,
        ):
            for part in self._unpacked(block) if self._unpack_messages else (block,):
                if len(part):
                    yield self._names, part

    def _has_room(self, size: int) -> None:
        """Raise TooLargeError if sorting takes too much memory, `size` bytes."""
        unpacking.check(
            f'{self.path}: sorting the messages that overlap in time',
            size,
            max(self._limit, unpacking.RATIO * self._size),
            'needs',
        )

    def _parts(self, keep: np.ndarray) -> Iterator[tuple[int, int, Callable[[], Block]]]:
        for mcap, index in self._mcaps:
            channels = [channel for channel in mcap.counts if keep[index[channel]]]
            if not channels:
                continue
            for start_ns, size, load in mcap.parts():

                def translated(
                    load: Callable[[], Block] = load, index: np.ndarray = index
                ) -> Block:
                    block = load()
                    topic = index[np.minimum(block.topic, len(index) - 1)]
                    block = replace(block, topic=topic)
                    chosen = keep[topic]
                    return block if chosen.all() else block.take(chosen)

                yield start_ns, size, translated

    def _sqlite_parts(self, keep: np.ndarray) -> Iterator[tuple[int, int, Callable[[], Block]]]:
        """Yield the blocks of all files in turn; the files of a split bag follow each other."""
        for sqlite, index in self._sqlites:
            for start_ns, load in sqlite.parts(set(np.flatnonzero(keep[index]).tolist())):
                block = load()
                yield start_ns, len(block.data), partial(replace, block, topic=index[block.topic])

    def _unpacked(self, block: Block) -> Iterator[Block]:
        """Yield the messages of a bag with messages compressed one by one, a few MB at a time."""
        view = block.data.data
        rows: list[int] = []
        raws: list[memoryview] = []
        size = 0

        def unpacked() -> Block:
            good = block.take(np.array(rows, np.int64))
            return from_messages(
                good.topic.tolist(), good.log_ns.tolist(), good.publish_ns.tolist(), raws
            )

        for row, (start, end) in enumerate(zip(block.start.tolist(), block.end.tolist())):
            try:
                raw = unpacking.unpack_message(
                    view[start:end], f'{self.path}: a message', self._limit
                )
            except zstandard.ZstdError:
                self.warn(f'{self.path} is damaged: messages that cannot be unpacked are skipped')
                continue
            if size + len(raw) > unpacking.PIECE:
                yield unpacked()
                rows, raws, size = [], [], 0
            rows.append(row)
            raws.append(raw)
            size += len(raw)
        yield unpacked()

    def warn(self, text: str) -> None:
        """Print a warning about the bag, once."""
        if text not in self.warnings:
            self.warnings.append(text)
            show(f'warning: {text}', file=sys.stderr)

    def count_malformed(self, topic: str, count: int, malformed: int) -> None:
        """Warn of messages of a topic that cannot be decoded.

        Raises
        ------
        UnreadableError : all `count` messages are malformed.
        """
        if malformed and malformed == count:
            raise UnreadableError(
                f"no message of '{topic}' of {self.path} can be read: all {count} are malformed"
            )
        if malformed:
            self.warn(
                f"{malformed} of {count} messages of '{topic}' of {self.path} are malformed "
                'and are skipped'
            )

    def _open(self) -> None:
        try:
            if self.path.is_dir():
                self._open_folder()
            elif self.path.exists():
                self._open_file(self.path)
            else:
                raise UserError(f'{self.path} does not exist')
        except OSError as error:
            raise UserError(
                f'cannot read {error.filename or self.path}: {error.strerror or error}'
            ) from error
        if not self.topics:
            raise UserError(f'{self.path} is an empty bag: it has no topics; name another')

    def _open_folder(self) -> None:
        information = self._metadata()
        files = self._files(information)
        mode = str(information.get('compression_mode') or '').lower()
        self._unpack_messages = mode == 'message'
        packed = information.get('compression_format')
        if self._unpack_messages and packed not in ('zstd', '', None):
            raise UserError(
                f"{self.path}: its messages are compressed with '{packed}', but only zstd is "
                'supported: convert the bag'
            )
        problems = []
        for file in files:
            try:
                self._open_file(file)
            except UserError as error:
                problems.append(str(error))
        if problems and not self._mcaps and not self._sqlites:
            raise UserError(problems[0])
        for problem in problems:
            self.warn(f'{problem}; it is skipped')
        for about in _described(information):
            self._add_described(about)

    def _files(self, information: Mapping[str, Any]) -> list[Path]:
        """Return the files of the folder: those that its metadata list, else those it has."""
        listed = _names_of_files(information)
        if listed:
            files = [self.path / name for name in listed]
            missing = [file.name for file in files if not file.is_file()]
            if len(missing) == len(files):
                raise UserError(f'{self.path}: {missing[0]}, listed in {METADATA}, is missing')
            if missing:
                self.warn(
                    f'{self.path}: {", ".join(missing)}, listed in {METADATA}, is missing: '
                    'its messages are skipped'
                )
            return [file for file in files if file.is_file()]
        files = sorted(
            (file for file in self.path.iterdir() if file.suffix in ('.mcap', '.db3', '.zstd')),
            key=natural,
        )
        if not files:
            raise UserError(
                f'{self.path} is not a bag: it has no {METADATA} and no .mcap or .db3 files'
            )
        if not (self.path / METADATA).exists():
            self.warn(
                f'{self.path} has no {METADATA} (was its recorder killed?): '
                f'reading {len(files)} file{"s" if len(files) > 1 else ""}'
            )
        return files

    def _add_described(self, about: Mapping[str, Any]) -> None:
        """Add a topic as the metadata describe it; its messages are counted in the files."""
        name, type_name = about.get('name'), about.get('type')
        if not (isinstance(name, str) and name and isinstance(type_name, str)):
            self.warn(
                f'{self.path / METADATA}: the description of a topic is damaged and is skipped'
            )
            return
        type_hash, serialization = (
            about.get('type_description_hash'),
            about.get('serialization_format'),
        )
        self._add(
            name,
            type_name,
            0,
            qos_profiles.parse(about.get('offered_qos_profiles')),
            type_hash=type_hash if isinstance(type_hash, str) else '',
            serialization=CDR if serialization in (None, '') else str(serialization),
        )

    def _metadata(self) -> dict[str, Any]:
        file = self.path / METADATA
        if not file.exists():
            return {}
        try:
            return dict(yaml.safe_load(whole_file.read_text(file))[INFORMATION])
        except OSError:
            raise
        except Exception:  # the library may raise anything for a damaged file
            self.warn(f'{file} is not valid metadata: reading the files in its folder')
            return {}

    def _open_file(self, file: Path) -> None:
        if not file.is_file():
            raise UserError(f'cannot read {file}: {whole_file.NOT_A_FILE}')
        if file.suffix == '.zstd':
            file = self._unpacked_file(file)
        with open(file, 'rb') as stream:
            start = stream.read(len(ROS1))
        self._size += file.stat().st_size
        if start == ROS1:
            raise UserError(
                f"{file} is a bag of ROS 1: convert it with 'rosbags-convert --src {file.name} "
                f"--dst {file.stem}'"
            )
        if start[:6] == b'SQLite':
            self._add_sqlite(sqlite_file.SqliteFile(file, self.warn, self._limit))
        elif start[:5] == b'\x89MCAP':
            self._add_mcap(mcap_file.McapFile(file, self.warn, self._limit))
        elif not start:
            raise UserError(f'{file} is empty (0 bytes): name another file')
        else:
            raise UserError(f'{file} is not a bag: it is neither MCAP nor sqlite3')

    def _unpacked_file(self, file: Path) -> Path:
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix='bag')
        target = Path(self._folder.name, file.stem)
        unpacking.unpack_file(file, target, self._limit)
        return target

    def _add_mcap(self, mcap: McapFile) -> None:
        index = np.full(max(mcap.channels, default=0) + 2, -1)
        for key, channel in mcap.channels.items():
            schema = mcap.schemas.get(channel.schema_id)
            index[key] = self._add(
                channel.topic,
                schema.name if schema else '',
                mcap.counts.get(key, 0),
                qos_profiles.parse(channel.metadata.get('offered_qos_profiles', '')),
                definition=schema.data.decode('utf-8', 'replace') if schema else '',
                type_hash=channel.metadata.get('topic_type_hash', ''),
                definition_format=schema.encoding if schema else '',
                serialization=channel.message_encoding,
            )
        self._mcaps.append((mcap, index))

    def _add_sqlite(self, sqlite: SqliteFile) -> None:
        index = []
        for item in sqlite.connections:
            extension: Any = item.ext  # rosbag2's; rosbags has the same class for rosbag1
            index.append(
                self._add(
                    item.topic,
                    item.msgtype,
                    item.msgcount,
                    list(extension.offered_qos_profiles),
                    definition=item.msgdef.data,
                    type_hash=item.digest,
                    serialization=str(extension.serialization_format),
                )
            )
        self._sqlites.append((sqlite, np.array(index, np.int64)))

    def _add(
        self,
        name: str,
        type_name: str,
        count: int,
        qos: Sequence[Qos],
        *,
        definition: str = '',
        type_hash: str = '',
        definition_format: str = 'ros2msg',
        serialization: str = CDR,
    ) -> int:
        """Return the topic's index; -1 if another type of the same name came before."""
        known = self.topics.get(name)
        if known is None:
            self._names.append(name)
            known = Topic(name, type_name, 0)
        elif known.type != type_name:
            self.warn(
                f"{self.path}: topic '{name}' has two types, {known.type} and {type_name}: "
                'the latter is skipped'
            )
            return -1
        self.topics[name] = Topic(
            name,
            type_name,
            known.count + count,
            known.qos + tuple(item for item in qos if item not in known.qos),
            known.definition or definition,
            known.type_hash or type_hash,
            definition_format if definition and not known.definition else known.definition_format,
            serialization if known.serialization == CDR else known.serialization,
        )
        return self._names.index(name)


def open_bag(path: str | Path, unpack_limit: int = unpacking.LIMIT) -> Bag:
    """Open the bag at `path`: a rosbag2 folder, or a single .mcap or .db3 file.

    Parameters
    ----------
    unpack_limit : bytes that a compressed chunk or message may unpack to.

    Raises
    ------
    UserError : it does not exist, is empty, or is not a bag.
    """
    return Bag(Path(path), unpack_limit)


def _names_of_files(information: Mapping[str, Any]) -> list[str]:
    """Return the file names that the metadata list; [] if the list is invalid."""
    listed = information.get('relative_file_paths')
    if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
        return []
    names = [Path(name).name for name in listed]
    return [] if any(name in ('', '..') or '\0' in name for name in names) else names


def _described(information: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the descriptions of topics in the metadata; {} for an invalid one."""
    listed = information.get('topics_with_message_count')
    found = [
        item.get('topic_metadata') if isinstance(item, Mapping) else None
        for item in (listed if isinstance(listed, list) else [])
    ]
    return [about if isinstance(about, Mapping) else {} for about in found]


def natural(file: Path) -> list[tuple]:
    """Return a sort key under which wbag_10 comes after wbag_9."""
    parts = re.findall(r'(\d+)|(\D)', file.name)
    return [(0, int(digits), '') if digits else (1, 0, letter) for digits, letter in parts]


def _merged(
    parts: Iterable[tuple[int, int, Callable[[], Block]]], has_room: Callable[[int], None]
) -> Iterator[Block]:
    """Yield blocks in log order from parts sorted by their first time, which may overlap.

    Parameters
    ----------
    has_room : raises UserError if overlapping messages take too many bytes.
    """
    held: Block | None = None
    for start_ns, size, load in parts:
        if held is not None and len(held) and held.log_ns[-1] > start_ns:
            cut = int(np.searchsorted(held.log_ns, start_ns, 'right'))
            if cut:
                yield held.take(slice(0, cut))
            held = compact(held.take(slice(cut, None)))
            has_room(2 * (len(held.data) + size))  # these messages, and the same joined
            held = join([held, load()]).in_log_order()
            continue
        if held is not None and len(held):
            yield held
        held = load()
    if held is not None and len(held):
        yield held
