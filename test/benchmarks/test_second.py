# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of second sensors: its off-line smoother, and its figures."""

import pytest

from benchmarks import second

BOUNDS = {
    'gyro, noise 0.005 rad/s': 0.15,
    'gyro, noise 0.02 rad/s': 0.3,
    'gyro, noise 0.3 rad/s': 1.0,
    'motor encoder, backlash 0.1 deg': 1.15,
    'motor encoder, backlash 0.5 deg': 1.02,
    'motor encoder, backlash 2.0 deg': 1.02,
}


@pytest.mark.slow  # driver/test_fused.py holds the same noises and backlashes
def test_the_figures_are_those_of_the_docs():
    rows, _ = second.part()
    assert {row['case'] for row in rows} == set(BOUNDS)
    assert not [row for row in rows if row['ratio'] > BOUNDS[row['case']]]
