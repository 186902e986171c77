# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Connect a stream to a bag: select stream, parameters and topics, and feed it the messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import params_file, streams
from estimator_pkg.bags.definitions import fields_of
from estimator_pkg.bags.reader import Bag, Topic
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.errors import UsageError, plainly
from estimator_pkg.messages.block import Block, compact, join
from estimator_pkg.messages.field import Field
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.streams.angle import ANGLE, ANGLE_TYPES, FIELD
from estimator_pkg.streams.contract import Answers, Request, Stream

DATA = 'data'  # the field of the number in std_msgs
STRIDE = 8  # ranks between two answers; larger than the number of outputs


@dataclass(frozen=True)
class Setup:
    """The settings of a replay; plain data, so it can be sent to another process.

    kind : kind of the stream's observers. values : parameters of the node. topics : its topics by
    port; None: not connected. path : of the number in the measurement's messages, for observers of
    one number in messages of any type.
    """

    kind: str
    values: Mapping[str, Any]
    ports: tuple[Topic | None, ...]
    path: str = ''

    @property
    def topics(self) -> tuple[Topic, ...]:
        """The topics of the stream, the measurement first."""
        return tuple(topic for topic in self.ports if topic is not None)

    @property
    def input(self) -> dict[str, Any]:
        """Return the parameters with which a node reads what the observer reads here."""
        if not self.path:
            return {name: value for name, value in self.values.items() if name == 'input'}
        kind = self.topics[0].type
        package, _, name = kind.rpartition('/')
        if package == 'std_msgs/msg' and name in ANGLE_TYPES:
            return {'input': ANGLE, 'angle_type': name}
        return {'input': FIELD, 'field_type': kind, 'field': self.path}

    @property
    def remaps(self) -> list[str]:
        """Return the node's topics that have another name in the bag, as FROM:=TO."""
        inputs = streams.named(self.kind).of(self.values).inputs
        return [
            f'{port.topic}:={topic.name}'
            for port, topic in zip(inputs, self.ports)
            if topic is not None and topic.name != port.in_bag
        ]

    def having(self, values: Mapping[str, Any]) -> Setup:
        """Return the same with these parameters in addition to its own."""
        return replace(self, values={**self.values, **values})

    def start(self) -> Stream:
        """Return the stream; raise UserError or UsageError for wrong parameters."""
        stream = streams.named(self.kind).of(self.values)
        stream.topics = [topic.name if topic else '' for topic in self.ports]
        stream.history = {}
        for number, (port, topic) in enumerate(zip(stream.inputs, self.ports)):
            path = port.field if number else self.path
            if not path:
                continue
            if topic is None:
                named = 'sources' in self.values
                remedy = "omit it in 'sources'" if named else "unset 'gyro_topic'"
                raise UsageError(f"'{port.topic}' is not in the bag: {remedy}")
            definition = fields_of(topic.type, topic.definition)
            stream.read_field(Field(definition, topic.type, path), number)
        return stream


def wired(stream: type[Stream], bag: Bag, values: Mapping[str, Any], request: Request) -> Setup:
    """Return the setup: parameters and topics, completed from the bag.

    Raises
    ------
    UserError, UsageError : a topic does not exist, or the request does not fit this family.
    """
    topic, _, path = (request.angle or '').partition(':')
    if request.angle is not None:
        if not topic or not path:
            raise UsageError(f"--angle '{request.angle}' is incomplete: write it as TOPIC:FIELD")
        if request.measurement:
            raise UsageError('--angle and --measurement are both given: omit one')
    values = stream.requested(dict(values), request, bag.has)
    inputs = stream.of(values).inputs
    named = topic or request.measurement
    if request.measurement and len([port for port in inputs if port.answered]) > 1:
        raise UsageError(
            '--measurement names one topic, but this observer needs several: omit it and provide '
            + ' and '.join(port.in_bag for port in inputs if port.answered)
        )
    first = inputs[0]
    if first.type == JOINT_STATE and not first.field:
        measurement = bag.topics[measurement_topic(bag, named)]
    else:
        any_type = first.any_number and not first.field
        measurement = bag.require(named or first.in_bag, () if any_type else [first.type])
        path = first.field or path or (DATA if any_type else '')
    others = [
        bag.require(port.in_bag, [port.type]) if not port.optional or bag.has(port.in_bag) else None
        for port in inputs[1:]
    ]
    return Setup(stream.KIND, values, (measurement, *others), path)


