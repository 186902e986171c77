# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Readings that are not those of the shaft, next to the same samples without them."""

import math

import numpy as np
import pytest
from observer_cases import label, make, stamps, variants

from estimator_pkg.estimate import VALID

RATE, COUNTS = 1000.0, 4096
EACH = [  # `edge_adaptive` has rules of its own
    each for each in variants() if each[0] != 'edge_adaptive' and each[1].get('form') != 'paper'
]


def motion(kind):
    """Return angle [rad] and velocity [rad/s] of eight seconds."""
    t = np.arange(8000) / RATE
    if kind == 'sine':
        return 4.0 * np.sin(5.0 * t), 20.0 * np.cos(5.0 * t)
    if kind == 'rest':
        return np.full(len(t), 0.3), np.zeros(len(t))
    velocity = 20.0 * np.clip(5.0 * np.abs((0.5 * t + 0.25) % 1.0 - 0.5) - 0.75, 0.0, 1.0)
    return np.cumsum(velocity) / RATE, velocity


def read(angle):
    step = 2.0 * math.pi / COUNTS
    return np.round((angle + math.pi) % (2.0 * math.pi) / step) % COUNTS * step - math.pi


def glitches(angle, random):
    angle[random.integers(1000, len(angle), 15)] += random.choice([-1.0, 1.0], 15) * 0.4


def zeros(angle, random):
    angle[random.integers(1000, len(angle), 15)] = -1.0


def flips(angle, random):
    for first in range(1200, len(angle), 500):
        angle[first : first + int(random.integers(1, 21))] += math.pi


def error(variant, angle, velocity):
    out = make(variant[0], variant[1]).run(stamps(len(angle), 1.0 / RATE), read(angle))
    scored = np.isin(out.status, VALID)
    scored[:1000] = False
    assert scored[1000:].mean() > 0.95
    off = (out.velocity - velocity)[scored]
    sigma = out.velocity_stddev[scored]
    assert np.all(np.abs(off) < 10.0 * np.maximum(sigma, 0.05))
    return math.sqrt(np.mean(off * off))


@pytest.mark.parametrize('kind', ['sine', 'starts and stops', 'rest'])
@pytest.mark.parametrize('fault', [glitches, zeros, flips])
@pytest.mark.parametrize('variant', EACH, ids=label)
def test_wrong_readings_cost_less_than_a_third(variant, fault, kind):
    """A glitch of 0.4 rad made 20 to 106 rad/s, 500 to 1,400 standard deviations; flips 340."""
    angle, velocity = motion(kind)
    wrong = angle.copy()
    fault(wrong, np.random.default_rng(4))
    assert error(variant, wrong, velocity) <= 1.3 * error(variant, angle, velocity) + 1e-6


@pytest.mark.parametrize('variant', EACH, ids=label)
def test_a_wrong_reading_that_repeats_is_not_believed_while_the_joint_moves(variant):
    t = np.arange(8000) / RATE
    angle, velocity = 8.0 * t, np.full(len(t), 8.0)
    wrong = angle.copy()
    for first in range(1200, len(angle), 500):
        wrong[first : first + 5] = -1.0
    assert error(variant, wrong, velocity) <= 1.3 * error(variant, angle, velocity) + 0.05


@pytest.mark.parametrize('speed', [0.0, 30.0, -80.0])
@pytest.mark.parametrize('after', [0.0, -0.8])
@pytest.mark.parametrize('variant', EACH, ids=label)
def test_an_impact_is_believed_at_once(variant, speed, after):
    """A joint is stopped, thrown back, or thrown from rest to 25 rad/s, within a sample."""
    until = np.arange(2000) / RATE
    velocity = np.where(until < 1.0, speed, after * speed if speed else 25.0)
    angle = np.cumsum(velocity) / RATE
    at = stamps(len(angle), 1.0 / RATE)
    joint = make(variant[0], variant[1])
    for stamp, reading in zip(at[:1001].tolist(), read(angle).tolist()):
        joint.update(stamp, reading)
    assert joint.channel.track.state.doubt.far == 0


@pytest.mark.parametrize('name', ['kalman', 'hybrid_angle', 'pll', 'super_twisting'])
def test_a_sensor_that_slips_is_followed(name):
    """What is read twice is believed."""
    angle, velocity = motion('sine')
    angle[4000:] += 0.6
    out = make(name).run(stamps(len(angle), 1.0 / RATE), read(angle))
    off = (out.position - read(angle) + math.pi) % (2.0 * math.pi) - math.pi
    assert np.abs(off[5000:]).max() < 0.02
    assert np.abs(out.velocity - velocity)[5000:].max() < 2.0
