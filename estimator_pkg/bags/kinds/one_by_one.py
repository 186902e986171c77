"""Replay of nodes that take message by message, and recordings made of such messages."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.block import Block, compact
from estimator_pkg.bags.kinds import named
from estimator_pkg.bags.kinds.contract import Answers, Estimate, Recording, Replay, Setup, System
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.series import at_stamps
from estimator_pkg.errors import UserError
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.drive_samples import Batch
from estimator_pkg.messages.joint_state_block import decode_block

APART = 8   # ranks of one answer's messages: fewer than so many outputs


class OneByOne(Replay):
    """Takes messages one by one, as the node does.

    Attributes
    ----------
    received, malformed, answered : messages of the measurement, those of them that cannot be read,
        and those that were answered with an estimate.
    inputs_malformed : messages of other topics that cannot be read.
    """

    def __init__(self) -> None:
        self.received = self.malformed = self.answered = self.inputs_malformed = 0
        self._read: dict[str, tuple[int, int]] = {}

    @abstractmethod
    def take(self, topic: str, raw: bytes, publish_ns: int) -> list[dict[int, bytes]]:
        """The answers to one message: each the bytes by output.

        Raises
        ------
        MalformedMessageError : it is of another type.
        """

    def feed(self, names: Sequence[str], block: Block) -> list[Answers]:
        """See `Replay`."""
        made: dict[tuple[int, int], tuple[list[int], list[int], list[bytes]]] = {}
        topics = block.topic.tolist()
        times = block.publish_ns.tolist()
        for row in range(len(block)):
            raw = block.data[block.start[row]:block.end[row]].tobytes()
            topic = names[topics[row]]
            before, unread = self.received, self.unread()
            answers: list[dict[int, bytes]] = []
            try:
                answers = self.take(topic, raw, times[row])
            except MalformedMessageError:
                if self.received > before:
                    self.malformed += 1
                else:
                    self.inputs_malformed += 1
            count, malformed = self._read.get(topic, (0, 0))
            self._read[topic] = count + 1, malformed + self.unread() - unread
            for number, answer in enumerate(answers):
                for output, message in answer.items():
                    rows, ranks, raws = made.setdefault((output, len(message)), ([], [], []))
                    rows.append(row)
                    ranks.append(APART * number + output + 1)
                    raws.append(message)
        return [Answers(output, np.array(rows), np.array(ranks),
                        np.frombuffer(b''.join(raws), np.uint8).reshape(len(rows), size))
                for (output, size), (rows, ranks, raws) in made.items()]

    def unread(self) -> int:
        """Malformed messages so far, of all topics."""
        return self.malformed + self.inputs_malformed

    def read(self) -> dict[str, tuple[int, int]]:
        """See `Replay`."""
        return self._read

    def messages(self) -> dict[str, Any]:
        """See `Replay`."""
        unused = {**self.unused(), 'malformed': self.malformed}
        return {'received': self.received,
                'used': self.received - sum(unused.values()),
                'dropped': {kind: count for kind, count in unused.items() if count},
                'estimates': self.answered, 'inputs_malformed': self.inputs_malformed}

    def unused(self) -> dict[str, int]:
        """Messages that were not used, by kind, beside the malformed ones."""
        return {}


@dataclass(frozen=True)
class MessageRecording(Recording):
    """The messages of a bag that a node listens to.

    kind : its name. blocks : with the names of the bag's topics. fine : an estimate of every sample
    of a batch is told, where the node tells them.
    """

    path: str
    kind: str
    setup: Setup
    blocks: tuple[tuple[list[str], Block], ...]
    fine: bool = field(default=False, kw_only=True)

    def run(self, observer: str, values: Mapping[str, Any], fast: bool | None = None
            ) -> dict[str, Estimate]:
        """See `Recording`."""
        replay = named(self.kind).start(self.setup.having({**values, 'observer': observer}))
        collected = _Collected(replay.batches if self.fine else {})
        for names, block in self.blocks:
            collected.add(replay.answers(names, block))
        replay.end(self.path)
        found = collected.estimates(replay.systems())
        if not found:
            why = replay.why()
            raise UserError(f'{self.path}: {observer} gives no estimate' + (
                f': {why}' if why else ''))
        return found

    def split(self, held_out: float) -> tuple[Recording, Recording]:
        """See `Recording`. Observers that learn run through the first part to the last."""
        left = self.size() - round(held_out * self.size())
        first = []
        for names, block in self.blocks:
            cut = min(left, len(block))
            left -= cut
            if cut:
                first.append((names, compact(block.take(slice(cut)))))
        return replace(self, blocks=tuple(first)), self

    def per_sample(self) -> Recording:
        """See `Recording`."""
        return replace(self, fine=True)

    def size(self) -> int:
        """Messages."""
        return sum(len(block) for _, block in self.blocks)


def recorded(bag: Bag, kind: str, setup: Setup) -> MessageRecording:
    """The messages of the setup's topics."""
    topics = {topic.name for topic in setup.topics}
    return MessageRecording(str(bag.path), kind, setup, tuple(
        (list(names), compact(block)) for names, block in bag.blocks(topics)))


