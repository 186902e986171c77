# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Super-twisting differentiators: the vectors and tables of the spec, rest, cold start."""

import math
import re

import numpy as np
import pytest
from observer_cases import make as joint_of
from observer_cases import stamps, wrapped

from estimator_pkg.circle import Circle
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import TRACKING
from estimator_pkg.observers.angle.super_twisting import Gains, SuperTwisting, predict

BOUND = {1: 25.0, 2: 150.0, 3: 1000.0}  # of the test signal's acceleration, jerk, snap


def signal(t):
    """The angle of the test signal [rad]."""
    return 0.8 * np.sin(math.pi * t) + 0.2 * np.sin(2.6 * math.pi * t)


def predictions(form, order, dt, measured):
    """The velocity before each sample is used, started at rest at the first one."""
    gains = Gains(order=order, form=form, bound=BOUND[order])
    design, coefficients = SuperTwisting.design(gains, Circle(0.0)), SuperTwisting.Coefficients()
    SuperTwisting.prepare(coefficients, design, dt)
    # one step before the first sample, at rest on it, so that the prediction is the start itself
    core, before = SuperTwisting.Core(), SuperTwisting.Core()
    core.position, core.ticks = float(measured[0]), 1
    v = []
    for reading in measured.tolist():
        before.take(core)
        SuperTwisting.correct(core, coefficients, design, reading)
        predict(before, design, dt)
        v.append(before.velocity)
    return v


VECTORS = [  # form, order, values of z1 after samples 1, 2, 3, 10, 100, 1000
    ('explicit', 1, (0, 0.0275, 0.055, 0.2475, 2.7225, -2.9975)),
    ('matching', 1, (0, 0.0259446, 0.0523025, 0.2396536, 2.6806321, -2.9929272)),
    ('matching', 2, (0, 0.0094631, 0.0214496, 0.1419374, 3.244337, -3.0182613)),
    ('matching', 3, (0, 0.0083294, 0.0200768, 0.1585548, 4.3688868, -3.0215016)),
]


@pytest.mark.long
@pytest.mark.parametrize('form, order, expected', VECTORS)
def test_vectors(form, order, expected):
    v = predictions(form, order, 1e-3, signal(np.arange(0, 1100) * 1e-3))
    for sample, value in zip((1, 2, 3, 10, 100, 1000), expected):
        tolerance = 1e-6 if sample <= 10 else 1e-3 * max(1.0, abs(value))
        assert v[sample] == pytest.approx(value, abs=tolerance), sample


@pytest.mark.parametrize('order', [1, 2, 3])
def test_cold_start_on_a_wrapped_angle_locks(order):
    bound, quantum = {1: 500.0, 2: 5000.0, 3: 1e5}[order], 2.0 * math.pi / 4096
    joint = Joint(SuperTwisting, Gains(order=order, bound=bound, quantum=quantum), JointSettings())
    for k in range(2000):
        angle = math.floor((1.0 + 200.0 * 1e-3 * k) / quantum) * quantum
        joint.update(10**18 + k * 10**6, math.remainder(angle, 2.0 * math.pi))
        if k >= 500:
            _, velocity, _, status = joint.estimate()
            assert abs(velocity - 200.0) < 2.0
            assert status == TRACKING


@pytest.mark.long
def test_noise_gain_is_that_of_the_equivalent_linear_filter():
    """White noise on a still shaft: the predicted deviation is right within a factor of 1.5."""
    random = np.random.default_rng(3)
    for order in (1, 2, 3):
        joint = Joint(
            SuperTwisting, Gains(order=order, noise=1e-3, bound=BOUND[order]), JointSettings()
        )
        found = []
        for k in range(20000):
            joint.update(10**18 + k * 10**6, 1e-3 * random.standard_normal())
            if k > 5000:
                found.append(joint.estimate()[1])
        predicted = joint.stddev()[1]
        assert 0.67 < predicted / np.std(found) < 1.5


def test_the_explicit_form_is_refused_where_it_chatters_over_much_of_a_turn():
    """L dt^3 = 5 rad at 10 Hz: it estimated hundreds of rad/s, and at times said tracking."""
    limits = joint_of('super_twisting', {'form': 'explicit'}).limit
    assert re.search(r"'matching' does not chatter", limits(0.1))
    assert limits(0.05) is None and limits(0.06) is not None
    assert joint_of('super_twisting', {'form': 'explicit', 'bound': 1.0}).limit(0.1) is None
    assert joint_of('super_twisting', {}).limit(10.0) is None
    assert joint_of('super_twisting', {'form': 'explicit'}, wrap_period=0.0).limit(0.1) is None


@pytest.mark.parametrize('outlier', [0.0, 1.0, 3.0])
def test_interval_covers_after_a_large_transient(outlier):
    """From 150 ms after single readings that are off by this much [rad], every 500 ms."""
    count, quantum = 12_000, 2.0 * math.pi / 4096.0
    time = np.arange(count) * 1e-3
    read = np.sin(math.pi * time) + np.random.default_rng(1).normal(0.0, quantum, count)
    read[1000::500] += outlier
    out = joint_of('super_twisting').run(stamps(count), wrapped(np.rint(read / quantum) * quantum))
    number = np.arange(count)
    later = (number > 1000) & ((number - 1000) % 500 > 150)
    error = np.abs(out.velocity - math.pi * np.cos(math.pi * time))[later]
    assert 0.92 <= np.mean(error < 1.96 * out.velocity_stddev[later]) <= 0.97
