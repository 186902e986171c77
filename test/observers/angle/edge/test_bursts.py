# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Stamps that lie: readings that wait and then come at once, and a stream that gets slower."""

from __future__ import annotations

import numpy as np
import pytest

from estimator_pkg.evaluation.entries import Entry

START = 1_700_000_000_000_000_000
QUANTUM = 3.8e-4  # [rad]


def _velocity(time: np.ndarray, angle: np.ndarray, period: float) -> np.ndarray:
    joint = Entry('edge', 'edge_adaptive').joint(wrap_period=period)
    return joint.run(START + np.rint(time * 1e9).astype(np.int64), angle).velocity


@pytest.mark.parametrize('seed', [0, 3])
def test_a_joint_that_slows_down_while_its_stream_does_is_followed(seed: int) -> None:
    """The readings move as if nothing had changed, were each stamp later than the one before."""
    random = np.random.default_rng(seed)
    dt = np.repeat([0.01, 0.02], 200) + random.uniform(-3e-4, 3e-4, 400)
    time = np.cumsum(dt)
    since = time - time[199]
    angle = QUANTUM * np.floor(np.where(since < 0.0, 60.0, 30.0) * since / QUANTUM)
    velocity = _velocity(time, angle, 0.0)
    assert np.max(np.abs(velocity[215:] - 30.0)) < 1.0  # 30 for good where lateness may add up


def test_readings_that_come_in_bursts_are_no_blows() -> None:
    """One reading in 100 waits for six samples, and those behind it: then all come at once."""
    random = np.random.default_rng(2)
    true = 0.02 * np.arange(1500)
    angle = np.sin(true) + random.normal(0.0, 3e-4, len(true))
    time = true.copy()
    waits = np.flatnonzero(random.random(len(true)) < 0.01)
    for k in waits[waits < len(true) - 10]:
        time[k : k + 6] = np.maximum(time[k : k + 6], true[k + 6])
    for k in range(1, len(true)):
        time[k] = max(time[k], time[k - 1] + random.uniform(5e-5, 4e-4))
    error = _velocity(time, angle, 2.0 * np.pi) - np.cos(true)
    assert np.max(np.abs(error[100:])) < 0.5  # 20000 where a vague prediction coasts
