"""The measurement in a bag as samples of joints, block by block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.block import Block
from estimator_pkg.bags.definitions import store_for
from estimator_pkg.bags.reader import Topic
from estimator_pkg.driver.raw_angle import RawAngle
from estimator_pkg.messages.joint_state_block import decode_block
from estimator_pkg.optional import Lazy

field = Lazy('estimator_pkg.bags.field')


class Samples(NamedTuple):
    """Messages that name the same joints.

    rows : shape (n,), which messages of the block these are, ascending.
    frame_id, names : of all of them.
    stamps_ns : shape (n,), int64.
    positions : shape (n, joints) [rad or m]; as many columns as the messages have numbers.
    """

    rows: NDArray[np.int64]
    frame_id: str
    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    positions: NDArray[np.float64]


class Source(Protocol):
    """What turns a block of the measurement's messages into samples."""

    def samples(self, block: Block) -> tuple[list[Samples], list[int]]:
        """The samples, and the rows that are no messages of the expected type."""


@dataclass(frozen=True)
class JointStates:
    """Samples from JointStates.

    by_publisher : time is when a message was published, not its header stamp.
    """

    by_publisher: bool = False

    def samples(self, block: Block) -> tuple[list[Samples], list[int]]:
        """See `Source`."""
        groups, malformed = decode_block(block)
        return [Samples(group.rows, group.frame_id, group.names,
                        block.publish_ns[group.rows] if self.by_publisher else group.stamps_ns,
                        group.arrays[0]) for group in groups], malformed


class AngleField:
    """Samples of one joint from a number in messages of any type.

    Parameters
    ----------
    topic : whose messages these are.
    path : see `estimator_pkg.bags.field`.
    joint : name of the joint.
    angle : how the number becomes an angle.

    Raises
    ------
    UsageError : the messages have no such number.
    """

    def __init__(self, topic: Topic, path: str, joint: str, angle: RawAngle) -> None:
        self._field = field.Field(store_for(topic.type, topic.definition), topic.type, path)
        self._names = (joint,)
        self._angle = angle
        self.is_integer = self._field.is_integer

    def samples(self, block: Block) -> tuple[list[Samples], list[int]]:
        """See `Source`; without a header, time is when a message was published."""
        groups, malformed = self._field.decode_block(block)
        found = []
        for group in groups:
            times = group.stamps_ns
            if times is None:
                times = block.publish_ns[group.rows]
            positions = (np.zeros((len(group.rows), 0)) if group.values is None
                         else self._angle.angle(group.values)[:, None])
            found.append(Samples(group.rows, group.frame_id, self._names, times, positions))
        return found, malformed
