# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Hall captures are read as their format says, and estimated within their project's thresholds."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.captures import QUANTUM, RATE, capture, captures, codes
from estimator_pkg.evaluation.entries import Entry

BAGS = Path(__file__).resolve().parents[2] / 'bags'
FORWARD = [1, 3, 2, 6, 4, 5]  # the lines of sectors 0 to 5
# mean square error [(counts/s)^2] that moteus allows itself (bags/README.md)
THRESHOLDS = {
    '20250616-speed-cycle': 421.0,
    '20250616-back-and-forth': 132.0,
    '20250616-hboard-cycle': 29.4,
    '20250615-new-slow': 320.0,
    '20260618-spindle-sweep': 117.0,
}


def packed(lines, mark=0x5A):
    return b''.join(bytes((mark, each, 0x80)) for each in lines)


def test_a_record_without_its_header_is_left_out():
    whole = packed([1, 3, 2, 6, 4, 5, 1])
    broken = b'\x00\x01' + whole + b'\x13' + packed([3, 2, 6, 4, 5, 1]) + b'\x5a\x03'
    np.testing.assert_array_equal(codes(broken), [1, 3, 2, 6, 4, 5, 1, 3, 2, 6, 4, 5, 1])
    assert len(codes(packed([1, 3, 2]))) == 0  # no five headers


def test_the_true_velocity_is_between_falling_edges():
    lines = np.repeat(FORWARD * 3, 10)  # one count every ten samples
    found = capture(lines)
    np.testing.assert_allclose(np.diff(found.angle)[9::10], QUANTUM)
    fell = np.flatnonzero((lines[:-1] & ~lines[1:]) != 0) + 1  # lines go low at every other edge
    np.testing.assert_array_equal(np.diff(fell), 20)
    expected = np.zeros(len(lines))
    expected[fell[0] : fell[-1]] = QUANTUM * RATE / 10.0
    np.testing.assert_allclose(found.velocity, expected)
    back = capture(lines[::-1])
    assert back.velocity.min() == -QUANTUM * RATE / 10.0 and back.velocity.max() == 0.0


@pytest.mark.slow
def test_no_capture_is_above_the_threshold():
    found = {}
    for column in captures(BAGS):
        joint = Entry('', 'edge_adaptive').joint(quantum=QUANTUM)
        velocity = np.nan_to_num(joint.run(column.samples.stamps, column.samples.angle).velocity)
        square = np.mean((velocity - column.samples.velocity) ** 2) / QUANTUM**2
        found[column.name] = square / THRESHOLDS[column.name]
    assert set(found) == set(THRESHOLDS)
    assert min(found.values()) > 0.5 and max(found.values()) < 1.0
