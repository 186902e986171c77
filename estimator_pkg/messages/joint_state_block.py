"""Many JointStates at once: decoded into arrays, encoded from a template.

Messages that share names and array lengths (see `joint_state.Layout`) become one group.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Encoder, Layout

MANY_LAYOUTS = 16  # from so many layouts in one block on, messages are taken one by one


class Messages(Protocol):
    """Messages in a buffer, as `estimator_pkg.bags.block.Block` has them."""

    @property
    def data(self) -> NDArray[np.uint8]: ...  # noqa: D102  (described there)

    @property
    def start(self) -> NDArray[np.int64]: ...  # noqa: D102

    @property
    def end(self) -> NDArray[np.int64]: ...  # noqa: D102


class Decoded(NamedTuple):
    """Messages of one layout.

    rows : shape (n,), which messages of the block these are, ascending.
    frame_id, names : of all of them.
    stamps_ns : shape (n,), int64.
    arrays : positions, velocities and efforts, each of shape (n, its length).
    """

    rows: NDArray[np.int64]
    frame_id: str
    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    arrays: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def decode_block(block: Messages) -> tuple[list[Decoded], NDArray[np.int64]]:
    """The groups of a block of JointStates, and the rows that are none.

    Every row is in exactly one group or among the malformed ones.
    """
    groups: list[Decoded] = []
    malformed: list[int] = []
    left = np.arange(len(block.start))
    view = block.data.data
    while len(left):
        row = int(left[0])
        raw = bytes(view[block.start[row]:block.end[row]])
        try:
            layout = Layout(raw)
        except MalformedMessageError:
            malformed.append(row)
            left = left[1:]
            continue
        if len(groups) + len(malformed) < MANY_LAYOUTS:
            group, left = _group(block, left, layout, raw)
        else:
            group, left = _group(block, left[:1], layout, raw)[0], left[1:]
        groups.append(group)
    return groups, np.array(malformed, np.int64)


def _group(block: Messages, candidates: NDArray[np.int64], layout: Layout, first: bytes
           ) -> tuple[Decoded, NDArray[np.int64]]:
    """The candidates of this layout, decoded, and the others."""
    length = layout.length
    long = block.end[candidates] - block.start[candidates] >= length
    rows = candidates if long.all() else candidates[long]
    data = _cut(block.data, block.start[rows], length)
    fits = _alike(data, layout, first[:length])
    if not fits.all():
        rows, data = rows[fits], data[fits]
    others = candidates if len(rows) < len(candidates) else candidates[:0]
    if len(others):
        others = np.setdiff1d(candidates, rows, assume_unique=True)
    stamp = data[:, 4:12].copy()
    seconds = stamp[:, :4].copy().view(f'{layout.order}i4')[:, 0].astype(np.int64)
    nanoseconds = stamp[:, 4:].copy().view(f'{layout.order}u4')[:, 0].astype(np.int64)
    arrays = tuple(
        np.ascontiguousarray(data[:, at:at + 8 * count]).view(f'{layout.order}f8').astype(
            np.float64, copy=False) if count else np.zeros((len(rows), 0))
        for at, count in layout.arrays)
    return Decoded(rows, layout.frame_id, layout.names, seconds * 1_000_000_000 + nanoseconds,
                   arrays), others  # type: ignore[arg-type]  # three arrays, as in the layout


def _cut(data: NDArray[np.uint8], start: NDArray[np.int64], length: int) -> NDArray[np.uint8]:
    """The first `length` bytes of every message, shape (n, length)."""
    if not len(start):
        return np.zeros((0, length), np.uint8)
    steps = np.diff(start)
    windows = np.lib.stride_tricks.sliding_window_view(data, length)
    if len(steps) and steps[0] > 0 and np.all(steps == steps[0]):
        return windows[start[0]:start[-1] + 1:steps[0]]
    return windows[start]


def _alike(data: NDArray[np.uint8], layout: Layout, first: bytes) -> NDArray[np.bool_]:
    """Which rows have the byte order, names and counts of `first`."""
    mask = np.zeros(layout.length, np.uint8)
    mask[0:2] = 255
    mask[layout.fixed_from:layout.fixed_to] = np.frombuffer(layout.mask, np.uint8)
    for at, _ in layout.counts:
        mask[at:at + 4] = 255
    where = np.flatnonzero(mask)
    wanted = np.frombuffer(first, np.uint8)[where]
    return np.all(data[:, where] == wanted, axis=1)


def encode_block(encoder: Encoder, stamps_ns: NDArray[np.int64], frame_id: str,
                 names: Sequence[str], positions: NDArray[np.float64],
                 velocities: NDArray[np.float64]) -> NDArray[np.uint8]:
    """JointStates with these names, shape (n, bytes of one message).

    Parameters
    ----------
    stamps_ns : shape (n,).
    positions, velocities : shape (n, number of names).
    """
    template = encoder.encode(0, frame_id, names, [0.0] * len(names), [0.0] * len(names))
    layout = Layout(template)
    out = np.empty((len(stamps_ns), len(template)), np.uint8)
    out[:] = np.frombuffer(template, np.uint8)
    seconds = stamps_ns // 1_000_000_000
    out[:, 4:8] = seconds.astype('<i4').view(np.uint8).reshape(-1, 4)
    out[:, 8:12] = (stamps_ns - seconds * 1_000_000_000).astype('<u4').view(np.uint8).reshape(-1, 4)
    for (at, count), array in zip(layout.arrays, (positions, velocities)):
        if count:
            out[:, at:at + 8 * count] = np.ascontiguousarray(array, '<f8').view(
                np.uint8).reshape(len(out), -1)
    return out
