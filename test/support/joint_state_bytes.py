# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A second encoder of JointState, byte by byte, and blocks of messages."""

from __future__ import annotations

import struct

from estimator_pkg.messages.block import from_messages


def block_of(raws):
    return from_messages([0] * len(raws), range(len(raws)), range(len(raws)), raws)


def cdr(message, order='<', padding=b'\0'):
    """The bytes of a message in either byte order and with any padding."""
    raw = bytearray(b'\0\1\0\0' if order == '<' else b'\0\0\0\0')

    def put(code, *values):
        size = struct.calcsize(code)
        for value in values:
            raw.extend((padding * 8)[: -(len(raw) - 4) % size])
            raw.extend(struct.pack(order + code, value))

    def put_text(text):
        encoded = text.encode() + b'\0'
        put('I', len(encoded))
        raw.extend(encoded)

    sec, nanosec = divmod(message.stamp_ns, 10**9)
    put('i', sec)
    put('I', nanosec)
    put_text(message.frame_id)
    put('I', len(message.names))
    for name in message.names:
        put_text(name)
    for array in message[3:]:
        put('I', len(array))
        put('d', *array)
    return bytes(raw)
