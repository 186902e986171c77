# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""geometry_msgs/Vector3Stamped from and to CDR bytes."""

from __future__ import annotations

from typing import NamedTuple

from estimator_pkg.messages.cdr import Reader, Writer

TYPE = 'geometry_msgs/msg/Vector3Stamped'


class Vector3(NamedTuple):
    """A decoded message; SI units."""

    stamp_ns: int
    frame_id: str
    x: float
    y: float
    z: float


def decode(raw: bytes) -> Vector3:
    """Decode `raw`; raise MalformedMessageError if it is not a Vector3Stamped."""
    reader = Reader(raw)
    sec, nanosec = reader.number('i'), reader.number('I')
    frame_id = reader.text()
    return Vector3(sec * 1_000_000_000 + nanosec, frame_id, *reader.numbers('d', 3))


def encode(stamp_ns: int, frame_id: str, x: float, y: float, z: float = 0.0) -> bytes:
    """Encode as CDR; a stamp outside the range of a header is clamped to it."""
    writer = Writer()
    writer.header(stamp_ns, frame_id)
    writer.numbers('d', (x, y, z))
    return bytes(writer.raw)
