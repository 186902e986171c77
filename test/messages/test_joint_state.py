# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""JointState bytes: ours against rclpy's own serialisation, both ways, and against garbage."""

import struct

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from joint_state_bytes import cdr

from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder, Encoder, JointState
from estimator_pkg.ros import runtime  # noqa: F401  (sets the environment that rclpy needs)

rclpy_serialization = pytest.importorskip('rclpy.serialization')
RosJointState = pytest.importorskip('sensor_msgs.msg').JointState

texts = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=12)
doubles = st.floats(allow_nan=True, allow_infinity=True)
arrays = st.lists(doubles, max_size=5)
messages = st.builds(
    JointState,
    st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1),
    texts,
    st.lists(texts, max_size=5).map(tuple),
    arrays.map(tuple),
    arrays.map(tuple),
    arrays.map(tuple),
)
SEVEN = JointState(
    1_700_000_000_123_456_789,
    'base',
    tuple(f'joint_{i}' for i in range(7)),
    tuple(0.1 * i for i in range(7)),
    (),
    tuple(1.0 * i for i in range(7)),
)


def ros(message):
    """The message as rclpy has it."""
    out = RosJointState()
    out.header.stamp.sec, out.header.stamp.nanosec = divmod(message.stamp_ns, 10**9)
    out.header.frame_id = message.frame_id
    out.name = list(message.names)
    out.position = list(message.positions)
    out.velocity = list(message.velocities)
    out.effort = list(message.efforts)
    return out


def exact(message):
    """Something that compares equal for equal messages, NaNs too."""
    return (*message[:3], *(struct.pack(f'<{len(x)}d', *x) for x in message[3:]))


def from_ros(message):
    stamp = message.header.stamp
    return JointState(
        stamp.sec * 10**9 + stamp.nanosec,
        message.header.frame_id,
        tuple(message.name),
        tuple(message.position),
        tuple(message.velocity),
        tuple(message.effort),
    )


shared = Decoder()  # as in a node: it remembers the layout of whatever came before
encoder = Encoder()


@pytest.mark.long
@settings(max_examples=300, deadline=None)
@given(messages)
@example(SEVEN)
@example(JointState(0, '', (), (), (), ()))
def test_decodes_what_rclpy_serialises(message):
    raw = bytes(rclpy_serialization.serialize_message(ros(message)))
    for decoder in (shared, Decoder()):
        assert exact(decoder.decode(raw)) == exact(message)
        assert exact(decoder.decode(raw)) == exact(message)  # the layout is known now


@pytest.mark.long
@settings(max_examples=300, deadline=None)
@given(messages)
@example(SEVEN)
def test_rclpy_deserialises_what_we_encode(message):
    for _ in range(2):
        raw = encoder.encode(*message)
        assert exact(from_ros(rclpy_serialization.deserialize_message(raw, RosJointState))) == (
            exact(message)
        )
        assert raw == cdr(message)
        assert exact(shared.decode(raw)) == exact(message)


@pytest.mark.long
@settings(max_examples=200, deadline=None)
@given(messages, messages, st.binary(min_size=1, max_size=1), st.sampled_from('<>'))
def test_padding_and_byte_order_do_not_matter(first, second, padding, order):
    decoder = Decoder()
    for message in (first, first, second, first):
        assert exact(decoder.decode(cdr(message, order, padding))) == exact(message)
        assert exact(decoder.decode(cdr(message))) == exact(message)


@pytest.mark.long
@settings(max_examples=100, deadline=None)
@given(messages, st.sampled_from('<>'))
@example(SEVEN, '<')
def test_every_truncation_is_malformed(message, order):
    raw = cdr(message, order)
    warm = Decoder()
    warm.decode(raw)
    for length in range(len(raw)):
        for decoder in (warm, Decoder()):
            with pytest.raises(MalformedMessageError):
                decoder.decode(raw[:length])
        if length % 7 == 0:
            warm.decode(raw)


def outcome(decoder, raw):
    try:
        return exact(decoder.decode(raw))
    except MalformedMessageError:
        return None


@pytest.mark.long
@settings(max_examples=300, deadline=None)
@given(
    messages,
    st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=3),
)
@example(SEVEN, [(1, 2)])
@example(SEVEN, [(0, 1)])
@example(SEVEN, [(1, 0)])
def test_what_a_decoder_remembers_never_changes_what_it_says(message, changes):
    raw = bytearray(cdr(message))
    for at, byte in changes:
        raw[at % len(raw)] = byte
    warm = Decoder()
    warm.decode(cdr(message))
    assert outcome(warm, bytes(raw)) == outcome(Decoder(), bytes(raw))


def test_absurd_lengths_are_refused_before_anything_is_made_of_them():
    for at in (12, 20, 24, 28, 32):  # of frame_id, of names, of each array
        raw = bytearray(cdr(JointState(0, '', (), (), (), ())))
        raw[at : at + 4] = b'\xff\xff\xff\x7f'
        with pytest.raises(MalformedMessageError):
            Decoder().decode(bytes(raw))


def test_stamps_that_no_message_can_carry_are_encoded_as_the_nearest():
    """sec at its largest with nanoseconds beyond a second: a decoder has to make some int of it."""
    raw = bytearray(cdr(SEVEN))
    raw[4:12] = struct.pack('<iI', 2**31 - 1, 4_000_000_000)
    stamp = Decoder().decode(bytes(raw)).stamp_ns
    assert stamp == (2**31 - 1) * 10**9 + 4_000_000_000
    back = Decoder().decode(encoder.encode(stamp, '', ()))
    assert back.stamp_ns == (2**31 - 1) * 10**9 + 999_999_999
    back = Decoder().decode(encoder.encode(-(2**63), '', ()))
    assert back.stamp_ns == -(2**31) * 10**9
