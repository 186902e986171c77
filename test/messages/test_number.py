# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Numbers of std_msgs, from CDR bytes of either order."""

import struct

import pytest

from estimator_pkg.messages import number
from estimator_pkg.messages.cdr import MalformedMessageError

CODES = {'Float64': 'd', 'Float32': 'f', 'Int64': 'q', 'Int32': 'i', 'Int16': 'h', 'Int8': 'b',
         'UInt64': 'Q', 'UInt32': 'I', 'UInt16': 'H', 'UInt8': 'B'}  # fmt: skip


@pytest.mark.parametrize('name, code', CODES.items())
def test_each_type_in_either_order_and_none_cut_short(name, code):
    decode = number.decoder(name)
    value = 117 if name.startswith('UInt') else -2.5 if name.startswith('Float') else -117
    for order, head in (('<', b'\0\1\0\0'), ('>', b'\0\0\0\0')):
        raw = head + struct.pack(order + code, value)
        assert decode(raw) == value == decode(raw + b'\0')
        for bad in (raw[:-1], raw[:4], b'', b'\1' + raw[1:], b'\0\2' + raw[2:]):
            with pytest.raises(MalformedMessageError, match=f'not a std_msgs/{name}'):
                decode(bad)
