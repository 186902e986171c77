# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Split a stream into chunks, make its messages, merge those that arrive later than their chunk.

Most simulators publish joints: measured ones, and their truth.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter

from estimator_pkg.messages.joint_state import TYPE, Encoder
from sim_pkg.contract import Message, Topic
from sim_pkg.joints.sensor import Samples

MEASURED = Topic('joint_states', TYPE)
TRUTH = Topic('ground_truth/joint_states', TYPE, truth=True)


def sample_count(duration: float, rate: float) -> float:
    """Return the number of samples of a run, at least 1; math.inf for an endless run."""
    return math.inf if math.isinf(duration) else max(1, math.ceil(duration * rate - 1e-6))


def sizes(duration: float, rate: float, chunk: int) -> Iterator[int]:
    """Yield the number of samples of each chunk: `chunk`, fewer in the last one."""
    left = sample_count(duration, rate)
    while left > 0:
        size = int(min(chunk, left))
        left -= size
        yield size


def in_order(chunks: Iterable[tuple[list[Message], int]]) -> Iterator[list[Message]]:
    """Yield the messages of all chunks, sorted by the time at which they are due.

    Parameters
    ----------
    chunks : (messages in any order, horizon [ns]) each: no message of a later chunk is due before
        the horizon. Messages that are due at the same time keep their order.
    """
    waiting: list[Message] = []  # due after the end of their chunk
    for messages, horizon_ns in chunks:
        messages = sorted(waiting + messages, key=attrgetter('due_ns'))
        ready = sum(message.due_ns < horizon_ns for message in messages)
        yield messages[:ready]
        waiting = messages[ready:]
    if waiting:
        yield waiting


class JointStates:
    """Makes the messages of a topic of JointStates.

    Parameters
    ----------
    names : of the joints.
    """

    def __init__(self, topic: Topic, names: Sequence[str]) -> None:
        self._topic, self._names, self._encoder = topic.name, names, Encoder()

    def message(
        self,
        due_ns: int,
        stamp_ns: int,
        positions: Sequence[float],
        velocities: Sequence[float] = (),
        efforts: Sequence[float] = (),
    ) -> Message:
        """Return a message that is due and stamped at these times [ns from the start]."""
        content = self._names, positions, velocities, efforts

        def encode(start_ns: int) -> bytes:
            return self._encoder.encode(start_ns + stamp_ns, '', *content)

        return Message(due_ns, self._topic, encode)


def told(
    measured: JointStates,
    true: JointStates,
    samples: Samples,
    readings: Sequence[Sequence[float]],
    efforts: Sequence[Sequence[float]],
    motions: Iterable[tuple[Sequence[float], Sequence[float]]],
) -> Iterator[Message]:
    """Yield measurement, if it arrives, and truth of each sample of a chunk.

    Parameters
    ----------
    readings, efforts : of all joints, for each sample.
    motions : positions and velocities of all joints at the stamps.
    """
    rows = zip(samples.rows(), readings, efforts, motions)
    for (taken, stamp, due, copies), reading, effort, (position, velocity) in rows:
        yield from [measured.message(due, stamp, reading, (), effort)] * copies
        yield true.message(taken, stamp, position, velocity)
