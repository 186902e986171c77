# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Readings in doubt: the speed is held, and the next reading that differs decides."""

import numpy as np
import pytest
from edge_encoder import QUANTUM, rms
from observer_cases import make, stamps, wrapped

from estimator_pkg.estimate import COASTING, TRACKING

RATE = 1000.0
TIME = np.arange(8000) / RATE
VELOCITY = 6.0 * np.cos(4.4 * TIME)


def swing(noise, seed):
    """Readings of a swing: counts, or with noise [rad] as floats."""
    angle = 6.0 / 4.4 * np.sin(4.4 * TIME)
    if noise > 0.0:
        return angle + np.random.default_rng(seed).normal(0.0, noise, len(angle))
    return np.floor(angle / QUANTUM) * QUANTUM


def wrong_readings(kind, random):
    """Return a function of readings that spoils them."""
    at = 1000 + np.flatnonzero(random.random(len(TIME) - 1010) < 0.003)

    def spoil(reading):
        spoilt = reading.copy()
        for k in at:
            if kind == 'glitch':
                spoilt[k] += random.uniform(-3.0, 3.0)
            elif kind == 'small glitch':
                spoilt[k] += random.uniform(-0.3, 0.3)
            elif kind == 'zero':
                spoilt[k] = 0.0
            elif kind == 'zeros in a row':
                spoilt[k : k + 4] = 0.0
            elif kind == 'half a turn':
                spoilt[k] += np.pi
        return spoilt

    return spoil


@pytest.mark.parametrize('noise', [0.0, 1e-3])
@pytest.mark.parametrize(
    'kind', ['glitch', 'small glitch', 'zero', 'zeros in a row', 'half a turn']
)
def test_wrong_readings_cost_little_however_many_follow_each_other(kind, noise):
    random = np.random.default_rng(7)
    reading = swing(noise, 3)
    errors = []
    for each in (reading, wrong_readings(kind, random)(reading)):
        out = make('edge_adaptive').run(stamps(len(TIME), 1.0 / RATE), wrapped(each))
        errors.append(rms((out.velocity - VELOCITY)[500:]))
    # 20 to 3,000 times where two may look like a manoeuvre
    assert errors[1] < (1.3 if noise > 0.0 else 4.0) * errors[0]


def test_a_slip_shifts_the_angle_and_leaves_the_speed():
    """A sample that the sensor holds, or leaves out, or another index: the speed is the same."""
    for shift in (-0.02, 0.02, 0.8, 2.5):
        angle = 4.0 * TIME
        angle[4000:] += shift
        out = make('edge_adaptive', {'quantum': QUANTUM}).run(
            stamps(len(TIME), 1.0 / RATE), wrapped(np.floor(angle / QUANTUM) * QUANTUM)
        )
        assert out.status[4000] == COASTING and out.status[4020] == TRACKING
        assert np.max(np.abs(out.velocity[4000:] - 4.0)) < QUANTUM * RATE, shift
        assert np.max(np.abs(wrapped(out.position - angle))[4001:]) < 2.0 * QUANTUM


def test_after_a_blow_the_second_reading_has_the_new_speed():
    velocity = np.where(TIME < 4.0, 8.0, -9.0)
    angle = np.cumsum(velocity) / RATE
    out = make('edge_adaptive', {'quantum': QUANTUM}).run(
        stamps(len(TIME), 1.0 / RATE), wrapped(np.floor(angle / QUANTUM) * QUANTUM)
    )
    assert abs(out.velocity[4000] - 8.0) < 0.1  # held
    assert np.max(np.abs(out.velocity[4001:] + 9.0)) < 2.0 * QUANTUM * RATE


def test_a_stop_is_no_reading_that_repeats():
    angle = 8.0 * np.minimum(TIME, 4.0003)
    out = make('edge_adaptive', {'quantum': QUANTUM}).run(
        stamps(len(TIME), 1.0 / RATE), wrapped(np.floor(angle / QUANTUM) * QUANTUM)
    )
    assert np.max(np.abs(out.velocity[4010:])) < 0.5
    assert np.max(np.abs(out.velocity[4100:])) < 0.02


def test_the_speed_is_held_and_not_the_acceleration():
    reading = swing(0.0, 3)
    at = 1000 + np.argmax(np.abs(np.diff(VELOCITY))[1000:])
    reading[at] += 1.0
    out = make('edge_adaptive').run(stamps(len(TIME), 1.0 / RATE), wrapped(reading))
    assert out.status[at] == COASTING
    assert abs(out.velocity[at] - out.velocity[at - 1]) < 1e-3  # the motion changes it by 0.026


def test_flips_of_several_samples_are_slips_and_no_noise():
    """At 100 Hz: 600 times the error where their third differences were taken for noise."""
    t = np.arange(2000) / 100.0
    w = 1.4 * np.pi
    clean = np.floor(6.0 / w * np.sin(w * t) / QUANTUM) * QUANTUM
    flipped = clean.copy()
    random = np.random.default_rng(1)
    for first in range(100, 1950, 50):
        flipped[first : first + random.integers(1, 20)] += np.pi
    errors = [
        rms(
            (
                make('edge_adaptive').run(stamps(len(t), 0.01), wrapped(each)).velocity
                - 6.0 * np.cos(w * t)
            )[50:]
        )
        for each in (clean, flipped)
    ]
    assert errors[1] < 4.0 * errors[0]
