# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Diagnostics of a replay, as rclpy reads them."""

import math

import pytest

from estimator_pkg.messages import diagnostics

rclpy_serialization = pytest.importorskip('rclpy.serialization')
messages = pytest.importorskip('diagnostic_msgs.msg')


def test_every_status_with_its_values():
    stamp = 1_700_000_000_123_456_789
    rows = [
        (diagnostics.OK, 'a', 'A', 'fine', {'rate': 999.99999999, 'dropped': 3, 'x': 'y'}),
        (diagnostics.ERROR, 'of b', 'b', 'lost', {'sigma': math.nan, 'most': math.inf}),
        (diagnostics.WARN, 'c', 'c', '', {}),
    ]
    given = [diagnostics.Status(*row[:4], diagnostics.packed(row[4])) for row in rows]
    raw = diagnostics.encode(stamp, given)
    found = rclpy_serialization.deserialize_message(raw, messages.DiagnosticArray)
    assert found.header.stamp.sec * 10**9 + found.header.stamp.nanosec == stamp
    assert [(each.name, each.hardware_id, each.message) for each in found.status] == [
        ('a', 'A', 'fine'), ('of b', 'b', 'lost'), ('c', 'c', ''),
    ]  # fmt: skip
    kinds = messages.DiagnosticStatus
    assert [each.level for each in found.status] == [kinds.OK, kinds.ERROR, kinds.WARN]
    values = [{one.key: one.value for one in each.values} for each in found.status]
    assert values == [
        {'rate': '1000', 'dropped': '3', 'x': 'y'}, {'sigma': '', 'most': ''}, {},
    ]  # fmt: skip
