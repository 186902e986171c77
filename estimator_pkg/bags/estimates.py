"""Estimates as the messages that a live node would have published."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.block import Block
from estimator_pkg.bags.estimation import Estimated
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.messages.joint_state_block import encode_block


class Encoded:
    """Gathers the messages that go with a block of measurements.

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

    def add(self, topic: int, rank: NDArray[np.int64] | int, rows: NDArray[np.int64],
            raw: NDArray[np.uint8]) -> None:
        """Messages on a topic, each recorded when the measurement of its row was.

        Parameters
        ----------
        rank : order among messages of the same measurement, of all or of each.
        raw : shape (n, bytes of one message).
        """
        self._rows.append(rows)
        self._topics.append(np.full(len(rows), topic))
        self._ranks.append(np.full(len(rows), rank))
        self._raws.append(raw)

    def merged(self, topic: NDArray[np.int64]) -> Block:
        """These messages right behind their measurements, among those copied from the block.

        Parameters
        ----------
        topic : shape (n,), the new bag's topic for each message of the block; -1: not copied.
        """
        block = self._block
        copied = np.flatnonzero(topic >= 0)
        rows = np.concatenate([copied, *self._rows])
        rank = np.concatenate([np.zeros(len(copied), np.int64), *self._ranks])
        sizes = np.concatenate([np.full(len(raw), raw.shape[1]) for raw in self._raws]
                               or [np.zeros(0, np.int64)])
        ends = len(block.data) + np.cumsum(sizes)
        order = np.lexsort((rank, rows))
        times = block.publish_ns[rows]
        times[len(copied):] = block.log_ns[rows[len(copied):]]
        return Block(np.concatenate([topic[copied], *self._topics]), block.log_ns[rows], times,
                     np.concatenate([block.data, *(raw.ravel() for raw in self._raws)]),
                     np.concatenate([block.start[copied], ends - sizes]),
                     np.concatenate([block.end[copied], ends])).take(order)


def messages(estimated: Estimated, encoder: Encoder, *, stddev: bool
             ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.uint8]]]:
    """(rows, bytes) of the JointStates for one group, by which joints are valid.

    Parameters
    ----------
    stddev : standard deviations instead of position and velocity.
    """
    samples = estimated.samples
    first, second = ((estimated.position_stddev, estimated.velocity_stddev) if stddev else
                     (estimated.position, estimated.velocity))
    for mine, joints in _patterns(estimated.valid):
        names = [name for name, shown in zip(samples.names, joints) if shown]
        yield samples.rows[mine], encode_block(
            encoder, samples.stamps_ns[mine], samples.frame_id, names,
            first[mine][:, joints], second[mine][:, joints])


def _patterns(valid: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.bool_] | slice,
                                                          NDArray[np.bool_]]]:
    """(rows, joints) of every set of joints that are valid together."""
    if valid.all():
        if len(valid):
            yield slice(None), np.ones(valid.shape[1], bool)
        return
    kinds, which = np.unique(valid, axis=0, return_inverse=True)
    for index, joints in enumerate(kinds):
        yield which.ravel() == index, joints