class _Collected:
    """Estimates out of the messages that carry them.

    Parameters
    ----------
    batches : see `Replay`.
    """

    def __init__(self, batches: Mapping[int, str]) -> None:
        self._first = 0
        self._joints = batches
        self._batches: dict[str, list[Batch]] = {}
        # by output: keys (which answer), stamps, and the messages' numbers by joint
        self._pieces: tuple[dict[str, list], ...] = ({}, {})
        self._due: list[NDArray[np.int64]] = []

    def add(self, answers: Iterable[Answers]) -> None:
        """The answers to the next block."""
        last = 0
        for each in answers:
            if len(each.rows):
                last = max(last, int(each.rows[-1]) + 1)
            if each.output in self._joints:
                self._batches.setdefault(self._joints[each.output], []).extend(
                    drive_samples.decode(raw.tobytes()) for raw in each.raw)
            if each.output > 1:
                continue
            count, size = each.raw.shape
            keys = ((each.rows + self._first) * 2 ** 16
                    + np.broadcast_to(np.asarray(each.rank) // APART, count))
            ends, none = np.arange(1, count + 1) * size, np.zeros(count, np.int64)
            groups, _ = decode_block(Block(none, none, none, each.raw.ravel(), ends - size, ends))
            for group in groups:
                if each.output == 0:
                    self._due.append(group.stamps_ns)
                for column, name in enumerate(group.names):
                    self._pieces[each.output].setdefault(name, []).append(
                        (keys[group.rows], group.stamps_ns, group.arrays[0][:, column],
                         group.arrays[1][:, column]))
        self._first += last

    def estimates(self, systems: Mapping[str, System]) -> dict[str, Estimate]:
        """By joint."""
        due = np.unique(np.concatenate(self._due)) if self._due else np.zeros(0, np.int64)
        deviations = {name: _joined(pieces) for name, pieces in self._pieces[1].items()}
        found = {}
        for name, pieces in self._pieces[0].items():
            keys, stamps, position, velocity = _joined(pieces)
            stddev = np.full(len(stamps), np.nan)
            if name in deviations:
                known, _, _, of_velocity = deviations[name]
                at = np.minimum(np.searchsorted(known, keys), len(known) - 1)
                same = known[at] == keys
                stddev[same] = of_velocity[at[same]]
            system = next((each for each in systems.values() if name in each.names), None)
            found[name] = Estimate(
                stamps, position, velocity, stddev,
                system.counts() if system else {'received': len(stamps), 'used': len(stamps),
                                                'dropped': {}},
                dict(system.seconds) if system else {},
                np.array(system.stamps if system else [], np.int64),
                np.array(system.statuses if system else [], np.int8), due)
        return {**found, **{name: _of_batches(batches, found[name])
                            for name, batches in self._batches.items() if name in found}}


def _of_batches(batches: list[Batch], one_each: Estimate) -> Estimate:
    """The estimates of every sample.

    Parameters
    ----------
    one_each : the last of every batch, the only ones whose standard deviation is told.
    """
    stamps = np.concatenate([batch.stamps_ns for batch in batches])
    values = np.concatenate([batch.values for batch in batches])
    valid = values[:, 3] > 0.5
    return one_each._replace(
        stamps=stamps[valid], position=values[valid, 0], velocity=values[valid, 1],
        velocity_stddev=at_stamps(stamps[valid], one_each.stamps, one_each.velocity_stddev),
        due=np.unique(stamps))


def _joined(pieces: list) -> tuple[NDArray, ...]:
    """The columns of all pieces in the order of their keys."""
    columns = [np.concatenate([piece[i] for piece in pieces]) for i in range(4)]
    order = np.argsort(columns[0], kind='stable')
    return tuple(column[order] for column in columns)