def parameters(
    stream: type[Stream],
    params: str | None,
    assignments: dict[str, Any],
    observer: str | None,
    node: str | None = None,
) -> dict[str, Any]:
    """Return the parameters of the stream's node by name: from file, --set and --observer.

    Raises
    ------
    UserError, UsageError : the file cannot be read, or has no section for the node.
    """
    observer = observer or assignments.get('observer')
    from_file = params_file.for_observer(params, node or stream.NODE, observer) if params else {}
    if params and from_file is None:
        params_file.warn_unused(params, [str(observer)])
    values = {**(from_file or {}), **assignments}
    if observer:
        values['observer'] = observer
    if not isinstance(values.get('observer', ''), str):
        raise UsageError(
            f"parameter 'observer' is {values['observer']!r}: it must be the name of an observer"
        )
    return params_file.of_this_node(values)


def answers(stream: Stream, names: Sequence[str], block: Block) -> list[Answers]:
    """Return the stream's answers to the messages of a block: those of a live node.

    A message of several ports goes to the last port first, so that a source on the topic of the
    angle is known before the angle.

    Parameters
    ----------
    names : the bag's topics, in the order of the block's topic numbers.

    Raises
    ------
    UserError : the observer failed (a user's own model or observer can).
    """
    ports = [[port for port, topic in enumerate(stream.topics) if topic == name] for name in names]
    rows = np.flatnonzero(np.array([bool(each) for each in ports])[block.topic])
    heard = block if len(rows) == len(block) else block.take(rows)
    with plainly('the observer'):
        found = stream.feed_block([each[0] if each else -1 for each in ports], heard)
        if found is None:
            found = _one_by_one(stream, ports, heard)
    return [each._replace(rows=rows[each.rows]) for each in found]


def _one_by_one(stream: Stream, ports: Sequence[Sequence[int]], block: Block) -> list[Answers]:
    made: dict[tuple[int, int], list[tuple[int, int, bytes]]] = {}  # by output and size
    times = block.publish_ns.tolist()
    for row, topic in enumerate(block.topic.tolist()):
        raw = block.data[block.start[row] : block.end[row]].tobytes()
        fed = [stream.feed(port, raw, times[row]) for port in reversed(ports[topic])]
        for number, answer in enumerate(chain.from_iterable(fed)):
            for output, message in answer.items():
                made.setdefault((output, len(message)), []).append(
                    (row, STRIDE * number + output + 1, message)
                )
    found = []
    for (output, size), each in made.items():
        rows, ranks, raws = zip(*each)
        data = np.frombuffer(b''.join(raws), np.uint8).reshape(len(rows), size)
        found.append(Answers(output, np.array(rows), np.array(ranks), data))
    return found


def in_order(
    block: Block, topic: NDArray[np.int64], answered: Iterable[tuple[int, Answers]]
) -> Block:
    """Return messages of a block and the answers to it, each answer behind its message.

    An answer has the log time of its message, and is published then.

    Parameters
    ----------
    topic : shape (n,), new topic of each message of the block; -1: the message is left out.
    answered : new topic of the answers, and answers.
    """
    kept = np.flatnonzero(topic >= 0)
    parts, rows = [compact(replace(block.take(kept), topic=topic[kept]))], [kept]
    ranks: list[NDArray[np.int64]] = [np.zeros(len(kept), np.int64)]
    for number, each in answered:
        count, size = each.raw.shape
        start, log_ns = size * np.arange(count), block.log_ns[each.rows]
        parts.append(
            Block(np.full(count, number), log_ns, log_ns, each.raw.ravel(), start, start + size)
        )
        rows.append(each.rows)
        ranks.append(np.broadcast_to(np.asarray(each.rank), count))
    return join(parts).take(np.lexsort((np.concatenate(ranks), np.concatenate(rows))))
