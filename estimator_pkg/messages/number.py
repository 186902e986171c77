# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The std_msgs that carry one number, from CDR bytes."""

from __future__ import annotations

import struct
from collections.abc import Callable

from estimator_pkg.messages.cdr import MalformedMessageError

_CODES = {
    'Float64': 'd',
    'Float32': 'f',
    'Int64': 'q',
    'Int32': 'i',
    'Int16': 'h',
    'Int8': 'b',
    'UInt64': 'Q',
    'UInt32': 'I',
    'UInt16': 'H',
    'UInt8': 'B',
}


def decoder(name: str) -> Callable[[bytes], float]:
    """Return a function that decodes the number of a std_msgs message `name`, such as 'Int32'.

    The function raises MalformedMessageError if the bytes are not such a message.
    """
    little, big = (struct.Struct(order + _CODES[name]) for order in '<>')
    size = 4 + little.size

    def decode(raw: bytes) -> float:
        if len(raw) < size or raw[0] != 0 or raw[1] > 1:
            raise MalformedMessageError(f'not a std_msgs/{name}')
        value: float = (little if raw[1] else big).unpack_from(raw, 4)[0]
        return value

    return decode
