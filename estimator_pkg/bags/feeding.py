# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Feed a bag's messages through a stream; its answers are those of a live node."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import plainly
from estimator_pkg.messages.block import Block
from estimator_pkg.streams.contract import Answers, Stream

STRIDE = 8  # ranks between two answers; larger than the number of outputs


def answers(stream: Stream, names: Sequence[str], block: Block) -> list[Answers]:
    """Return the answers to the messages of a block that are on the stream's topics.

    Parameters
    ----------
    names : the bag's topics, in the order of the block's topic numbers.

    Raises
    ------
    UserError : the observer failed (a user's own model or observer can).
    """
    every = [[port for port, topic in enumerate(stream.topics) if topic == name] for name in names]
    listened = np.array([bool(ports) for ports in every])[block.topic]
    if not listened.all():
        rows = np.flatnonzero(listened)
        made = answers(stream, names, block.take(rows))
        return [each._replace(rows=rows[each.rows]) for each in made]
    with plainly('the observer'):
        found = stream.feed_block([ports[0] if ports else -1 for ports in every], block)
        return _one_by_one(stream, every, block) if found is None else list(found)


def _one_by_one(stream: Stream, ports: Sequence[Sequence[int]], block: Block) -> list[Answers]:
    """Return the answers; a message of several ports goes to the last port first.

    So a source on the topic of the angle is known before the angle.
    """
    made: dict[tuple[int, int], tuple[list[int], list[int], list[bytes]]] = {}
    of_message = [ports[topic] for topic in block.topic.tolist()]
    times = block.publish_ns.tolist()
    for row in range(len(block)):
        raw = block.data[block.start[row] : block.end[row]].tobytes()
        fed = [stream.feed(port, raw, times[row]) for port in reversed(of_message[row])]
        for number, answer in enumerate(chain.from_iterable(fed)):
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
    data = [block.data] if len(kept) else []
    topics, rows, ranks = [topic[kept]], [kept], [np.zeros(len(kept), np.int64)]
    sizes = [np.zeros(0, np.int64)]
    for number, each in answered:
        count, size = each.raw.shape
        topics.append(np.full(count, number))
        rows.append(each.rows)
        ranks.append(np.broadcast_to(np.asarray(each.rank), count))
        sizes.append(np.full(count, size))
        data.append(each.raw.ravel())
    row, size = np.concatenate(rows), np.concatenate(sizes)
    ends = sum(map(len, data)) - size.sum() + np.cumsum(size)
    published = block.publish_ns[row]
    published[len(kept) :] = block.log_ns[row[len(kept) :]]
    return Block(
        np.concatenate(topics),
        block.log_ns[row],
        published,
        np.concatenate(data) if data else block.data[:0],
        np.concatenate([block.start[kept], ends - size]),
        np.concatenate([block.end[kept], ends]),
    ).take(np.lexsort((np.concatenate(ranks), row)))
