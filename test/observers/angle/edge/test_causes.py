# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Motions that were followed badly: holes, lasting ramps, readings that are not believed."""

import math

import numpy as np
import pytest
from edge_encoder import read, rms
from observer_cases import make, stamps

TURN = 2.0 * math.pi


def holes(rate, velocity):
    """(stamps, angle, velocity) at `rate` [Hz], with a hole of 0.25 to 0.45 s in each second."""
    fine = np.linspace(0.0, 20.0, 400_001)
    way = np.concatenate(([0.0], np.cumsum(velocity(fine)[1:]) * (fine[1] - fine[0])))
    time = (np.arange(round(20.0 * rate)) + 0.37) / rate
    time = time[(time < 1.0) | (time % 1.0 > 0.25 + 0.2 * (np.floor(time) % 3) / 2.0)]
    at = stamps(1)[0] + np.rint(time * 1e9).astype(np.int64)
    return at, np.interp(time, fine, way), velocity(time)


@pytest.mark.parametrize(
    'velocity, most',
    [
        (lambda t: 5.5 * np.sign(np.sin(math.pi * (t - 0.15))), 0.7),  # kept speed: 1.4
        (lambda t: 4.0 * np.sin(2.0 * t), 0.06),  # 0.17
        (lambda t: 1.5 + 0.3 * np.sin(1.1 * t), 0.01),  # a pose that turns steadily: 0.014
    ],
)
def test_a_hole_shows_how_far_the_joint_moved(velocity, most):
    at, angle, true = holes(200.0, velocity)
    out = make('edge_adaptive').run(at, read(angle))
    assert rms((out.velocity - true)[100:]) < most


@pytest.mark.parametrize('acceleration', [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize('rate', [200.0, 1000.0])
def test_an_acceleration_that_lasts_does_not_fade(acceleration, rate):
    """It lagged by 0.03 times the acceleration for ever, at up to 15 standard deviations."""
    time = np.arange(round(4.0 * rate)) / rate
    moved = np.clip(time - 0.5, 0.0, None)
    out = make('edge_adaptive').run(
        stamps(len(time), 1.0 / rate), read(0.5 * acceleration * moved**2 + 0.001, TURN / 2**14)
    )
    error = np.abs(out.velocity - acceleration * moved)[time > 1.2]
    assert error.max() < 0.006 * acceleration
    assert np.max(error / out.velocity_stddev[time > 1.2]) < 5.0


def test_no_acceleration_is_extrapolated_while_a_reading_is_not_believed():
    time = np.arange(2000) * 5e-3
    angle = 0.5 * 30.0 * np.clip(time, 0.0, 0.4023) ** 2  # stops at once, at 12 rad/s
    out = make('edge_adaptive').run(stamps(2000, 5e-3), read(angle))
    stopped = int(np.argmax(time > 0.4023))
    assert np.max(np.abs(out.velocity[stopped : stopped + 2])) <= 12.12


def test_a_start_is_not_in_doubt_by_half_a_turn_per_sample():
    """The deviation was 16 times the largest error or more: 90 rad/s at 1 kHz."""
    time = np.arange(2000) * 1e-3
    moved = np.clip(time - 0.5003, 0.0, None)
    velocity = np.where(moved > 0.0, 3.0 * -np.expm1(-moved / 0.05), 0.0)
    angle = 3.0 * (moved + 0.05 * np.expm1(-moved / 0.05)) + 0.001
    out = make('edge_adaptive', {'quantum': TURN / 4096}).run(stamps(2000), read(angle))
    error = np.abs(out.velocity - velocity)
    first = int(np.argmax(read(angle) != read(angle)[0]))
    assert np.all(error[first:] <= 5.0 * out.velocity_stddev[first:])
    assert out.velocity_stddev[first:].max() < 30.0
