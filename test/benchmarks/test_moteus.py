# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The Hall captures: format, true velocity and metric; and what the observers reach on them."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import moteus
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.entries import Entry

HALL = Path(__file__).resolve().parents[2] / 'bags' / moteus.FOLDER
FORWARD = [1, 3, 2, 6, 4, 5]  # the lines of sectors 0 to 5


def packed(lines, mark=0x5A):
    return b''.join(bytes((mark, each, 0x80)) for each in lines)


def test_a_record_without_its_header_is_left_out():
    whole = packed([1, 3, 2, 6, 4, 5, 1])
    broken = b'\x00\x01' + whole + b'\x13' + packed([3, 2, 6, 4, 5, 1]) + b'\x5a\x03'
    np.testing.assert_array_equal(moteus.codes(broken), [1, 3, 2, 6, 4, 5, 1, 3, 2, 6, 4, 5, 1])
    assert len(moteus.codes(packed([1, 3, 2]))) == 0  # no five headers


def test_the_true_velocity_is_between_falling_edges():
    lines = np.repeat(FORWARD * 3, 10)  # one count every ten samples
    found = moteus.capture('20250615-new-slow', lines)
    np.testing.assert_array_equal(np.diff(found.counts)[9::10], 1)
    fell = np.flatnonzero((lines[:-1] & ~lines[1:]) != 0) + 1  # lines go low at every other edge
    np.testing.assert_array_equal(np.diff(fell), 20)
    expected = np.zeros(len(lines))
    expected[fell[0] : fell[-1]] = moteus.RATE / 10.0
    np.testing.assert_allclose(found.velocity, expected)
    back = moteus.capture('20250615-new-slow', lines[::-1])
    assert back.velocity.min() == -moteus.RATE / 10.0 and back.velocity.max() == 0.0


def test_the_metric():
    velocity = np.full(2 * moteus.WINDOW, 100.0)
    velocity[moteus.WINDOW :] = np.linspace(100.0, 200.0, moteus.WINDOW)
    stamps = np.arange(len(velocity))
    found = moteus.Capture('20250616-hboard-cycle', stamps, stamps, velocity, stamps < 0)
    judged = moteus.judge(found, velocity + 2.0)
    assert judged == pytest.approx({'square': 4.0 / 29.4, 'largest': 2.0, 'bias': 0.02})
    missing = np.where(stamps < moteus.WINDOW, np.nan, velocity)
    assert moteus.judge(found, missing)['square'] == pytest.approx(0.5 * 100.0**2 / 29.4)


@pytest.mark.slow  # compiles the loop with a sensor map
def test_no_capture_is_above_the_threshold():
    rows = moteus.run(HALL, [Entry('edge_adaptive', 'edge_adaptive')], fast=True)
    assert [row['capture'] for row in rows] == list(moteus.THRESHOLDS)
    for row in rows:
        assert row['square'] < 1.0, row
    text = moteus.describe(rows)
    assert re.search(r'20250616-back-and-forth +132 +0\.\d\d, \d\.\d\d %', text)


def test_no_captures(tmp_path):
    with pytest.raises(UserError, match=r'has no capture such as 20250616-speed-cycle\.dat\.gz'):
        moteus.captures(tmp_path)


@pytest.mark.slow
def test_errors_of_the_edges_are_most_of_what_is_left_at_speed():
    """Lower and upper bounds around the figures on the page."""
    for name, least, most in (
        ('20260618-spindle-sweep', 0.1, 0.3),
        ('20250616-hboard-cycle', 0.3, 0.5),
        ('20250616-speed-cycle', 0.4, 0.6),
    ):
        (found,) = (each for each in moteus.captures(HALL) if each.name == name)
        joint = Entry('', 'edge_adaptive').joint(quantum=moteus.QUANTUM)
        readings = found.counts.astype(np.float64) * moteus.QUANTUM
        shaft = joint.run(found.stamps, readings, fast=True).velocity / moteus.QUANTUM
        edges = moteus.judge(found, moteus.of_edges(found, fast=True))['square']
        assert least < edges < most
        assert edges < moteus.judge(found, shaft)['square']
