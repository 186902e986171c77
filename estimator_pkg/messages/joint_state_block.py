# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Many JointStates at once: decoded into arrays, encoded from a template.

Messages that share names and array lengths (see `joint_state.Layout`) become one group.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.messages.block import Block
from estimator_pkg.messages.joint_state import Encoder, Layout
from estimator_pkg.messages.layouts import groups, numbers, put, put_stamps, stamps


class Decoded(NamedTuple):
    """Messages of one layout.

    rows : shape (n,), indices of these messages in the block, ascending.
    frame_id, names : the same for all of them.
    stamps_ns : shape (n,), int64.
    arrays : positions, velocities and efforts, each of shape (n, its length).
    """

    rows: NDArray[np.int64]
    frame_id: str
    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    arrays: tuple[NDArray[np.float64], ...]


def decode_block(
    block: Block, make: Callable[[bytes], Layout] = Layout
) -> tuple[list[Decoded], list[int]]:
    """Decode a block of JointStates; return its groups and the malformed rows.

    Every row is in exactly one group or is malformed.

    Parameters
    ----------
    make : returns the layout of a message, see `groups`; that of a `Decoder` keeps it for the next
        block.
    """
    malformed: list[int] = []
    decoded = []
    for group in groups(block, make, malformed):
        rows, data, layout = group.rows, group.data, group.layout
        arrays = tuple(
            numbers(data, at, count, f'{layout.order}f8').astype(np.float64, copy=False)
            for at, count in layout.arrays
        )
        decoded.append(
            Decoded(rows, layout.frame_id, layout.names, stamps(data, 4, layout.order), arrays)
        )
    return decoded, malformed


def encode_block(
    encoder: Encoder,
    stamps_ns: NDArray[np.int64],
    frame_id: str,
    names: Sequence[str],
    *arrays: NDArray[np.float64],
) -> NDArray[np.uint8]:
    """Encode JointStates with these names, shape (n, bytes of one message); efforts empty.

    Parameters
    ----------
    stamps_ns : shape (n,).
    arrays : positions, velocities and efforts, each of shape (n, its length); those left out are
        empty.
    """
    zeros = [[0.0] * array.shape[1] for array in arrays]
    template = encoder.encode(0, frame_id, names, *zeros)
    out = np.empty((len(stamps_ns), len(template)), np.uint8)
    out[:] = np.frombuffer(template, np.uint8)
    put_stamps(out, 4, stamps_ns)
    for (at, count), array in zip(Layout(template).arrays, arrays):
        if count:
            put(out, at, np.ascontiguousarray(array, '<f8'))
    return out
