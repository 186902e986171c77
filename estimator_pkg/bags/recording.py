# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The input of observers from a bag, read once and run with one set of gains after another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import streams
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.series import (
    Series,
    at_stamps,
    of_positions,
    positions,
    series_of,
    why_none,
)
from estimator_pkg.bags.wiring import Setup, answers, in_order
from estimator_pkg.errors import UserError
from estimator_pkg.estimate import VALID
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.block import Block, compact
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.streams.angle import REGULAR
from estimator_pkg.streams.contract import PUBLISHER, Stream
from estimator_pkg.streams.history import History
from estimator_pkg.streams.sources import FieldSamples


class EstimateSeries(NamedTuple):
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


@dataclass(frozen=True)
class Recording:
    """The input of one family's observers from a bag; it can be sent to another process.

    path : of the bag. setup : settings and topics.
    series : positions by joint, of a family that runs in arrays.
    blocks : of other families, messages on the node's topics, with the names of the bag's topics.
    names : joints that can have their own gains.
    fine : return an estimate of every sample of a batch, if the stream has them.
    """

    path: str
    setup: Setup
    series: Mapping[str, Series] = field(default_factory=dict)
    blocks: tuple[tuple[list[str], Block], ...] | None = None
    names: tuple[str, ...] = ()
    fine: bool = False

    def run(self, observer: str, values: Mapping[str, Any]) -> dict[str, EstimateSeries]:
        """Return the estimates that this observer publishes with these parameters, by joint.

        Raises
        ------
        UserError, UsageError : a parameter is wrong, or the bag lacks an input of the observer.
        """
        setup = self.setup.having({**values, 'observer': observer})
        if self.blocks is None:
            return self._of_series(streams.named(setup.kind).of(setup.values))
        found = self._of_messages(stream := setup.start(), self.blocks)
        if not found:
            why = stream.why()
            raise UserError(
                f'{self.path}: {observer} publishes no estimate' + (f': {why}' if why else '')
            )
        return found

    def _of_series(self, stream: Any) -> dict[str, EstimateSeries]:
        found = {}
        for name, series in self.series.items():
            ran = stream.run(name, series.stamps_ns, series.position)
            if ran is None:
                continue
            joint, out = ran
            used = out.used
            valid = used & np.isin(out.status, VALID)
            history = History()
            history.add(series.stamps_ns, out.status, out.verdict)
            found[name] = EstimateSeries(
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

    def _of_messages(
        self, stream: Stream, blocks: Sequence[tuple[list[str], Block]]
    ) -> dict[str, EstimateSeries]:
        of_samples = [self.fine and each.type == drive_samples.TYPE for each in stream.outputs]
        stream.wanted[:] = [number < 2 or wanted for number, wanted in enumerate(of_samples)]
        answered = []
        for names, block in blocks:
            made = [(each.output, each) for each in answers(stream, names, block)]
            answered.append(in_order(block, np.full(len(block), -1), made))
        stream.end(self.path)
        found = _estimates(stream, _on(answered, 0), _on(answered, 1))
        if found and any(of_samples):
            motor = next(iter(stream.bank.joints))
            name = next(iter(stream.names_of(motor)[1:]), '')
            if name in found:
                batches = _on(answered, of_samples.index(True))
                found[name] = _of_every_sample(batches, found[name])
        return found

    def split(self, held_out: float) -> tuple[Recording, Recording]:
        """Return the recording without its last part, and one for the estimates of the last part.

        Of messages the latter is the whole: observers that learn run through the first part.
        """
        if self.blocks is not None:
            left = self.size() - round(held_out * self.size())
            rows = []
            for _, block in self.blocks:
                rows.append(slice(max(left, 0)))
                left -= len(block)
            return self._part(self.blocks, rows), self
        first, rest = {}, {}
        for name, series in self.series.items():
            cut = len(series.stamps_ns) - round(held_out * len(series.stamps_ns))
            first[name], rest[name] = series.take(slice(cut)), series.take(slice(cut, None))
        return replace(self, series=first), replace(self, series=rest)

    def between(self, begin: float, end: float) -> Recording:
        """Return the part from `begin` to `end` [s] since the first sample.

        The times are those of the stamps, or of the recorder for messages.
        """
        if not begin and end == np.inf:
            return self
        if self.blocks is not None:
            start = int(self.blocks[0][1].log_ns[0]) if self.blocks else 0
            times = [(block.log_ns - start) * 1e-9 for _, block in self.blocks]
            return self._part(self.blocks, [(time >= begin) & (time <= end) for time in times])
        good = [each.stamps_ns[each.stamps_ns > 0] for each in self.series.values()]
        start = min((int(each[0]) for each in good if len(each)), default=0)
        last = start + round(1e9 * end) if end < np.inf else 2**62
        return self.of_stamps(start + round(1e9 * begin), last)

    def of_stamps(self, first: int, last: int) -> Recording:
        """Return the part of series with first <= stamp <= last [ns]; messages stay whole."""
        if first <= 0:
            return self
        series = {
            name: each.take((each.stamps_ns >= first) & (each.stamps_ns <= last))
            for name, each in self.series.items()
        }
        return replace(self, series=series)

    def by_joint(self) -> Mapping[str | None, Recording]:
        """Return the recordings that can have their own gains, by joint; {None: self} for one."""
        if self.blocks is None:
            return {name: replace(self, series={name: each}) for name, each in self.series.items()}
        if not self.names:
            return {None: self}
        return {
            name: replace(self, names=(name,), setup=self.setup.having({'joints': [name]}))
            for name in self.names
        }

    def per_sample(self) -> Recording:
        """Return the same with an estimate of every sample, if messages contain many samples."""
        return replace(self, fine=True)

    def size(self) -> int:
        """Return the number of samples, or of messages."""
        if self.blocks is not None:
            return sum(len(block) for _, block in self.blocks)
        return sum(len(series.stamps_ns) for series in self.series.values())

    def _part(
        self, blocks: Sequence[tuple[list[str], Block]], rows: Sequence[NDArray[np.bool_] | slice]
    ) -> Recording:
        parts = [(names, block.take(each)) for (names, block), each in zip(blocks, rows)]
        kept = tuple((names, compact(block)) for names, block in parts if len(block))
        return replace(self, blocks=kept)


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
    whole_messages = setup.values.get('sources') or setup.values.get('stamp_repair') == REGULAR
    if stream.IN_ARRAYS and not whole_messages:
        known = known or measured(bag, setup)
        if not known:
            raise UserError(
                f'{bag.path}: {why_none(bag, setup.topics[0].name)}: name another topic with '
                '--measurement'
            )
        return Recording(str(bag.path), setup, dict(known))
    names = tuple(known or measured(bag, setup)) if stream.SEPARATE else ()
    topics = {topic.name for topic in setup.topics}
    blocks = tuple((list(named), compact(block)) for named, block in bag.blocks(topics))
    return Recording(str(bag.path), setup, blocks=blocks, names=names)


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


def _on(blocks: list[Block], output: int) -> list[Block]:
    return [block.take(block.topic == output) for block in blocks]


def _estimates(
    stream: Stream, published: list[Block], deviations: list[Block]
) -> dict[str, EstimateSeries]:
    """Return the estimates by joint, from the messages of the first two outputs of a stream."""
    every, deviation_of = series_of(published)[0], series_of(deviations)[0]
    due = np.unique(
        np.concatenate([np.zeros(0, np.int64), *(one.stamps_ns for one in every.values())])
    )
    owners = {joint: name for name in stream.bank.joints for joint in stream.names_of(name)}
    found = {}
    for name, series in every.items():
        has = ~np.isnan(series.velocity)  # NaN: no estimate
        count = int(has.sum())
        if not count:
            continue
        stddev = np.full(count, np.nan)
        deviation = deviation_of.get(name)
        if deviation is not None and len(deviation.stamps_ns) == len(has):  # the same messages
            stddev = deviation.velocity[has]
        owner = owners.get(name, '')
        joint = stream.bank.joints.get(owner)
        history = (stream.history or {}).get(owner) or History()
        samples = {'received': count, 'used': count, 'dropped': {}}
        found[name] = EstimateSeries(
            series.stamps_ns[has],
            series.position[has],
            series.velocity[has],
            stddev,
            joint.samples() if joint else samples,
            dict(history.seconds()),
            *history.noted(),
            due,
        )
    return found


def _of_every_sample(blocks: list[Block], one_each: EstimateSeries) -> EstimateSeries:
    """Return the estimates in batches of samples.

    Parameters
    ----------
    one_each : the last of every batch, the only ones with a published standard deviation.
    """
    batches = [
        drive_samples.decode(block.data[start:end].tobytes())
        for block in blocks
        for start, end in zip(block.start.tolist(), block.end.tolist())
    ]
    if not batches:
        return one_each
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
