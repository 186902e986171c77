# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Readings that count turns are found, and are followed as without a circle."""

import math

import numpy as np
import pytest
from observer_cases import label, make, variants, wrapped

from estimator_pkg.estimate import TRACKING
from estimator_pkg.sensor.turns import CONFIRMED_TURNS

TURN = 2.0 * math.pi
QUANTUM = TURN / 4096
COUNT = 1500


def motor(seed=1, counter=math.inf, jitter=0.002, fastest=75.0):
    """A motor at 50 Hz that turns at 40 rad/s or at its fastest and stops at once, over and over.

    Return (stamps, readings, velocity). The reading wraps after `counter` turns.
    """
    random = np.random.default_rng(seed)
    time = 0.02 * np.arange(COUNT) + random.uniform(0.0, jitter, COUNT)
    velocity = np.where(time % 2.0 < 1.0, 0.0, random.choice([40.0, fastest], COUNT // 100)[
        (time // 2.0).astype(int)
    ])  # fmt: skip
    angle = np.concatenate(([0.0], np.cumsum(velocity[1:] * np.diff(time))))
    if counter < math.inf:
        angle = (angle + 0.5 * counter * TURN) % (counter * TURN) - 0.5 * counter * TURN
    stamps = 1_700_000_000_000_000_000 + np.rint(1e9 * time).astype(np.int64)
    return stamps, np.rint(angle / QUANTUM) * QUANTUM, velocity


def rms(out, velocity, rows=slice(200, None)):
    error = np.where(out.status == TRACKING, out.velocity - velocity, 0.0)[rows]
    return math.sqrt(np.nanmean(error * error))


SAME = ('edge_adaptive', 'pll', 'finite_difference')


@pytest.mark.parametrize(
    ('name', 'jitter', 'fastest'),
    [
        *((name, 0.002, 75.0) for name in (*SAME, 'kalman')),
        # kalman remembers the noise that it saw on the circle
        *((name, 0.0, 200.0) for name in SAME),
    ],
)
def test_a_counter_of_turns_costs_what_it_costs_without_a_circle(name, jitter, fastest):
    """edge_adaptive went on at 75 rad/s for 0.25 s after each stop: 16 times the error."""
    stamps, readings, velocity = motor(jitter=jitter, fastest=fastest)
    found, told = (
        make(name, {}, wrap_period=period).run(stamps, readings) for period in (TURN, 0.0)
    )
    assert rms(found, velocity) < 1.01 * rms(told, velocity)
    assert found.position[-500:] == pytest.approx(told.position[-500:], abs=1e-3)


@pytest.mark.parametrize('turns', [3, 16, 50])
@pytest.mark.parametrize('name', ['edge_adaptive', 'kalman', 'pll'])
def test_a_counter_that_begins_anew_is_no_motion(name, turns):
    stamps, readings, velocity = motor(2, turns)
    assert np.max(np.abs(np.diff(readings))) > (turns - 1) * TURN
    out = make(name, {}).run(stamps, readings)
    assert np.nanmax(np.abs(out.velocity)) < 250.0


@pytest.mark.parametrize('variant', variants(), ids=label)
def test_readings_that_wrap_are_never_taken_for_turns(variant):
    name, gains = variant
    stamps, readings, _ = motor(3)
    readings = wrapped(readings)
    random = np.random.default_rng(3)
    wrong = random.random(COUNT) < 0.02
    readings[wrong] = random.uniform(-20.0, 20.0, wrong.sum())  # alone, or two in a row
    joint = make(name, gains)
    joint.run(stamps, readings)
    assert joint.channel.limits.period == TURN
    if joint.module.TURNS:  # not even for a while: a wrap would have mended it
        assert not joint.channel.turns.counts


def test_a_burst_of_outliers_is_mended_at_the_next_wrap():
    stamps, angle, velocity = motor(4)
    readings = wrapped(angle)
    readings[100 : 100 + 2 * CONFIRMED_TURNS] = 20.0
    joint = make('edge_adaptive', {})
    joint.run(stamps[:140], readings[:140])
    assert joint.channel.limits.period == 0.0
    out = joint.run(stamps[140:], readings[140:])
    assert joint.channel.limits.period == TURN
    assert np.nanmax(np.abs(out.velocity)) < 250.0


def test_a_reset_looks_anew_and_what_needs_a_circle_keeps_it():
    stamps, readings, _ = motor()
    joint = make('edge_adaptive', {})
    joint.run(stamps, readings)
    assert joint.channel.limits.period == 0.0
    joint.reset()
    assert joint.channel.limits.period == TURN and not joint.channel.turns.counts
    for name in ('hybrid_angle', 'super_twisting', 'kalman'):
        joint = make(name, {}, unwrap=name == 'kalman')
        joint.run(stamps, readings)
        assert joint.channel.limits.period == TURN
