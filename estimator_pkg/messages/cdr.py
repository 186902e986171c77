# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads and writes CDR (XCDR1) primitives, the format of DDS and rosbag2.

Alignment is relative to the byte after the four-byte encapsulation header.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

EARLIEST, LATEST = -(2**31) * 10**9, 2**31 * 10**9 - 1  # stamps that a header can carry [ns]


class MalformedMessageError(ValueError):
    """The bytes are not a message of the expected type."""


class Reader:
    """A cursor over CDR bytes; every read checks the length.

    Raises
    ------
    MalformedMessageError : unknown encapsulation, or the bytes end too early.
    """

    def __init__(self, raw: bytes) -> None:
        if len(raw) < 4 or raw[0] != 0 or raw[1] not in (0, 1):
            raise MalformedMessageError('not a CDR message')
        self.raw = raw
        self.at = 4
        self.order = '<' if raw[1] else '>'

    def align(self, size: int) -> None:
        """Move to the next multiple of `size`."""
        self.at += -(self.at - 4) % size

    def numbers(self, code: str, count: int) -> tuple[Any, ...]:
        """Read `count` numbers of struct code `code`, aligned; for 0 numbers nothing moves."""
        if count == 0:
            return ()
        size = struct.calcsize(code)
        self.align(size)
        end = self.at + count * size
        if end > len(self.raw):
            raise MalformedMessageError('message is too short')
        values = struct.unpack_from(f'{self.order}{count}{code}', self.raw, self.at)
        self.at = end
        return values

    def number(self, code: str) -> Any:
        """Read one number of struct code `code`."""
        return self.numbers(code, 1)[0]

    def text(self) -> str:
        """Read a string."""
        length = self.number('I')
        end = self.at + length
        if end > len(self.raw):
            raise MalformedMessageError('message is too short')
        value = self.raw[self.at : end - 1] if length else b''
        self.at = end
        return bytes(value).decode('utf-8', 'replace')

    def doubles(self) -> tuple[float, ...]:
        """Read a sequence of doubles."""
        count = self.number('I')
        if count * 8 > len(self.raw):
            raise MalformedMessageError('message is too short')
        return self.numbers('d', count)


class Writer:
    """Little-endian CDR bytes, piece by piece."""

    def __init__(self) -> None:
        self.raw = bytearray(b'\x00\x01\x00\x00')

    def header(self, stamp_ns: int, frame_id: str) -> None:
        """Write a std_msgs/Header; a stamp outside its range is clamped to it."""
        sec, nanosec = divmod(min(max(stamp_ns, EARLIEST), LATEST), 1_000_000_000)
        self.numbers('i', (sec,))
        self.numbers('I', (nanosec,))
        self.text(frame_id)

    def numbers(self, code: str, values: Sequence[float]) -> None:
        """Write numbers of struct code `code`, aligned."""
        if len(values) == 0:
            return
        self.align(struct.calcsize(code))
        self.raw += struct.pack(f'<{len(values)}{code}', *values)

    def align(self, size: int) -> None:
        """Pad to a multiple of `size` bytes."""
        self.raw += b'\0' * (-(len(self.raw) - 4) % size)

    def text(self, value: str) -> None:
        """Write a string with its terminator."""
        encoded = value.encode() + b'\0'
        self.numbers('I', (len(encoded),))
        self.raw += encoded

    def texts(self, values: Sequence[str]) -> None:
        """Write a sequence of strings."""
        self.numbers('I', (len(values),))
        for value in values:
            self.text(value)

    def doubles(self, values: Sequence[float]) -> None:
        """Write a sequence of doubles."""
        self.numbers('I', (len(values),))
        self.numbers('d', values)
