"""Streams in chunks: how many samples each has, and messages that arrive later than their chunk."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from sim_pkg.contract import Message


def sample_count(duration: float, rate: float) -> float:
    """How many samples a run has, at least one; math.inf for one that goes on for ever."""
    return math.inf if math.isinf(duration) else max(1, math.ceil(duration * rate - 1e-6))


def sizes(duration: float, rate: float, chunk: int) -> Iterator[int]:
    """The samples of each chunk: `chunk`, fewer in the last one."""
    left = sample_count(duration, rate)
    while left > 0:
        size = int(min(chunk, left))
        left -= size
        yield size


def in_order(chunks: Iterable[tuple[list[Message], int]]) -> Iterator[list[Message]]:
    """The messages of all chunks in the order in which they are due.

    Parameters
    ----------
    chunks : (messages in any order, horizon [ns]) each: nothing of a later chunk is due before the
        horizon. Messages that are due together keep their order.
    """
    waiting: list[Message] = []  # held up past the end of their chunk
    for messages, horizon_ns in chunks:
        messages = sorted(waiting + messages, key=_due)
        ready = sum(message.due_ns < horizon_ns for message in messages)
        yield messages[:ready]
        waiting = messages[ready:]
    if waiting:
        yield waiting


def _due(message: Message) -> int:
    return message.due_ns
