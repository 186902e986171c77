# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""diagnostic_msgs/DiagnosticArray as CDR bytes, without ROS."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from estimator_pkg.messages.cdr import Writer

TYPE = 'diagnostic_msgs/msg/DiagnosticArray'
OK, WARN, ERROR = 0, 1, 2  # levels of a DiagnosticStatus


class Status(NamedTuple):
    """One entry; see `packed` for its values."""

    level: int
    name: str
    hardware_id: str
    message: str
    values: bytes


def packed(values: Mapping[str, Any]) -> bytes:
    """Return the CDR bytes of an entry's values, which are the same wherever it stands."""
    writer = Writer()
    writer.numbers('I', (len(values),))
    for key, value in values.items():
        writer.text(key)
        writer.text(text(value))
    return bytes(writer.raw[4:])


def encode(stamp_ns: int, statuses: Sequence[Status]) -> bytes:
    """Return CDR bytes; a stamp outside the range of a header is clamped to it."""
    writer = Writer()
    writer.header(stamp_ns, '')
    writer.numbers('I', (len(statuses),))
    for status in statuses:
        writer.numbers('B', (status.level,))
        writer.text(status.name)
        writer.text(status.message)
        writer.text(status.hardware_id)
        writer.align(4)
        writer.raw += status.values
    return bytes(writer.raw)


def text(value: Any) -> str:
    """Return a value as readable text; '' for NaN and infinity."""
    if isinstance(value, float):
        return f'{value:.6g}' if math.isfinite(value) else ''
    return str(value)
