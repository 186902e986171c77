# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads bags: rosbag2 folders and single files, MCAP and sqlite3, split and compressed.

>>> with open_bag('recording') as bag:
...     for message in bag.messages(['/joint_states']):
...         print(message.log_ns, len(message.raw))
"""

from __future__ import annotations

import difflib
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import yaml

from estimator_pkg import whole_file
from estimator_pkg.bags import unpacking
from estimator_pkg.destination import METADATA
from estimator_pkg.errors import UserError, suggestion
from estimator_pkg.messages.block import Block, compact, from_messages, join, rows
from estimator_pkg.optional import Lazy
from estimator_pkg.printable import show

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

    from estimator_pkg.bags.log_file import Columns, LogFile
    from estimator_pkg.bags.mcap_file import McapFile
    from estimator_pkg.bags.sqlite_file import SqliteFile

log_file = Lazy('estimator_pkg.bags.log_file')
mcap_file = Lazy('estimator_pkg.bags.mcap_file')
sqlite_file = Lazy('estimator_pkg.bags.sqlite_file')

CDR = 'cdr'
INFORMATION = 'rosbag2_bagfile_information'
SUFFIXES = ('.mcap', '.db3', '.zstd')
ZSTD = b'\x28\xb5\x2f\xfd'  # a compressed message starts with this, CDR with a zero


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
    count: int = 0
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


class PendingBlock(NamedTuple):
    """Messages that are read together: time of the first, bytes when read, and what reads them."""

    start_ns: int
    size: int
    load: Callable[[], Block]


class Bag:
    """A bag that is open for reading; use `open_bag`.

    Each file adds its topics with `number`, and yields its `pieces`, whose blocks have these
    numbers, in the order of time; if it `SORTS`, they are known in advance and can be sorted with
    those of other files.

    Attributes
    ----------
    path, limit : its path, and the bytes that a chunk or message may unpack to.
    topics : name -> Topic.
    warnings : problems of the bag that did not prevent reading it.
    """

    def __init__(
        self, path: Path, unpack_limit: int = unpacking.UNPACK_LIMIT, columns: Columns | None = None
    ) -> None:
        self.path, self.limit = path, unpack_limit
        self._columns = columns
        self._size = 0  # bytes of all files
        self.warnings: list[str] = []
        self.topics: dict[str, Topic] = {}
        self._sources: list[LogFile | McapFile | SqliteFile] = []
        self._stack = ExitStack()
        try:
            self._open()
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise UserError(
                    f'cannot read {error.filename or path}: {error.strerror or error}'
                ) from error
            raise

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all files."""
        self._stack.close()

    @property
    def count(self) -> int:
        """Number of messages in the bag."""
        return sum(topic.count for topic in self.topics.values())

    def has(self, topic: str) -> bool:
        """Return True if the topic has messages."""
        return topic in self.topics and self.topics[topic].count > 0

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
            raise self._foreign(found)
        if types and found.type not in types:
            raise UserError(
                f"topic '{topic}' of {self.path} is {found.type}, not {' or '.join(types)}"
            )
        if not found.count:
            raise UserError(f"topic '{topic}' of {self.path} has 0 messages: name another")
        return found

    def check_messages(self) -> None:
        """Raise UserError if the bag has no message at all, or none in the format of ROS 2."""
        if not self.count:
            raise UserError(f'{self.path} is an empty bag: it has {self.listing()}; name another')
        recorded = [topic for topic in self.topics.values() if topic.count]
        if all(topic.serialization != CDR for topic in recorded):
            raise self._foreign(max(recorded, key=lambda topic: topic.count))

    def _foreign(self, topic: Topic) -> UnreadableError:
        return UnreadableError(
            f"topic '{topic.name}' of {self.path} cannot be read: its messages are "
            f"'{topic.serialization}', and ROS 2 needs CDR: convert the file to a bag of ROS 2"
        )

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
            columns = block.topic, block.log_ns, block.publish_ns, block.start, block.end
            for topic, log_ns, publish_ns, start, end in zip(*map(np.ndarray.tolist, columns)):
                yield Message(names[topic], log_ns, publish_ns, bytes(view[start:end]))

    def blocks(self, topics: Iterable[str] | None = None) -> Iterator[tuple[list[str], Block]]:
        """Yield (names, block): many messages at a time; `block.topic` are indices of `names`."""
        names = list(self.topics)
        chosen = set(names if topics is None else topics)
        keep = np.array([name in chosen for name in names])
        for block in self._in_log_order(keep):
            starts = block.start[block.end - block.start >= len(ZSTD)]
            packed = (rows(block.data, starts, len(ZSTD)) == np.frombuffer(ZSTD, np.uint8)).all(1)
            for part in self._unpacked(block) if packed.any() else (block,):
                if len(part):
                    yield names, part

    def _in_log_order(self, keep: np.ndarray) -> Iterator[Block]:
        """Yield the messages of the topics with `keep`; the pieces of files may overlap in time.

        The files of a split database, which has no index, follow each other.
        """
        pieces: Iterable[PendingBlock] = (
            piece for source in self._sources for piece in source.pieces(keep)
        )
        if all(source.SORTS for source in self._sources):
            pieces = sorted(pieces, key=lambda piece: piece.start_ns)
        most = max(self.limit, unpacking.UNPACK_RATIO * self._size)
        held: Block | None = None
        for start_ns, size, load in pieces:
            rest = None
            if held is not None:
                cut = int(np.searchsorted(held.log_ns, start_ns, 'right'))
                yield held.take(slice(cut))
                rest = compact(held.take(slice(cut, None))) if cut < len(held) else None
            if rest is not None:
                unpacking.check(
                    f'{self.path}: sorting the messages that overlap in time',
                    2 * (len(rest.data) + size),  # these messages, and the same joined
                    most,
                    'needs',
                )
            held = load()
            if not keep[held.topic].all():
                held = held.take(keep[held.topic])
            if rest is not None:
                held = join([rest, held]).in_log_order()
        if held is not None:
            yield held

    def _unpacked(self, block: Block) -> Iterator[Block]:
        """Yield messages of which some are compressed one by one, a few MB at a time."""
        view = block.data.data
        good: list[int] = []
        raws: list[bytes | memoryview] = []
        size = 0
        for row, (start, end) in enumerate(zip(block.start.tolist(), block.end.tolist())):
            raw: bytes | memoryview = view[start:end]
            try:
                if raw[: len(ZSTD)] == ZSTD:
                    raw = unpacking.unpack_message(raw, f'{self.path}: a message', self.limit)
            except ValueError:
                self.warn(f'{self.path} is damaged: messages that cannot be unpacked are skipped')
                continue
            if size + len(raw) > unpacking.PIECE_SIZE:
                yield _with(block, good, raws)
                good, raws, size = [], [], 0
            good.append(row)
            raws.append(raw)
            size += len(raw)
        yield _with(block, good, raws)

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
        if self.path.is_dir():
            self._open_folder()
        elif self.path.exists():
            self._open_file(self.path)
        elif link := whole_file.broken_link(self.path):
            raise UserError(f'{self.path} is {link}: name a bag')
        else:
            there = suggestion(self.path.name, (each.name for each in self.path.parent.glob('*')))
            remedy = there if 'mean' in there else 'check the path'
            raise UserError(f'{self.path} does not exist: {remedy}')
        if not self.topics:
            raise UserError(f'{self.path} is an empty bag: it has no topics; name another')

    def _open_folder(self) -> None:
        problems = []
        for file in self._files():
            before = dict(self.topics)
            try:
                self._open_file(file)
            except UserError as error:
                self.topics = before
                problems.append(str(error))
        if problems and not self._sources:
            raise UserError(problems[0])
        for problem in problems:
            self.warn(f'{problem}; it is skipped')

    def _files(self) -> list[Path]:
        """Return the files of the folder: those that its metadata list, else those it has."""
        listed = self._listed()
        found = [self.path / name for name in listed if (self.path / name).is_file()]
        missing = ', '.join(name for name in listed if self.path / name not in found)
        missing += f', listed in {METADATA}, is missing' if missing else ''
        if found and missing:
            self.warn(f'{self.path}: {missing}: its messages are skipped')
        if found:
            return found
        there = [file for file in self.path.iterdir() if file.suffix in SUFFIXES]
        there.sort(key=lambda file: (len(file.name), file.name))  # bag_10 after bag_9
        if not there:
            none = f'is not a bag: it has no {METADATA} and no .mcap or .db3 files'
            raise UserError(f'{self.path}: {missing}' if missing else f'{self.path} {none}')
        if not (self.path / METADATA).exists():
            self.warn(
                f'{self.path} has no {METADATA} (was its recorder killed?): '
                f'reading {len(there)} file{"s" if len(there) > 1 else ""}'
            )
        return there  # the listed ones were renamed with their folder

    def _listed(self) -> list[str]:
        """Return the names of files that the metadata list, if there are valid ones."""
        file = self.path / METADATA
        if not file.exists():
            return []
        try:
            found = yaml.safe_load(whole_file.read_text(file))[INFORMATION]
            return [Path(name).name for name in found['relative_file_paths']]
        except OSError:
            raise
        except Exception:  # the library may raise anything for a damaged file
            self.warn(f'{file} is not valid metadata: reading the files in its folder')
            return []

    def _open_file(self, file: Path) -> None:
        if not file.is_file():
            link = whole_file.broken_link(file)
            raise UserError(
                f'cannot read {file}: {f"it is {link}" if link else whole_file.NOT_A_FILE}'
            )
        if log_file.is_log(file):
            self._add(log_file.LogFile(file, self, self._columns))
            return
        if file.suffix == '.zstd':
            folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix='bag'))
            packed, file = file, Path(folder, file.stem)
            unpacking.unpack_file(packed, file, self.limit)
        with open(file, 'rb') as stream:
            start = stream.read(16)
        self._size += file.stat().st_size
        if start.startswith(b'SQLite format 3\0'):
            self._add(sqlite_file.SqliteFile(file, self))
        elif start.startswith(b'\x89MCAP0\r\n'):
            self._add(mcap_file.McapFile(file, self))
        elif start.startswith(b'#ROSBAG'):
            raise UserError(
                f"{file} is a bag of ROS 1: convert it with 'rosbags-convert --src {file.name} "
                f"--dst {file.stem}'"
            )
        elif not start:
            raise UserError(f'{file} is empty (0 bytes): name another file')
        else:
            raise UserError(f'{file} is not a bag: it is neither MCAP nor sqlite3')

    def _add(self, source: LogFile | McapFile | SqliteFile) -> None:
        self._stack.callback(source.close)
        self._sources.append(source)

    def number(self, topic: Topic) -> int:
        """Add the topic of a file, or the messages of a known one, and return its number."""
        package, slash, short = topic.type.partition('/')
        if slash and '/' not in short:  # some recorders leave out '/msg/'
            topic = replace(topic, type=f'{package}/msg/{short}')
        known = self.topics.get(topic.name)
        if known is not None:
            if known.type != topic.type:
                raise UserError(
                    f"{self.path}: topic '{topic.name}' has two types, {known.type} and "
                    f'{topic.type}: remove one'
                )
            topic = replace(known, count=known.count + topic.count)
        self.topics[topic.name] = topic
        return list(self.topics).index(topic.name)


def open_bag(
    path: str | Path, unpack_limit: int = unpacking.UNPACK_LIMIT, columns: Columns | None = None
) -> Bag:
    """Open the bag at `path`: a rosbag2 folder, a single .mcap or .db3 file, or a log.

    Parameters
    ----------
    unpack_limit : bytes that a compressed chunk or message may unpack to.
    columns : of a log, see `estimator_pkg.bags.log_file`.

    Raises
    ------
    UserError : it does not exist, is empty, or is not a bag.
    """
    return Bag(Path(path), unpack_limit, columns)


def _with(block: Block, good: list[int], raws: list[bytes | memoryview]) -> Block:
    """Return these messages of a block with other bytes."""
    taken = block.take(np.array(good, np.int64))
    return from_messages(taken.topic, taken.log_ns, taken.publish_ns, raws)
