# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bytes of drive batches and vectors: against rclpy's serialisation, both ways, and garbage."""

import math
import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.ros import runtime  # noqa: F401  (sets the environment that rclpy needs)

rclpy_serialization = pytest.importorskip('rclpy.serialization')
std_msgs = pytest.importorskip('std_msgs.msg')
geometry_msgs = pytest.importorskip('geometry_msgs.msg')

START = 1_700_000_000_123_456_789
STAMPS = np.append(-(10**9) - 7, START + 50_000 * np.arange(4))
VALUES = np.arange(20.0).reshape(5, 4) / 7.0
VALUES[1, :3] = math.nan, math.inf, -math.inf


def ros(rows, labels=('sample', 'channel'), sizes=None, strides=None, offset=0, data=None):
    """A Float64MultiArray as another program would make it."""
    message = std_msgs.Float64MultiArray()
    count, width = (len(rows), 6) if sizes is None else sizes
    strides = (count * width, width) if strides is None else strides
    for label, size, stride in zip(labels, (count, width), strides):
        message.layout.dim.append(
            std_msgs.MultiArrayDimension(label=label, size=size, stride=stride)
        )
    message.layout.data_offset = offset
    message.data = [0.5] * offset + (np.ravel(rows).tolist() if data is None else data)
    return rclpy_serialization.serialize_message(message)


def table(stamps=STAMPS, values=VALUES):
    stamps = np.asarray(stamps)
    return np.column_stack([stamps // 10**9, stamps % 10**9, values])


def test_what_rclpy_writes_is_read_to_the_nanosecond():
    for offset in (0, 1, 2):
        batch = drive_samples.decode(ros(table(), offset=offset))
        assert batch.stamps_ns.tolist() == STAMPS.tolist()
        assert np.array_equal(batch.values, VALUES, equal_nan=True)


def test_what_is_written_rclpy_reads():
    for count in (0, 1, 2, 5):
        raw = drive_samples.encode(STAMPS[:count], VALUES[:count])
        message = rclpy_serialization.deserialize_message(raw, std_msgs.Float64MultiArray)
        assert [(dim.label, dim.size, dim.stride) for dim in message.layout.dim] == [
            ('sample', count, 6 * count),
            ('channel', 6, 6),
        ]
        assert message.layout.data_offset == 0
        assert np.array_equal(np.reshape(message.data, (-1, 6)), table()[:count], equal_nan=True)
        assert drive_samples.decode(raw).stamps_ns.tolist() == STAMPS[:count].tolist()


@pytest.mark.parametrize(
    ('raw', 'said'),
    [
        (ros(table(), labels=('row', 'channel')), "label 'row', not 'sample'"),
        (ros(table(), labels=('sample', 'axis')), "label 'axis', not 'channel'"),
        (ros(table()[:, :5], sizes=(5, 5)), "'channel' has size 5, not 6"),
        (ros(table(), labels=('sample',), strides=(30,)), '1 dimensions; it needs 2'),
        (ros(table(), sizes=(6, 6)), 'too few for 6 rows'),
        (ros(table(), strides=(30, 5)), 'strides'),
        (ros(table(), data=[]), '0 numbers are too few'),
        (ros(table() + [0.5, 0, 0, 0, 0, 0]), 'invalid time stamp'),
        (ros(table() * [math.nan, 1, 1, 1, 1, 1]), 'row 0 has an invalid time stamp'),
        (ros(table() * [1, -1, 1, 1, 1, 1]), 'invalid time stamp'),
        (b'', 'CDR'),
        (b'\0\1\0\0', 'too short'),
    ],
    ids=lambda each: each if isinstance(each, str) else 'raw',
)  # padding bytes are random
def test_another_layout_is_refused_with_the_reason(raw, said):
    with pytest.raises(MalformedMessageError, match=said):
        drive_samples.decode(raw)


def test_left_out_strides_and_big_endian_bytes_are_taken():
    assert len(drive_samples.decode(ros(table(), strides=(0, 0))).stamps_ns) == 5
    raw = b'\0\0\0\0' + struct.pack('>I', 2)
    raw += struct.pack('>I', 7) + b'sample\0\0' + struct.pack('>2I', 1, 6)
    raw += struct.pack('>I', 8) + b'channel\0' + struct.pack('>4I', 6, 6, 0, 6)
    raw += b'\0' * (-(len(raw) - 4) % 8) + struct.pack('>6d', 3.0, 4.0, 1.0, 2.0, 3.0, 4.0)
    batch = drive_samples.decode(raw)
    assert batch.stamps_ns.tolist() == [3_000_000_004]
    assert batch.values.tolist() == [[1.0, 2.0, 3.0, 4.0]]
    assert batch.values.dtype == np.float64 and batch.values.dtype.isnative


@given(st.binary(max_size=200))
def test_garbage_is_refused_not_crashed_on(raw):
    for bytes_ in (raw, b'\0\1\0\0' + raw):
        with suppress(MalformedMessageError):
            batch = drive_samples.decode(bytes_)
            assert batch.values.shape == (len(batch.stamps_ns), 4)
        with suppress(MalformedMessageError):
            assert vector3.decode(bytes_).stamp_ns >= 0


def test_a_batch_cut_short_anywhere_is_refused():
    raw = drive_samples.encode(STAMPS, VALUES)
    for length in range(len(raw)):
        with pytest.raises(MalformedMessageError):
            drive_samples.decode(raw[:length])


def test_vectors_both_ways():
    message = geometry_msgs.Vector3Stamped()
    message.header.stamp.sec, message.header.stamp.nanosec = -5, 999_999_999
    message.header.frame_id = 'stator'
    message.vector.x, message.vector.y, message.vector.z = 1.5, -2.5, math.inf
    raw = rclpy_serialization.serialize_message(message)
    found = vector3.decode(raw)
    assert found == (-5 * 10**9 + 999_999_999, 'stator', 1.5, -2.5, math.inf)
    back = rclpy_serialization.deserialize_message(
        vector3.encode(*found), geometry_msgs.Vector3Stamped
    )
    assert back == message
    with pytest.raises(MalformedMessageError):
        vector3.decode(raw[:40])
    assert vector3.decode(vector3.encode(5, '', 1.0, 2.0)) == (5, '', 1.0, 2.0, 0.0)
    for stamp in (2**31 * 10**9, -(2**31) * 10**9 - 1):  # as no header can carry it
        assert abs(vector3.decode(vector3.encode(stamp, '', 1.0, 2.0)).stamp_ns - stamp) == 1
