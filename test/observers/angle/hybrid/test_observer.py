# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid observer: Algorithm 1, the robust form, their gains, limits, noise and streams."""

import math

import numpy as np
import pytest
from angle_runs import MARGIN, PHI, TURN, Inner, make, stamps, wrapped

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.hybrid import injections
from estimator_pkg.observers.angle.hybrid.observer import HybridAngle, design_of

# --- the parameters ---------------------------------------------------------------------------


def test_epsilon_follows_from_the_bandwidth_and_goes_before_it():
    # the spec: epsilon 0.1 s has its -3 dB frequency at 9.635 rad/s
    assert design_of(HybridAngle.gains(order=2, epsilon=0.1)).bandwidth_hz == pytest.approx(
        9.635 / TURN, rel=1e-4
    )
    by_width = design_of(HybridAngle.gains(order=2, bandwidth_hz=9.635 / TURN))
    assert by_width.epsilon == pytest.approx(0.1, rel=1e-4)
    assert design_of(HybridAngle.gains(epsilon=0.02, bandwidth_hz=7.0)).epsilon == 0.02


@pytest.mark.parametrize(
    'gains, reason',
    [
        ({'form': 'paper', 'order': 3}, "form 'paper' is of second order"),
        ({'order': 2, 'k3': 1.0}, "'k3' belongs to order 3"),
        ({'k1': 1.0, 'k2': 1.0, 'k3': 2.0}, 'k1 k2 = 1 must exceed k3 = 2'),
        ({'form': 'paper', 'max_speed': 3.0}, 'no speed limit'),
        ({'order': 4}, r'outside \[2, 3\]'),
        ({'injection': 'cos'}, "'cos' is not one of sin, tan, saw, sat"),
    ],
)
def test_contradictions_are_refused_in_one_line(gains, reason):
    with pytest.raises(UsageError, match=reason) as refused:
        make(**gains)
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize('gains', [{'injection': 'sin'}, {'injection': 'tan'}, {'form': 'paper'}])
def test_what_needs_a_circle_is_refused_without_one(gains):
    with pytest.raises(UsageError, match='needs a circle, and wrap_period is 0'):
        make(period=0.0, **gains)


def test_order_follows_the_form_where_it_is_unset():
    assert HybridAngle.gives_acceleration(HybridAngle.gains())
    assert not HybridAngle.gives_acceleration(HybridAngle.gains(order=2))
    assert not HybridAngle.gives_acceleration(HybridAngle.gains(form='paper'))


# --- form: paper ------------------------------------------------------------------------------


def algorithm_1(position, velocity, y, dt, l1, l2, phi):
    """Algorithm 1 once more, line by line from the paper."""
    p = position + dt * velocity
    f = phi(y - p)
    position, velocity = p + dt * l1 * f, velocity + dt * l2 * f
    if abs(abs(y - position) - math.pi) <= MARGIN:
        position = y
    if abs(position) >= math.pi + MARGIN:
        position -= TURN * math.copysign(1.0, position)
    return position, velocity


@pytest.mark.long
@pytest.mark.parametrize('name', injections.INJECTIONS)
def test_algorithm_1_is_the_papers(name):
    ours = Inner(0.01, form='paper', injection=name, epsilon=0.1)
    random = np.random.default_rng(2)
    resets, wraps, pairs = 0, 0, []
    for _ in range(20_000):
        position, y = random.uniform(-math.pi - MARGIN, math.pi + MARGIN, 2)
        velocity, l1 = random.uniform(-200.0, 200.0), random.uniform(1.0, 60.0)
        ours.design.l1, ours.design.l2 = l1, 500.0
        ours.core.position, ours.core.velocity = position, velocity
        y = wrapped(y).item()
        expected = algorithm_1(position, velocity, y, 0.01, l1, 500.0, PHI[name])
        ours.correct(y)
        got = ours.core.position, ours.core.velocity
        resets += expected[0] == y
        wraps += abs(position + 0.01 * velocity - expected[0]) > 4.0
        pairs.append((*got[:2], *expected))
    found, wanted = np.split(np.array(pairs), 2, axis=1)
    assert np.all(np.abs(found - wanted) <= 1e-12 * np.maximum(1.0, np.abs(wanted)))
    assert wraps > 100 and (resets > 10 or name == 'saw')  # the jumps were met


def test_the_joint_runs_algorithm_1_on_every_sample():
    joint = make(form='paper', epsilon=0.1)
    y = wrapped(1.0 + 20.0 * 0.01 * np.arange(500) + 0.2 * np.sin(np.arange(500)))
    out = joint.run(stamps(0.01 * np.arange(500)), y % TURN)  # read in [0, 2 pi)
    state = (y[0], 0.0)
    for k in range(1, 500):
        state = algorithm_1(*state, y[k], 0.01, 60.0, 500.0, PHI['saw'])
        assert out.velocity[k] == pytest.approx(state[1], rel=1e-7, abs=1e-7)


@pytest.mark.parametrize('k1, k2', [(6.0, 5.0), (5.0, 6.0), (1.0, 1.0), (2.0, 10.0)])
def test_the_stability_limit_is_where_a_pole_leaves_the_unit_circle(k1, k2):
    limit = make(form='paper', epsilon=0.1, k1=k1, k2=k2).longest_dt / 0.1
    for r, stable in ((0.999 * limit, True), (1.001 * limit, False)):
        alpha, beta = k1 * r, k2 * r * r
        poles = np.roots((1.0, alpha + beta - 2.0, 1.0 - alpha))
        assert (np.max(np.abs(poles)) < 1.0) == stable


def test_the_limit_is_told_in_numbers():
    told = make(form='paper', epsilon=0.02).limit(0.01)
    assert 'unstable at 100 Hz' in told
    assert '0.0337' in told  # epsilon > 3.371 T
    assert make(form='paper', epsilon=0.034).limit(0.01) is None
    bandwidth = float(told.rpartition(' ')[2].rstrip(')'))
    assert make(form='paper', bandwidth_hz=0.999 * bandwidth).limit(0.01) is None
    assert make(form='paper', bandwidth_hz=1.001 * bandwidth).limit(0.01) is not None
