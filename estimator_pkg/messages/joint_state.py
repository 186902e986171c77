# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""sensor_msgs/JointState from and to CDR bytes.

A stream repeats its names in every message. A `Layout`, which follows from names and counts, is
computed once and used as long as these bytes are the same, so one message costs about 2 us.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.messages.cdr import EARLIEST, LATEST, Reader, Writer

TYPE = 'sensor_msgs/msg/JointState'


class Layout:
    """Positions of all fields in messages with these names and array lengths."""

    def __init__(self, raw: bytes) -> None:
        reader = Reader(raw)
        self.order = reader.order
        self._head = raw[:2]
        reader.numbers('I', 2)
        self.fixed_from = reader.at
        self.frame_id = reader.text()
        self.names = reader.texts()
        self.fixed_to = reader.at
        # DDS leaves padding bytes uninitialised, so the comparison masks them.
        mask = bytearray(b'\xff' * (self.fixed_to - self.fixed_from))
        for start, end in reader.padding:
            mask[start - self.fixed_from : end - self.fixed_from] = bytes(end - start)
        self._carrying = bytes(mask)
        self._mask = int.from_bytes(mask, 'little')
        self._fixed = self._significant(raw)
        self.counts: list[tuple[int, int]] = []  # (position of the count, count)
        self.arrays: list[tuple[int, int]] = []  # (position of the first number, count)
        for _ in range(3):
            reader.align(4)
            at = reader.at
            count = len(reader.doubles())
            self.counts.append((at, count))
            self.arrays.append((reader.at - 8 * count, count))
        self.length = reader.at
        self._stamp = struct.Struct(self.order + 'iI')
        first, second, third = (at for at, _ in self.counts)
        gaps = f'I{second - first - 4}xI{third - second - 4}xI'
        self._counts, self._counts_from = struct.Struct(self.order + gaps), first
        self._expected = tuple(count for _, count in self.counts)
        self._doubles = [struct.Struct(f'{self.order}{count}d') for _, count in self.arrays]

    def fits(self, raw: bytes) -> bool:
        """Return True if `raw` has these names and array lengths."""
        if len(raw) < self.length or raw[:2] != self._head or self._significant(raw) != self._fixed:
            return False
        return self._counts.unpack_from(raw, self._counts_from) == self._expected

    def _significant(self, raw: bytes) -> int:
        return int.from_bytes(raw[self.fixed_from : self.fixed_to], 'little') & self._mask

    def deciding(self) -> NDArray[np.bool_]:
        """Return True for each byte that decides the layout, shape (length,)."""
        mask = bytearray(self.length)
        mask[:2] = b'\xff\xff'
        mask[self.fixed_from : self.fixed_to] = self._carrying
        for at, _ in self.counts:
            mask[at : at + 4] = b'\xff' * 4
        return np.frombuffer(mask, np.uint8).astype(bool)

    def stamp_ns(self, raw: bytes) -> int:
        """Return the header stamp [ns]."""
        sec, nanosec = self._stamp.unpack_from(raw, 4)
        stamp: int = sec * 1_000_000_000 + nanosec
        return stamp

    def numbers(self, raw: bytes, which: int) -> tuple[float, ...]:
        """Return positions (0), velocities (1) or efforts (2)."""
        return self._doubles[which].unpack_from(raw, self.arrays[which][0])


class JointState(NamedTuple):
    """A decoded message; SI units."""

    stamp_ns: int
    frame_id: str
    names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]


class Decoder:
    """Decodes a stream of JointState bytes; caches the layout of the last message."""

    def __init__(self) -> None:
        self._layout: Layout | None = None

    def layout(self, raw: bytes) -> Layout:
        """Return the layout of this message.

        Raises
        ------
        MalformedMessageError : the bytes are not a JointState.
        """
        layout = self._layout
        if layout is None or not layout.fits(raw):
            layout = self._layout = Layout(raw)
        return layout

    def decode(self, raw: bytes) -> JointState:
        """Decode `raw`; raise MalformedMessageError if it is not a JointState."""
        layout = self.layout(raw)
        return JointState(
            layout.stamp_ns(raw),
            layout.frame_id,
            layout.names,
            layout.numbers(raw, 0),
            layout.numbers(raw, 1),
            layout.numbers(raw, 2),
        )


class Encoder:
    """Encodes JointStates; caches the bytes before the arrays while the names stay the same."""

    def __init__(self) -> None:
        self._key: tuple[Any, ...] | None = None
        self._prefix = b''
        self._body = struct.Struct('<III')

    def encode(
        self,
        stamp_ns: int,
        frame_id: str,
        names: Sequence[str],
        positions: Sequence[float] = (),
        velocities: Sequence[float] = (),
        efforts: Sequence[float] = (),
    ) -> bytes:
        """Return the CDR bytes of this JointState (SI units, stamp in ns).

        A stamp outside the range of a header (int32 seconds) is clamped to it.
        """
        key = (frame_id, tuple(names), len(positions), len(velocities), len(efforts))
        if key != self._key:
            self._learn(key)
        if not EARLIEST <= stamp_ns <= LATEST:
            stamp_ns = min(max(stamp_ns, EARLIEST), LATEST)
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        return (
            _STAMP.pack(0, 1, 0, 0, sec, nanosec)
            + self._prefix
            + self._body.pack(
                len(positions), *positions, len(velocities), *velocities, len(efforts), *efforts
            )
        )

    def _learn(self, key: tuple[Any, ...]) -> None:
        frame_id, names, *counts = key
        writer = Writer()
        writer.header(0, frame_id)
        writer.texts(names)
        writer.raw += b'\0' * (-len(writer.raw) % 4)
        self._prefix = bytes(writer.raw[12:])
        at = len(writer.raw) - 4
        body = '<'
        for count in counts:
            body += 'I'
            at += 4
            if count:
                body += f'{-at % 8}x{count}d'
                at += -at % 8 + 8 * count
        self._body = struct.Struct(body)
        self._key = key


_STAMP = struct.Struct('<4BiI')
