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

from estimator_pkg.messages import layouts
from estimator_pkg.messages.cdr import EARLIEST, LATEST, Writer

TYPE = 'sensor_msgs/msg/JointState'


class Layout(layouts.Layout):
    """Positions of all fields in messages with these names and array lengths.

    arrays : position of the first number and length, of positions, velocities and efforts.
    """

    def __init__(self, raw: bytes) -> None:
        super().__init__(raw)
        self.header()
        self.names = tuple(self.text() for _ in range(self.size()))
        self.arrays: list[tuple[int, int]] = []
        for _ in range(3):
            count = self.size()
            self.arrays.append((self.skip_numbers('d', count), count))
        self.end()
        self._doubles = [struct.Struct(f'{self.order}{count}d') for _, count in self.arrays]

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
