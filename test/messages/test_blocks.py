# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joint states decoded and encoded many at a time: the same as one by one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from joint_state_bytes import block_of, cdr

from estimator_pkg.messages import layouts
from estimator_pkg.messages.block import compact, from_messages, join, rows
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder, Encoder, JointState
from estimator_pkg.messages.joint_state_block import decode_block, encode_block

NAMES = [['a', 'b'], ['b', 'a'], ['a'], [], ['a', 'longer_name', 'b'], ['a', 'a']]


@st.composite
def messages(draw):
    """One message, or bytes that are none."""
    kind = draw(st.sampled_from(['good'] * 8 + ['big', 'short', 'garbage']))
    names = draw(st.sampled_from(NAMES))
    width = draw(st.sampled_from([len(names)] * 5 + [0, 3]))
    stamp = draw(st.integers(-(10**9), 2**31 * 10**9 - 1))
    positions = [draw(st.sampled_from([0.0, 1.5, -3.0, float('inf')])) for _ in range(width)]
    frame = draw(st.sampled_from(['', 'base', 'tool0']))
    if kind == 'big':
        return cdr(JointState(stamp, frame, tuple(names), tuple(positions), (), ()), '>')
    raw = bytearray(
        Encoder().encode(
            stamp,
            frame,
            names,
            positions,
            [2.0] * draw(st.sampled_from([0, 2])),
            [3.0] * draw(st.sampled_from([0, 1])),
        )
    )
    if kind == 'short':
        return bytes(raw[: draw(st.integers(0, len(raw) - 1))])
    if kind == 'garbage':
        return draw(st.binary(max_size=60))
    return bytes(raw) + b'\0' * draw(st.sampled_from([0, 0, 4]))


@pytest.mark.long
@settings(max_examples=150, deadline=None)
@given(raws=st.lists(messages(), max_size=40), many=st.integers(0, 20))
def test_blocks_decode_as_single_messages_do(raws, many):
    before, layouts.MANY_LAYOUTS = layouts.MANY_LAYOUTS, many
    try:
        groups, malformed = decode_block(block_of(raws))
    finally:
        layouts.MANY_LAYOUTS = before
    found = {}
    for group in groups:
        assert list(group.rows) == sorted(group.rows)
        for i, row in enumerate(group.rows.tolist()):
            found[row] = (
                int(group.stamps_ns[i]),
                group.frame_id,
                group.names,
                *(tuple(array[i].tolist()) for array in group.arrays),
            )
    decode = Decoder().decode
    for row, raw in enumerate(raws):
        try:
            wanted = tuple(decode(raw))
        except MalformedMessageError:
            assert row in malformed
        else:
            assert found.pop(row) == wanted
    assert not found


def test_padding_that_differs_makes_no_other_group():
    # three characters and the terminator fill four bytes; 'base' leaves three bytes of padding
    raws = []
    for i in range(20):
        raw = bytearray(Encoder().encode(10**9 + i, 'base', ['a', 'bb'], [1.0 * i, 2.0]))
        at = raw.index(b'base') + 5
        raw[at : at + 3] = bytes([i, 255 - i, 7 * i])
        raws.append(bytes(raw))
    groups, malformed = decode_block(block_of(raws))
    assert len(groups) == 1
    assert not malformed
    assert groups[0].arrays[0][:, 0].tolist() == [1.0 * i for i in range(20)]


@settings(max_examples=60, deadline=None)
@given(
    stamps=st.lists(st.integers(-(10**9), 2**31 * 10**9 - 1), min_size=1, max_size=10),
    names=st.sampled_from(NAMES),
    frame=st.sampled_from(['', 'base']),
)
def test_blocks_encode_as_single_messages_do(stamps, names, frame):
    shape = (len(stamps), len(names))
    positions = np.random.default_rng(1).normal(size=shape)
    velocities = np.random.default_rng(2).normal(size=shape)
    rows = encode_block(Encoder(), np.array(stamps), frame, names, positions, velocities)
    single = Encoder().encode
    for row, stamp, position, velocity in zip(rows, stamps, positions, velocities):
        assert row.tobytes() == single(stamp, frame, names, position.tolist(), velocity.tolist())


def test_blocks_are_joined_sorted_and_cut_without_losing_a_byte():
    raws = [b'one', b'', b'three', b'4']
    first = from_messages([0, 1, 0, 1], [5, 3, 3, 9], [1, 2, 3, 4], raws)
    both = join([first.take(np.array([2, 0])), first, from_messages([], [], [], [])])
    assert both.log_ns.tolist() == [3, 5, 5, 3, 3, 9] and both.topic.tolist() == [0, 0, 0, 1, 0, 1]
    assert both.publish_ns.tolist() == [3, 1, 1, 2, 3, 4]

    def texts(found):
        return [bytes(found.data[a:b]) for a, b in zip(found.start, found.end)]

    assert texts(both) == [b'three', b'one', *raws]
    ordered = both.in_log_order()
    assert texts(ordered) == [b'three', b'', b'three', b'one', b'one', b'4']
    assert ordered.in_log_order() is ordered
    part = compact(first.take(np.array([3, 2])))
    assert texts(part) == [b'4', b'three'] and bytes(part.data) == b'three4'
    assert len(compact(first.take(np.array([], int))).data) == 0
    assert rows(first.data, np.array([0, 3]), 3).tobytes() == b'onethr'
    assert rows(first.data, np.array([], int), 3).shape == (0, 3)
