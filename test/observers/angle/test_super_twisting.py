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
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import TRACKING
from estimator_pkg.observers.angle.super_twisting import gains as tables
from estimator_pkg.observers.angle.super_twisting import observer as super_twisting
from estimator_pkg.observers.angle.super_twisting.observer import (
    OBSERVER,
    Chain,
    Coefficients,
    Core,
    Gains,
)

BOUND = {1: 25.0, 2: 150.0, 3: 1000.0}  # of the test signal's acceleration, jerk, snap


def signal(t):
    """The test signal: position, velocity, acceleration."""
    w, u = math.pi, 2.6 * math.pi
    return (
        0.8 * np.sin(w * t) + 0.2 * np.sin(u * t),
        0.8 * w * np.cos(w * t) + 0.2 * u * np.cos(u * t),
        -0.8 * w * w * np.sin(w * t) - 0.2 * u * u * np.sin(u * t),
    )


def predictions(form, order, dt, measured, bound=None):
    """Velocity and acceleration before each sample is used, started at rest at the first one.

    (The implicit form is judged after the sample, as its table is.)
    """
    gains = Gains(order=order, form=form, bound=bound or BOUND[order])
    design, coefficients = super_twisting.design(gains, Circle(0.0)), Coefficients()
    super_twisting.prepare(coefficients, design, dt)
    # one step before the first sample, at rest on it, so that the prediction is the start itself
    core, before = Core(), Chain()
    core.chain.x, core.ticks = float(measured[0]), 1
    v, a = np.zeros((2, len(measured)))
    for k, reading in enumerate(np.asarray(measured).tolist()):
        before.take(core.chain)
        super_twisting.correct(core, coefficients, design, reading)
        if form == 'implicit':
            v[k], a[k] = core.chain.v, core.chain.a
        else:
            if form != 'explicit':
                super_twisting.advance(before, dt)
            else:
                before.v, before.a = before.v + dt * before.a, before.a + dt * before.j
            v[k], a[k] = before.v, before.a
    return v, a


VECTORS = [  # form, order, values of z1 after samples 1, 2, 3, 10, 100, 1000
    ('explicit', 1, (0, 0.0275, 0.055, 0.2475, 2.7225, -2.9975)),
    ('implicit', 1, (0.0275, 0.055, 0.0825, 0.275, 2.75, -3.011738)),
    ('matching', 1, (0, 0.0259446, 0.0523025, 0.2396536, 2.6806321, -2.9929272)),
    ('taylor', 2, (0, 0.0096155, 0.0217601, 0.1434586, 3.2687512, -3.0185383)),
    ('matching', 2, (0, 0.0094631, 0.0214496, 0.1419374, 3.244337, -3.0182613)),
    ('taylor', 3, (0, 0.0084714, 0.0203895, 0.1604622, 4.4032246, -3.0191024)),
    ('matching', 3, (0, 0.0083294, 0.0200768, 0.1585548, 4.3688868, -3.0215016)),
]


@pytest.mark.long
@pytest.mark.parametrize('form, order, expected', VECTORS)
def test_vectors(form, order, expected):
    measured = signal(np.arange(0, 1100) * 1e-3)[0]
    v, _ = predictions(form, order, 1e-3, measured)
    for sample, value in zip((1, 2, 3, 10, 100, 1000), expected):
        tolerance = 1e-6 if sample <= 10 else 1e-3 * max(1.0, abs(value))
        assert v[sample] == pytest.approx(value, abs=tolerance), sample


@pytest.mark.parametrize('order', [1, 2, 3])
@pytest.mark.parametrize('form', ['matching', 'taylor', 'implicit'])
def test_cold_start_on_a_wrapped_angle_locks(form, order):
    if form == 'implicit' and order != 1:
        with pytest.raises(UsageError, match='order 1 only'):
            super_twisting.design(Gains(order=order, form=form), Circle())
        return
    bound = {1: 500.0, 2: 5000.0, 3: 1e5}[order]
    joint = Joint(
        OBSERVER,
        Gains(order=order, form=form, bound=bound, quantum=2 * math.pi / 4096),
        JointSettings(),
    )
    quantum = 2.0 * math.pi / 4096
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
        joint = Joint(OBSERVER, Gains(order=order, noise=1e-3, bound=BOUND[order]), JointSettings())
        found = []
        for k in range(20000):
            joint.update(10**18 + k * 10**6, 1e-3 * random.standard_normal())
            if k > 5000:
                found.append(joint.estimate()[1])
        predicted = joint.stddev()[1]
        assert 0.67 < predicted / np.std(found) < 1.5


@pytest.mark.parametrize('form', ['taylor', 'explicit'])
def test_an_explicit_form_is_refused_where_it_chatters_over_much_of_a_turn(form):
    """L dt^3 = 5 rad at 10 Hz: it estimated hundreds of rad/s, and at times said tracking."""
    limits = joint_of('super_twisting', {'form': form}).limit
    assert re.search(r"'matching' does not chatter", limits(0.1))
    assert limits(0.05) is None and limits(0.06) is not None
    assert joint_of('super_twisting', {'form': form, 'bound': 1.0}).limit(0.1) is None
    assert joint_of('super_twisting', {}).limit(10.0) is None
    assert joint_of('super_twisting', {'form': form}, wrap_period=0.0).limit(0.1) is None


@pytest.mark.parametrize('bound', [3.0, 300.0, 1e5])
def test_the_deviation_of_the_implicit_form_is_its_scatter(bound):
    """From nearly linear to sliding at every sample, where it is the backward difference."""
    tables.implicit_table.cache_clear()  # or another test may have made it
    joint = joint_of(
        'super_twisting',
        {'form': 'implicit', 'order': 1, 'bound': bound, 'noise': 2e-3, 'low_speed_bound': False},
    )
    random, errors, told = np.random.default_rng(4), [], []
    for i in range(12_000):
        joint.update(
            10**9 + i * 10**6, math.remainder(5e-3 * i + random.normal(0.0, 2e-3), 2.0 * math.pi)
        )
        if i > 6000:
            errors.append(joint.estimate()[1] - 5.0)
            told.append(joint.stddev()[1])
    assert np.std(errors) == pytest.approx(np.mean(told), rel=0.12)


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
