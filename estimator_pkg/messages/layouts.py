# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages in a buffer, decoded together if they have the same layout.

The bytes that decide where the fields are (byte order, texts, lengths) are read once; messages in
which they are equal form one group.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.messages.block import Block
from estimator_pkg.messages.cdr import MalformedMessageError, Reader

MANY_LAYOUTS = 16  # with more layouts in one block, messages are decoded one by one


class Layout:
    """Positions of the fields in messages like this one; a type reads them one after the other.

    Attributes
    ----------
    order : '<' or '>'. stamp_at : position of the header's stamp; None: no header. frame_id : of
    the header. length : minimum length of a message, after `end` [bytes].
    """

    def __init__(self, raw: bytes) -> None:
        self._reader = Reader(raw)
        self._decides = [(0, 2)]  # ranges of bytes; DDS leaves padding uninitialised
        self.order = self._reader.order
        self.stamp_at: int | None = None
        self.frame_id = ''

    def size(self) -> int:
        """Read the length before a sequence or text."""
        count: int = self._reader.number('I')
        self._decides.append((self._reader.at - 4, self._reader.at))
        if count > len(self._reader.raw):
            raise MalformedMessageError('message is too short')
        return count

    def skip_numbers(self, code: str, count: int) -> int:
        """Read numbers; return the position of the first one."""
        self._reader.numbers(code, count)
        return self._reader.at - count * struct.calcsize(f'={code}')

    def skip_text(self) -> None:
        """Read a text whose content does not matter."""
        self._reader.numbers('B', self.size())

    def text(self) -> str:
        """Read a text; the layout is that of messages with the same one."""
        start = self._reader.at
        self.skip_text()
        padding = -(start - 4) % 4
        self._decides.append((start + padding, self._reader.at))
        text = self._reader.raw[start + padding + 4 : self._reader.at - 1]
        return bytes(text).decode('utf-8', 'replace')

    def header(self) -> None:
        """Read a std_msgs/Header: its stamp is that of the measurement."""
        self.stamp_at = self.skip_numbers('I', 2)
        self.frame_id = self.text()

    def end(self) -> None:
        """Prepare for other messages, after the last read."""
        raw = bytes(self._reader.raw)
        self.length = self._reader.at
        self._where = [slice(*each) for each in _merged(self._decides)]
        self._same = [raw[each] for each in self._where]
        self._stamp = struct.Struct(f'{self.order}iI')

    def fits(self, raw: bytes) -> bool:
        """Return True if a message has this layout."""
        return len(raw) >= self.length and [raw[each] for each in self._where] == self._same

    def deciding(self) -> NDArray[np.int64]:
        """Return the positions of the bytes that decide the layout, shape (n,)."""
        return np.concatenate([np.arange(each.start, each.stop) for each in self._where])

    def stamp_ns(self, raw: bytes) -> int:
        """Return the stamp of the header, which there must be, of a message [ns]."""
        assert self.stamp_at is not None
        sec, nanosec = self._stamp.unpack_from(raw, self.stamp_at)
        stamp: int = sec * 1_000_000_000 + nanosec
        return stamp


def _merged(ranges: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return ranges, some of which overlap or touch, as few as possible."""
    found: list[tuple[int, int]] = []
    for start, end in sorted(ranges):
        if found and start <= found[-1][1]:
            start, before = found.pop()
            end = max(before, end)
        found.append((start, end))
    return found


L = TypeVar('L', bound=Layout)


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
    where = layout.deciding()
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
