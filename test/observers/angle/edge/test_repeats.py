# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Readings that repeat now and then: a sensor with a clock of its own, and one that pauses."""

from __future__ import annotations

import numpy as np
import pytest

from estimator_pkg.evaluation.entries import Entry

START = 1_700_000_000_000_000_000
PERIOD = 1e-3  # of the sensor [s]


def _estimate(time: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (velocity, its standard deviation) of a joint at its defaults."""
    joint = Entry('edge', 'edge_adaptive').joint(wrap_period=0.0)
    out = joint.run(START + np.rint(time * 1e9).astype(np.int64), angle)
    return out.velocity, out.velocity_stddev


def _motion(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 0.5 * np.sin(2.0 * time), np.cos(2.0 * time)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values * values)))


def test_a_sensor_with_another_clock_is_noise_of_one_sample_of_age() -> None:
    """A host reads every 0.8 to 1.25 ms what a sensor takes every millisecond, with pauses."""
    random = np.random.default_rng(2)
    pace = 1e-3 * (1.0 + 0.15 * np.sin(np.arange(4000) / 90.0))
    time = np.cumsum(pace + random.uniform(-1e-4, 1e-4, len(pace)))
    taken = np.floor(time / PERIOD) * PERIOD
    angle = np.round(_motion(taken)[0], 6)
    for first in range(300, len(angle) - 10, 170):
        angle[first : first + 3] = angle[first - 1]
    assert 0.02 < np.mean(np.diff(angle) == 0.0) < 0.2
    velocity, _ = _estimate(time, angle)
    later = time > 1.0
    assert _rms((velocity - _motion(time)[1])[later]) < 0.04  # 0.22 if repeats were readings


@pytest.mark.xfail(strict=True, reason='the clock takes the readings for even: 0.029 rad/s')
def test_readings_of_another_clock_are_up_to_a_sample_old() -> None:
    """A host reads every 0.8 to 1.2 ms what a sensor takes every 1.03 ms."""
    time = np.cumsum(np.random.default_rng(3).uniform(0.8e-3, 1.2e-3, 6000))
    taken = np.floor(time / 1.03e-3) * 1.03e-3
    angle = np.round(_motion(taken)[0], 6)
    velocity, _ = _estimate(time, angle)
    later = time > 1.0
    assert _rms((velocity - _motion(time)[1])[later]) < 0.008  # 0.016 without the noise of the age


@pytest.mark.parametrize('pause', [1, 4, 8])
def test_pauses_of_a_sensor_that_then_catches_up_are_bridged(pause: int) -> None:
    time = np.arange(4000) * PERIOD
    angle = np.round(_motion(time)[0], 6)
    clean, _ = _estimate(time, angle)
    for first in range(200, len(angle) - 20, 150):
        length = min(pause, 1 + first // 300)  # it learns how long they last
        angle[first : first + length] = angle[first - 1]
    velocity, _ = _estimate(time, angle)
    true = _motion(time)[1]
    later = (time > 1.0) & (np.abs(true) > 0.2)
    assert _rms((velocity - true)[later]) < 3.0 * _rms((clean - true)[later]) + 1e-3
    assert np.max(np.abs(velocity - true)[later]) < 0.05


def test_a_joint_that_stops_at_once_is_seen_to_stop() -> None:
    time = np.arange(1500) * PERIOD
    angle = np.round(np.minimum(2.0 * time, 2.0), 6)
    velocity, stddev = _estimate(time, angle)
    moving, stopped = (time > 0.5) & (time < 1.0), time > 1.03
    assert _rms(velocity[moving] - 2.0) < 0.01
    assert np.max(np.abs(velocity[stopped])) < 0.1
    assert np.all(np.isfinite(stddev[stopped]))


def test_equal_readings_at_a_turning_point_are_readings() -> None:
    """A sine that is sampled symmetrically about its peaks repeats a reading at each."""
    time = (np.arange(2000) + 0.5) * 0.01
    angle = np.round(0.5 * np.cos(2.0 * np.pi * 0.5 * time), 9)
    repeated = np.flatnonzero(np.diff(angle) == 0.0)
    assert len(repeated) > 10
    velocity, _ = _estimate(time, angle)
    true = -np.pi * 0.5 * np.sin(2.0 * np.pi * 0.5 * time)
    later = time > 2.0
    assert np.max(np.abs(velocity - true)[later]) < 0.02
