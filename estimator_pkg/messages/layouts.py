# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages in a buffer, decoded together if they have the same layout.

A layout defines the minimum length of a message and the bytes that decide where its fields are
(byte order, texts, lengths). Messages with equal deciding bytes form one group.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.messages.block import Block
from estimator_pkg.messages.cdr import MalformedMessageError

MANY_LAYOUTS = 16  # with more layouts in one block, messages are decoded one by one


class LayoutLike(Protocol):
    """Interface of a layout."""

    @property
    def length(self) -> int:
        """Minimum length of a message [bytes]."""

    def deciding(self) -> Sequence[bool] | NDArray[np.bool_]:
        """Return True for each byte that decides the layout, shape (size,)."""


L = TypeVar('L', bound=LayoutLike)


@dataclass(frozen=True)
class Group(Generic[L]):
    """Messages of one layout: their rows in the block, ascending, and their bytes (n, length)."""

    rows: NDArray[np.int64]
    data: NDArray[np.uint8]
    layout: L


def groups(block: Block, make: Callable[[bytes], L], malformed: list[int]) -> Iterator[Group[L]]:
    """Yield the messages of a block by layout; a row without a layout is added to `malformed`.

    Parameters
    ----------
    make : returns the layout of a message; raises MalformedMessageError.
    """
    left: NDArray[np.int64] = np.arange(len(block.start))
    view = block.data.data
    tried = 0
    while len(left):
        row = int(left[0])
        raw = bytes(view[block.start[row] : block.end[row]])
        tried += 1
        try:
            layout = make(raw)
        except MalformedMessageError:
            malformed.append(row)
            left = left[1:]
            continue
        candidates = left if tried <= MANY_LAYOUTS else left[:1]
        group = _fitting(block, candidates, layout, raw)
        yield group
        if len(group.rows) == len(left):
            return
        left = np.setdiff1d(left, group.rows, assume_unique=True)


def _fitting(block: Block, candidates: NDArray[np.int64], layout: L, first: bytes) -> Group[L]:
    length = layout.length
    long = block.end[candidates] - block.start[candidates] >= length
    rows = candidates if long.all() else candidates[long]
    data = _cut(block.data, block.start[rows], length)
    where = np.flatnonzero(np.asarray(layout.deciding()))
    fits = np.all(data[:, where] == np.frombuffer(first, np.uint8)[where], axis=1)
    if not fits.all():
        rows, data = rows[fits], data[fits]
    return Group(rows, data, layout)


def _cut(data: NDArray[np.uint8], start: NDArray[np.int64], length: int) -> NDArray[np.uint8]:
    """Return `length` bytes from each start, shape (n, length); a view if starts are regular."""
    if not len(start):
        return np.zeros((0, length), np.uint8)
    windows = np.lib.stride_tricks.sliding_window_view(data, length)
    steps = np.diff(start)
    if len(steps) and steps[0] > 0 and np.all(steps == steps[0]):
        return windows[start[0] : start[-1] + 1 : steps[0]]
    return windows[start]


def numbers(data: NDArray[np.uint8], at: int, count: int, kind: str) -> NDArray[Any]:
    """Return `count` numbers of numpy type `kind` at byte `at`, shape (n, count)."""
    if not count:
        return np.zeros((len(data), 0), kind)
    size = np.dtype(kind).itemsize
    return np.ascontiguousarray(data[:, at : at + size * count]).view(kind)


def stamps(data: NDArray[np.uint8], at: int, order: str) -> NDArray[np.int64]:
    """Return stamps [ns] whose seconds are at byte `at`, shape (n,)."""
    seconds = numbers(data, at, 1, f'{order}i4')[:, 0].astype(np.int64)
    found: NDArray[np.int64] = (
        seconds * 1_000_000_000 + numbers(data, at + 4, 1, f'{order}u4')[:, 0]
    )
    return found


def put(out: NDArray[np.uint8], at: int, values: NDArray[Any]) -> None:
    """Write each row of `values`, shape (n, k), into the same row's bytes of `out` from `at` on."""
    raw = values.view(np.uint8).reshape(len(out), -1)
    out[:, at : at + raw.shape[1]] = raw


def put_stamps(out: NDArray[np.uint8], at: int, stamps_ns: NDArray[np.int64]) -> None:
    """Write stamps [ns], shape (n,), as little-endian seconds and nanoseconds from byte `at` on."""
    seconds = stamps_ns // 1_000_000_000
    put(out, at, seconds.astype('<i4'))
    put(out, at + 4, (stamps_ns - seconds * 1_000_000_000).astype('<u4'))
