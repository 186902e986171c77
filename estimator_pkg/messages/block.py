# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Many messages of a bag in one buffer, with the position of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Block:
    """Messages in log order.

    Attributes
    ----------
    topic : shape (n,), the topic of each message (an index of the bag).
    log_ns, publish_ns : shape (n,), int64 nanoseconds.
    data : the buffer, shape (size,), uint8.
    start, end : shape (n,), first byte of each message in `data`, and the byte after its last.
    """

    topic: NDArray[np.int64]
    log_ns: NDArray[np.int64]
    publish_ns: NDArray[np.int64]
    data: NDArray[np.uint8]
    start: NDArray[np.int64]
    end: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.topic)

    def take(self, rows: NDArray[Any] | slice) -> Block:
        """Return the messages of these rows, shape (k,), in the same buffer."""
        return Block(
            self.topic[rows],
            self.log_ns[rows],
            self.publish_ns[rows],
            self.data,
            self.start[rows],
            self.end[rows],
        )

    def in_log_order(self) -> Block:
        """Return the messages sorted by log time; equal times keep their order."""
        if np.all(self.log_ns[1:] >= self.log_ns[:-1]):
            return self
        return self.take(np.argsort(self.log_ns, kind='stable'))


def join(blocks: Sequence[Block]) -> Block:
    """Return the messages of several blocks one after the other, in a new buffer."""
    data = np.concatenate([block.data for block in blocks])
    shifts = np.cumsum([0] + [len(block.data) for block in blocks[:-1]])
    return Block(
        np.concatenate([block.topic for block in blocks]),
        np.concatenate([block.log_ns for block in blocks]),
        np.concatenate([block.publish_ns for block in blocks]),
        data,
        np.concatenate([block.start + shift for block, shift in zip(blocks, shifts)]),
        np.concatenate([block.end + shift for block, shift in zip(blocks, shifts)]),
    )


def compact(block: Block) -> Block:
    """Return the same messages in a buffer without unused bytes at both ends."""
    if not len(block):
        return replace(block, data=np.zeros(0, np.uint8))
    low, high = int(block.start.min()), int(block.end.max())
    return replace(block, data=block.data[low:high], start=block.start - low, end=block.end - low)


def from_messages(
    topic: ArrayLike, log_ns: ArrayLike, publish_ns: ArrayLike, raws: Sequence[bytes | memoryview]
) -> Block:
    """Return a block of single messages.

    Parameters
    ----------
    topic, log_ns, publish_ns : shape (n,). raws : n messages.
    """
    end = np.cumsum([len(raw) for raw in raws], dtype=np.int64)
    start = np.concatenate([np.zeros(1, np.int64), end[:-1]]) if len(raws) else end
    return Block(
        np.asarray(topic, np.int64),
        np.asarray(log_ns, np.int64),
        np.asarray(publish_ns, np.int64),
        np.frombuffer(raws[0] if len(raws) == 1 else b''.join(raws), np.uint8),
        start,
        end,
    )


def rows(data: NDArray[np.uint8], start: NDArray[np.int64], length: int) -> NDArray[np.uint8]:
    """Return `length` bytes from each `start`, shape (n, length); a copy."""
    if not len(start):
        return np.zeros((0, length), np.uint8)
    return np.lib.stride_tricks.sliding_window_view(data, length)[start]
