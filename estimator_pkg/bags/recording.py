# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The input of observers from a bag, read once and run with one set of gains after another."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import streams
from estimator_pkg.bags.feeding import STRIDE, answers
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.series import Series, at_stamps, of_positions, positions
from estimator_pkg.bags.wiring import Setup
from estimator_pkg.errors import UserError
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.block import Block, compact
from estimator_pkg.messages.drive_samples import Batch
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.messages.joint_state_block import decode_block
from estimator_pkg.observers.contract import VALID
from estimator_pkg.streams.contract import PUBLISHER, Answers, Stream
from estimator_pkg.streams.history import History
from estimator_pkg.streams.sources import FieldSamples


class Estimate(NamedTuple):
    """One joint's published estimates, and the status of its samples.

    velocity_stddev : shape (n,); nan if it is not known.
    validity : seconds by status, or published and withheld.
    status_stamps, status : shape (k,), of every used sample; empty if it is not known.
    due : shape (m,), stamps at which an estimate could have been published; empty if it is not
        known.
    """

    stamps: NDArray[np.int64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    velocity_stddev: NDArray[np.float64]
    samples: dict[str, Any]
    validity: dict[str, float]
    status_stamps: NDArray[np.int64]
    status: NDArray[np.int8]
    due: NDArray[np.int64] = np.zeros(0, np.int64)


class Recording(ABC):
    """The input of one family's observers from a bag; it can be sent to another process.

    setup : its settings and topics.
    """

    setup: Setup

    @abstractmethod
    def run(
        self, observer: str, values: Mapping[str, Any], fast: bool | None = None
    ) -> dict[str, Estimate]:
        """Return the estimates that this observer publishes with these parameters, by joint.

        Parameters
        ----------
        fast : compile or not, if the family can; None: if it pays.

        Raises
        ------
        UserError, UsageError : a parameter is wrong, or the bag lacks an input of the observer.
        """

    @abstractmethod
    def split(self, held_out: float) -> tuple[Recording, Recording]:
        """Return the recording without its last part, and one for the estimates of the last part.

        The latter may begin earlier, for observers that need to settle.
        """

    def by_joint(self) -> Mapping[str | None, Recording]:
        """Return the recordings that can have their own gains, by joint; {None: self} for one."""
        return {None: self}

    def per_sample(self) -> Recording:
        """Return the same with an estimate of every sample, if messages contain many samples."""
        return self

    def size(self) -> int:
        """Return the number of samples."""
        return 0


def recording(bag: Bag, setup: Setup, known: Mapping[str, Series]) -> Recording:
    """Return the input of the setup's family from the bag.

    Parameters
    ----------
    known : the result of `measured`, if it was read already.

    Raises
    ------
    UserError : the bag has no position, and the family needs only positions.
    """
    stream = streams.named(setup.kind)
    if stream.IN_ARRAYS:
        known = known or measured(bag, setup)
        if not known:
            raise UserError(
                f'{bag.path}: {setup.topics[0].name} has no positions: name another topic with '
                '--measurement'
            )
        return PositionRecording(setup, dict(known))
    names = tuple(known or measured(bag, setup)) if stream.SEPARATE else ()
    topics = {topic.name for topic in setup.topics}
    return MessageRecording(
        str(bag.path),
        setup,
        tuple((list(topic_names), compact(block)) for topic_names, block in bag.blocks(topics)),
        names,
    )


def measured(bag: Bag, setup: Setup) -> dict[str, Series]:
    """Return the measured positions by joint, at the observer's times; {} without positions.

    Raises
    ------
    UserError : no message has the number that the setup names.
    """
    topic = setup.topics[0]
    if not setup.path:
        if topic.type != TYPE:
            return {}
        return positions(bag, topic.name, setup.values.get('stamp_source') == PUBLISHER)
    source: Any = setup.start()
    source = source.source
    if not isinstance(source, FieldSamples):
        return {}
    groups, count, malformed = [], 0, 0
    for _, block in bag.blocks([topic.name]):
        found, unread = source.samples(block)
        groups += [group for group in found if group.positions.shape[1]]
        count, malformed = count + len(block), malformed + len(unread)
    bag.count_malformed(topic.name, count, malformed)
    if not groups:  # never those of another topic or joint
        raise UserError(f'{bag.path}: {source.why_none(topic.name)}')
    for warning in source.warnings(topic.name):
        bag.warn(f'{bag.path}: {warning}')
    return {
        groups[0].names[0]: of_positions(
            np.concatenate([group.stamps_ns for group in groups]),
            np.concatenate([group.positions[:, 0] for group in groups]),
        )
    }


@dataclass(frozen=True)
class PositionRecording(Recording):
    """The positions of joints, and the parameters that are the same for all gains."""

    setup: Setup
    series: dict[str, Series]

    def run(
        self, observer: str, values: Mapping[str, Any], fast: bool | None = None
    ) -> dict[str, Estimate]:
        """See `Recording`."""
        stream: Any = streams.named(self.setup.kind).of(
            self.setup.having({**values, 'observer': observer}).values
        )
        found = {}
        for name, series in self.series.items():
            ran = stream.run(name, series.stamps_ns, series.position, fast)
            if ran is None:
                continue
            joint, out = ran
            used = out.used
            valid = used & np.isin(out.status, VALID)
            history = History()
            history.add(series.stamps_ns, out.status, out.verdict)
            found[name] = Estimate(
                series.stamps_ns[valid],
                out.position[valid],
                out.velocity[valid],
                out.velocity_stddev[valid],
                joint.samples(),
                history.seconds(),
                series.stamps_ns[used],
                out.status[used],
                series.stamps_ns[np.isfinite(series.position)],
            )
        return found

    def split(self, held_out: float) -> tuple[Recording, Recording]:
        """See `Recording`."""
        parts: tuple[dict[str, Series], ...] = ({}, {})
        for name, series in self.series.items():
            count = len(series.stamps_ns)
            cut = count - round(held_out * count)
            for part, rows in zip(parts, (slice(cut), slice(cut, None))):
                part[name] = Series(
                    series.stamps_ns[rows],
                    series.position[rows],
                    series.velocity[rows],
                    series.effort[rows],
                )
        return replace(self, series=parts[0]), replace(self, series=parts[1])

    def by_joint(self) -> Mapping[str | None, Recording]:
        """See `Recording`."""
        return {name: replace(self, series={name: series}) for name, series in self.series.items()}

    def size(self) -> int:
        """See `Recording`."""
        return sum(len(series.stamps_ns) for series in self.series.values())


@dataclass(frozen=True)
class MessageRecording(Recording):
    """The messages of a bag on the topics of a node.

    blocks : with the names of the bag's topics. names : joints that can have their own gains.
    fine : return an estimate of every sample of a batch, if the stream has them.
    """

    path: str
    setup: Setup
    blocks: tuple[tuple[list[str], Block], ...]
    names: tuple[str, ...] = ()
    fine: bool = field(default=False, kw_only=True)

    def run(
        self, observer: str, values: Mapping[str, Any], fast: bool | None = None
    ) -> dict[str, Estimate]:
        """See `Recording`."""
        stream = self.setup.having({**values, 'observer': observer}).start()
        collected = _Collected(stream, self.fine)
        for names, block in self.blocks:
            collected.add(answers(stream, names, block))
        stream.end(self.path)
        found = collected.estimates(stream)
        if not found:
            why = stream.why()
            raise UserError(
                f'{self.path}: {observer} publishes no estimate' + (f': {why}' if why else '')
            )
        return found

    def split(self, held_out: float) -> tuple[Recording, Recording]:
        """See `Recording`. Observers that learn run through the first part before the last."""
        left = self.size() - round(held_out * self.size())
        first = []
        for names, block in self.blocks:
            cut = min(left, len(block))
            left -= cut
            if cut:
                first.append((names, compact(block.take(slice(cut)))))
        return replace(self, blocks=tuple(first)), self

    def by_joint(self) -> Mapping[str | None, Recording]:
        """See `Recording`."""
        if not self.names:
            return {None: self}
        return {
            name: replace(self, names=(name,), setup=self.setup.having({'joints': [name]}))
            for name in self.names
        }

    def per_sample(self) -> Recording:
        """See `Recording`."""
        return replace(self, fine=True)

    def size(self) -> int:
        """Messages."""
        return sum(len(block) for _, block in self.blocks)


class _Collected:
    """Collects estimates from the messages that contain them."""

    def __init__(self, stream: Stream, fine: bool) -> None:
        self._first = 0
        self._fine = {
            number
            for number, output in enumerate(stream.outputs)
            if fine and output.type == drive_samples.TYPE
        }
        stream.wanted[:] = [
            number < 2 or number in self._fine for number in range(len(stream.outputs))
        ]
        self._batches: list[Batch] = []
        # by output: keys (number of the answer), stamps, and the messages' numbers by joint
        self._pieces: tuple[dict[str, list], ...] = ({}, {})
        self._due: list[NDArray[np.int64]] = []

    def add(self, made: Iterable[Answers]) -> None:
        """Add the answers to the next block."""
        last = 0
        for each in made:
            if len(each.rows):
                last = max(last, int(each.rows[-1]) + 1)
            if each.output in self._fine:
                self._batches += [drive_samples.decode(raw.tobytes()) for raw in each.raw]
            if each.output > 1:
                continue
            count, size = each.raw.shape
            keys = (each.rows + self._first) * 2**16 + np.broadcast_to(
                np.asarray(each.rank) // STRIDE, count
            )
            ends, none = np.arange(1, count + 1) * size, np.zeros(count, np.int64)
            groups, _ = decode_block(Block(none, none, none, each.raw.ravel(), ends - size, ends))
            for group in groups:
                if each.output == 0:
                    self._due.append(group.stamps_ns)
                for column, name in enumerate(group.names):
                    has = ~np.isnan(group.arrays[1][:, column])  # NaN: no estimate
                    self._pieces[each.output].setdefault(name, []).append(
                        (
                            keys[group.rows][has],
                            group.stamps_ns[has],
                            group.arrays[0][has, column],
                            group.arrays[1][has, column],
                        )
                    )
        self._first += last

    def estimates(self, stream: Stream) -> dict[str, Estimate]:
        """Return the estimates by joint."""
        due = np.unique(np.concatenate(self._due)) if self._due else np.zeros(0, np.int64)
        deviations = {name: _joined(pieces) for name, pieces in self._pieces[1].items()}
        owners = {joint: name for name in stream.bank.joints for joint in stream.names_of(name)}
        found = {}
        for name, pieces in self._pieces[0].items():
            keys, stamps, position, velocity = _joined(pieces)
            if not len(keys):
                continue
            stddev = np.full(len(stamps), np.nan)
            if name in deviations:
                known, _, _, of_velocity = deviations[name]
                stddev = at_stamps(keys, known, of_velocity)
            owner = owners.get(name, '')
            joint = stream.bank.joints.get(owner)
            history = (stream.history or {}).get(owner)
            status_stamps, status = (history or History()).noted()
            found[name] = Estimate(
                stamps,
                position,
                velocity,
                stddev,
                joint.samples()
                if joint
                else {'received': len(stamps), 'used': len(stamps), 'dropped': {}},
                dict(history.seconds()) if history else {},
                status_stamps,
                status,
                due,
            )
        if self._batches:
            name = next(iter(stream.names_of(next(iter(stream.bank.joints)))[1:]), '')
            if name in found:
                found[name] = _of_batches(self._batches, found[name])
        return found


def _of_batches(batches: list[Batch], one_each: Estimate) -> Estimate:
    """Return the estimates of every sample.

    Parameters
    ----------
    one_each : the last of every batch, the only ones with a published standard deviation.
    """
    stamps = np.concatenate([batch.stamps_ns for batch in batches])
    values = np.concatenate([batch.values for batch in batches])
    valid = values[:, 3] > 0.5
    return one_each._replace(
        stamps=stamps[valid],
        position=values[valid, 0],
        velocity=values[valid, 1],
        velocity_stddev=at_stamps(stamps[valid], one_each.stamps, one_each.velocity_stddev),
        due=np.unique(stamps),
    )


def _joined(pieces: list) -> tuple[NDArray, ...]:
    """Return the columns of all pieces in the order of their keys."""
    columns = [np.concatenate([piece[i] for piece in pieces]) for i in range(4)]
    order = np.argsort(columns[0], kind='stable')
    return tuple(column[order] for column in columns)
