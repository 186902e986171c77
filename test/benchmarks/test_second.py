# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of second sensors: its off-line smoother, and its figures."""

import numpy as np
import pytest

from benchmarks import second
from estimator_pkg.errors import UserError

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
    rows = [second.judged(case) for case in second.simulated()]
    assert {row['case'] for row in rows} == set(BOUNDS)
    assert not [row for row in rows if row['ratio'] > BOUNDS[row['case']]]
    assert 'backlash 0.5 deg' in second.describe(rows, False)


def test_the_smoother_of_both_is_better_than_either_and_finds_the_delay():
    time, rng = np.arange(1500) / 100.0, np.random.default_rng(5)
    speed = 2.0 * np.cos(4.0 * time) + 1.0 * np.cos(1.3 * time)
    angle = 0.5 * np.sin(4.0 * time) + np.sin(1.3 * time) / 1.3
    read = np.floor(angle / second.QUANTUM) * second.QUANTUM
    late = time - 0.011
    gyro = (2.0 * np.cos(4.0 * late) + np.cos(1.3 * late) - 0.05) / 0.9
    gyro += 0.03 * rng.standard_normal(len(time))
    velocity, ratio, delay = second.smoothed(time, read, gyro)
    error = velocity - speed
    assert abs(ratio - 0.9) < 0.01 and abs(delay - 0.011) < 0.001
    assert np.std(error[50:-50]) < 0.5 * 0.03 and abs(np.mean(error)) < 0.005


def test_a_folder_without_recordings_is_named(tmp_path):
    with pytest.raises(UserError, match='has no raw_'):
        next(second.recorded(tmp_path))
