# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Feed a bag's messages through a stream; its answers are those of a live node."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import plainly
from estimator_pkg.messages.block import Block
from estimator_pkg.streams.contract import Answers, Stream

STRIDE = 8  # ranks between two answers; larger than the number of outputs


def answers(stream: Stream, names: Sequence[str], block: Block) -> list[Answers]:
    """Return the answers to a block of messages on the stream's topics.

    Parameters
    ----------
    names : the bag's topics, in the order of the block's topic numbers.

    Raises
    ------
    UserError : the observer failed (a user's own model or observer can).
    """
    port_of = {name: port for port, name in enumerate(stream.topics)}
    ports = [port_of.get(name, -1) for name in names]
    with plainly('the observer'):
        found = stream.feed_block(ports, block)
        return _one_by_one(stream, ports, block) if found is None else list(found)


def _one_by_one(stream: Stream, ports: Sequence[int], block: Block) -> list[Answers]:
    made: dict[tuple[int, int], tuple[list[int], list[int], list[bytes]]] = {}
    of_message = [ports[topic] for topic in block.topic.tolist()]
    times = block.publish_ns.tolist()
    for row in range(len(block)):
        raw = block.data[block.start[row] : block.end[row]].tobytes()
        for number, answer in enumerate(stream.feed(of_message[row], raw, times[row])):
            for output, message in answer.items():
                rows, ranks, raws = made.setdefault((output, len(message)), ([], [], []))
                rows.append(row)
                ranks.append(STRIDE * number + output + 1)
                raws.append(message)
    return [
        Answers(
            output,
            np.array(rows),
            np.array(ranks),
            np.frombuffer(b''.join(raws), np.uint8).reshape(len(rows), size),
        )
        for (output, size), (rows, ranks, raws) in made.items()
    ]


class Encoded:
    """Collects the messages that belong to a block of measurements.

    Parameters
    ----------
    block : the measurements.
    """

    def __init__(self, block: Block) -> None:
        self._block = block
        self._rows: list[NDArray[np.int64]] = []
        self._topics: list[NDArray[np.int64]] = []
        self._ranks: list[NDArray[np.int64]] = []
        self._raws: list[NDArray[np.uint8]] = []

    def add(
        self,
        topic: int,
        rank: NDArray[np.int64] | int,
        rows: NDArray[np.int64],
        raw: NDArray[np.uint8],
    ) -> None:
        """Add messages on a topic, each with the log time of the measurement in its row.

        Parameters
        ----------
        rank : order among the messages of one measurement; one number, or one per message.
        raw : shape (n, bytes of one message).
        """
        self._rows.append(rows)
        self._topics.append(np.full(len(rows), topic))
        self._ranks.append(np.full(len(rows), rank))
        self._raws.append(raw)

    def merged(self, topic: NDArray[np.int64]) -> Block:
        """Return these messages, each after its measurement, and the copied ones of the block.

        Parameters
        ----------
        topic : shape (n,), number in the new bag for each message of the block; -1: not copied.
        """
        block = self._block
        copied = np.flatnonzero(topic >= 0)
        rows = np.concatenate([copied, *self._rows])
        rank = np.concatenate([np.zeros(len(copied), np.int64), *self._ranks])
        sizes = np.concatenate(
            [np.full(len(raw), raw.shape[1]) for raw in self._raws] or [np.zeros(0, np.int64)]
        )
        ends = len(block.data) + np.cumsum(sizes)
        order = np.lexsort((rank, rows))
        times = block.publish_ns[rows]
        times[len(copied) :] = block.log_ns[rows[len(copied) :]]
        return Block(
            np.concatenate([topic[copied], *self._topics]),
            block.log_ns[rows],
            times,
            np.concatenate([block.data, *(raw.ravel() for raw in self._raws)]),
            np.concatenate([block.start[copied], ends - sizes]),
            np.concatenate([block.end[copied], ends]),
        ).take(order)
