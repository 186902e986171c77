# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A topic of JointStates as one time series per joint."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import Bag
from estimator_pkg.circle import LARGEST
from estimator_pkg.errors import UserError
from estimator_pkg.messages.block import Block
from estimator_pkg.messages.joint_state import TYPE, Decoder
from estimator_pkg.messages.joint_state_block import decode_block


class Series(NamedTuple):
    """One joint's values in the order of the bag; nan where a message has none.

    stamps_ns : shape (n,), int64: header stamps, or times of publishing.
    position, velocity, effort : shape (n,) [rad or m, per second, N m or N].
    """

    stamps_ns: NDArray[np.int64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]

    def take(self, rows: NDArray[Any] | slice) -> Series:
        """Return these rows."""
        return Series._make(values[rows] for values in self)


def joint_series(bag: Bag, topic: str, by_publisher: bool = False) -> dict[str, Series]:
    """Return the joints of a topic of JointStates, by name, in the order of their appearance.

    An array whose length differs from that of `name` counts as missing.

    Parameters
    ----------
    by_publisher : use the times of publishing, not the header stamps.

    Raises
    ------
    UserError : the topic does not exist, has another type, or names no joint; or none of its
        messages can be decoded.
    """
    bag.require(topic, [TYPE])
    found, count, malformed = series_of((block for _, block in bag.blocks([topic])), by_publisher)
    bag.count_malformed(topic, count, malformed)
    if not found:
        why = 'names a joint' if count else 'can be read'
        raise UserError(f"no message on topic '{topic}' of {bag.path} {why}")
    return found


def series_of(
    blocks: Iterable[Block], by_publisher: bool = False
) -> tuple[dict[str, Series], int, int]:
    """Return the joints in blocks of JointStates, the number of messages and of malformed ones."""
    pieces: dict[str, list[tuple[NDArray[Any], ...]]] = {}  # rows, and the columns of `Series`
    layout_of = Decoder().layout
    count = malformed = 0
    for block in blocks:
        groups, unread = decode_block(block, layout_of)
        malformed += len(unread)
        for group in groups:
            stamps = block.publish_ns[group.rows] if by_publisher else group.stamps_ns
            missing = np.full(len(stamps), np.nan)
            whole = [array.shape[1] == len(group.names) for array in group.arrays]
            for place, name in enumerate(group.names):
                columns = (
                    array[:, place] if there else missing
                    for array, there in zip(group.arrays, whole)
                )
                pieces.setdefault(name, []).append((group.rows + count, stamps, *columns))
        count += len(block)
    found = {}
    for name, each in pieces.items():
        rows, *values = map(np.concatenate, zip(*each))
        order = np.argsort(rows, kind='stable')
        found[name] = Series._make(value[order] for value in values)
    return found, count, malformed


def positions(bag: Bag, topic: str, by_publisher: bool = False) -> dict[str, Series]:
    """Return the positions of the measured joints, without velocities and efforts.

    Raises
    ------
    UserError : as `joint_series`.
    """
    found = {
        joint: of_positions(series.stamps_ns, series.position)
        for joint, series in joint_series(bag, topic, by_publisher).items()
    }
    return {joint: series for joint, series in found.items() if np.isfinite(series.position).any()}


def why_none(bag: Bag, topic: str) -> str:
    """Return why a topic of JointStates shows no angle."""
    found = joint_series(bag, topic).values() if bag.topics[topic].type == TYPE else ()
    if any(np.isfinite(series.velocity).any() for series in found):
        return f'{topic} has velocities but no positions, and observers need positions'
    if found:
        return f'{topic} has no readable joint: no position is finite'
    return f'{topic} has no positions'


def of_positions(stamps_ns: NDArray[np.int64], position: NDArray[np.float64]) -> Series:
    """Return a series of positions, shape (n,); those outside the observers' range become nan."""
    nothing = np.broadcast_to(np.nan, len(stamps_ns))
    return Series(
        stamps_ns, np.where(np.abs(position) < LARGEST, position, np.nan), nothing, nothing
    )


def with_velocity(series: Series) -> Series:
    """Return the rows that have a velocity: NaN means that there was no estimate."""
    return series.take(~np.isnan(series.velocity))


def at_stamps(
    stamps: NDArray[np.int64], known: NDArray[np.int64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the values at the same stamps, nan elsewhere.

    Parameters
    ----------
    stamps : shape (n,), requested stamps [ns]. known, values : shape (k,), in any order.
    """
    found = np.full(len(stamps), np.nan)
    if len(known):
        order = np.argsort(known, kind='stable')
        at = np.minimum(np.searchsorted(known[order], stamps), len(known) - 1)
        same = known[order[at]] == stamps
        found[same] = values[order[at[same]]]
    return found
