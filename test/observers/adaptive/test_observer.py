# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The adaptive observer: the paper's recursion, its sampled form, gate, freezing, bad input."""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from servos import excited, feed, joint, named, servo

from estimator_pkg.circle import Circle
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import COASTING, INITIALISING, NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.adaptive.law import ADAPTING, FROZEN, INIT
from estimator_pkg.observers.adaptive.observer import Adaptive
from estimator_pkg.observers.adaptive.structure import Gains, structure
from estimator_pkg.parameters import build

PAPER = {
    'law': 'gradient',
    'observer_poles': (-10.0, -12.0),
    'model_poles': (-1.5, -2.5),
    'gamma': (1000.0,),
    'settle': 0.0,
    'gate': 'none',
    'knock': 0.0,
}  # example 4.2


@pytest.mark.long
@pytest.mark.parametrize(
    'gains',
    [
        {},
        {'known': ('b1=0',), 'bounds': ('b/J>=0',)},
        {'load': True, 'observer_poles': (-40.0, -40.0)},
    ],
)
def test_parameters_and_velocity_on_jittered_stamps_and_a_wrapped_angle(gains):
    u = excited(12000)
    dt = 1e-3 * np.random.default_rng(2).uniform(0.5, 1.5, len(u))
    load = 3.0 if gains.get('load') else 0.0
    angles, velocity = servo(2.0, 5.0, 30.0, u, dt, load)
    assert np.ptp(angles) > 4.0 * math.pi
    made = joint(**gains, torque_constant=0.6)
    wrapped = (angles + math.pi) % (2.0 * math.pi) - math.pi
    out, _ = feed(made, wrapped, u, dt)
    found = named(made)
    # an angle that bends within a sample costs O(dt^2)
    for name, value in (('b/J', 2.0), ('k/J', 5.0), ('Kv/J', 30.0), ('J', 0.02), ('b', 0.04)):
        assert found[name].value == pytest.approx(value, rel=5e-4)
    if load:
        assert found['load/J'].value == pytest.approx(load, rel=1e-3)
    late = slice(8000, None)
    assert out.status[-1] == TRACKING
    assert np.max(np.abs(out.velocity - velocity)[late]) < 1e-3 * np.std(velocity)
    assert np.max(np.abs(out.position - wrapped)[late]) < 1e-3


@pytest.mark.long
def test_orders_one_and_three():
    u = excited(20000, hold=100)
    for order in (1, 3):
        poles = {1: [-4.0], 3: [-3.0, -5.0, -8.0]}[order]
        a = np.diag(np.ones(order - 1), 1)
        a[:, 0] = -np.poly(poles)[1:]
        b = np.zeros(order)
        b[-1] = 7.0
        e = expm(np.block([[a, b[:, None]], [np.zeros((1, order + 1))]]) * 1e-3)
        x = np.zeros(order)
        angles, speeds = [0.0], [0.0]
        for value in u:
            x = e[:-1, :-1] @ x + e[:-1, -1] * value
            angles.append(x[0])
            speeds.append((a @ x + b * value)[0])
        made = joint(
            0.0,
            order=order,
            model_poles=tuple(-1.0 - i for i in range(order)),
            known=tuple(f'b{i}=0' for i in range(1, order)),
        )
        out, _ = feed(made, np.array(angles), u)
        theta = made.report().theta
        learnt = np.array(made.design.model) + theta[:order]
        assert learnt == pytest.approx(a[:, 0], rel=2e-2)
        assert np.abs(out.velocity - speeds)[15000:].max() < 1e-2 * np.std(speeds)


def rest_with_load(made, seconds):
    """Rests for so long at -0.667 rad under a load."""
    count = round(seconds * 1000)
    noise = np.random.default_rng(777).uniform(-1.0, 1.0, count + 1) * math.sqrt(3.0) * 1e-3
    feed(made, -0.2 / 0.3 + noise, np.zeros(count), start_ns=made.stamp_ns + 10**6)


def trained(**gains):
    """At the true parameters of example 4.2, settled, with the observer's default law."""
    return joint(
        0.0,
        observer_poles=(-10.0, -12.0),
        model_poles=(-1.5, -2.5),
        theta=(3.99, 3.45, 0.0, 0.2),
        **gains,
    )


@pytest.mark.long
@pytest.mark.parametrize('gains', [{}, {'law': 'gradient'}])
@pytest.mark.parametrize('seconds', [30.0, pytest.param(600.0, marks=pytest.mark.slow)])
def test_a_load_held_at_rest_moves_no_parameter_through_the_gate(gains, seconds):
    made = trained(**gains)
    feed(made, np.full(3, -0.2 / 0.3), np.zeros(2))
    rest_with_load(made, seconds)
    assert made.report().phase == 'GATED'
    for value, true in zip(made.state.theta, (3.99, 3.45, 0.0, 0.2)):
        assert value == pytest.approx(true, rel=5e-3)


@pytest.mark.long
def test_without_excitation_nothing_is_presented_as_good():
    made = joint()
    random = np.random.default_rng(1)
    out, _ = feed(made, 1.0 + 1e-4 * random.normal(size=20001), np.zeros(20000))
    said = made.report()
    assert said.phase == 'GATED' and 'excitation' in said.reason
    assert out.status[-1] == NOT_OBSERVABLE
    assert all(math.isinf(item.stddev) for item in said.parameters)
    assert not made.state.theta.any()


@pytest.mark.long
def test_freezing_holds_theta_and_unfreezing_is_bumpless():
    u = excited(30000)
    angles, velocity = servo(2.0, 5.0, 30.0, u, 1e-3)
    made = joint(0.0)
    parts = ((0, 10000, True), (10000, 20000, False), (20000, 30000, True))
    held = None
    for begin, end, adapt in parts:
        made.set_gains(build(Gains, {'adapt': adapt}))
        for k in range(begin, end):
            made.update(10**18 + k * 10**6, float(angles[k]), float(u[k - 1]) if k else 0.0)
            if k == 10000:
                held = made.state.theta
            if k > 10050:
                assert abs(made.estimate()[1] - velocity[k]) < 0.01
        if not adapt:
            assert np.array_equal(made.state.theta, held) and made.state.phase == FROZEN
            assert made.report().reason == "frozen by the user ('adapt' is false)"
    assert made.state.phase == ADAPTING
    assert named(made)['b/J'].value == pytest.approx(2.0, rel=5e-4)


@pytest.mark.long
@pytest.mark.parametrize('ahead', [10**10, -(10**10)])
def test_an_outage_and_a_jump_of_the_clock_keep_parameters_and_no_speed(ahead):
    u = excited(20000)
    angles, velocity = servo(2.0, 5.0, 30.0, u, 1e-3)
    made = joint(0.0)
    feed(made, angles[:15001], u[:15000])
    before, mean_dt = made.state.theta, made.mean_dt
    at = 10**18 + 15000 * 10**6 + ahead
    for k in range(15001, 18000):
        made.update(at + (k - 15000) * 10**6, float(angles[k]), float(u[k - 1]))
        if k == 15001:
            assert abs(made.estimate()[1]) < 0.01 and made.estimate()[3] == INITIALISING
        if k < 15100:
            assert np.array_equal(made.state.theta, before)
    assert made.mean_dt == pytest.approx(mean_dt)
    assert made.estimate()[3] == TRACKING
    assert made.estimate()[1] == pytest.approx(velocity[17999], abs=1e-3 * np.std(velocity))


@pytest.mark.long
def test_a_gap_keeps_parameters_and_speed():
    u = excited(20000)
    angles, velocity = servo(2.0, 5.0, 30.0, u, 1e-3)
    made = joint(0.0)
    feed(made, angles[:15001], u[:15000])
    before = made.state.theta
    at = 10**18 + 15000 * 10**6
    assert made.estimate()[3] == TRACKING
    gap = 4 * 10**8
    made.update(at + gap, float(angles[15001]), float(u[15000]))
    assert made.estimate()[1] == pytest.approx(velocity[15000], abs=0.05 * np.std(velocity))
    assert made.estimate()[3] == COASTING and made.state.phase == INIT
    for k in range(15002, 17000):
        made.update(at + gap + (k - 15001) * 10**6, float(angles[k]), float(u[k - 1]))
        if k < 15100:
            assert np.array_equal(made.state.theta, before)  # not adapted while the filters settle
    assert made.estimate()[1] == pytest.approx(velocity[16999], abs=1e-3 * np.std(velocity))


def test_known_and_bounded_parameters():
    u = excited(8000)
    angles, _ = servo(2.0, 0.0, 30.0, u, 1e-3)
    made = joint(0.0, known=('k/J=0', 'b1=0'), bounds=('b/J>=2.5', 'Kv/J<=29'))
    feed(made, angles, u)
    found = named(made)
    assert found['k/J'].value == pytest.approx(0.0, abs=1e-12) and found['k/J'].stddev == 0.0
    assert found['b/J'].value >= 2.5 - 1e-12
    assert found['Kv/J'].value <= 29.0
    assert found['b1'].value == 0.0


@pytest.mark.parametrize(
    'gains, words',
    [
        ({'gamma': (1.0, 2.0, 3.0)}, 'needs 1, 4 or 16 numbers'),
        ({'gamma': (-1.0,)}, 'not positive definite'),
        ({'gamma': (1.0, 2.0, 3.0, 0.0)}, 'not positive definite'),
        ({'gamma': (*range(1, 17),)}, 'not symmetric'),
        ({'observer_poles': (-1.0,)}, 'needs 2 poles'),
        ({'observer_poles': (-1.0, 2.0)}, 'outside'),
        ({'model_poles': (-1.0, 0.0)}, 'outside'),
        ({'theta': (1.0, 2.0)}, 'needs 4 numbers (l1, l2, b1, b2)'),
        ({'theta': (1.0, math.nan, 0.0, 0.0)}, 'finite'),
        ({'known': ('b3=0',)}, "no parameter is called 'b3'"),
        ({'known': ('b1>0',)}, "write it as 'b1=0'"),
        ({'known': ('l1=0', 'l2=0', 'b1=0', 'b2=1')}, 'none is left to identify'),
        ({'bounds': ('b2=1',)}, "write it as 'b/J>=0'"),
        ({'bounds': ('b2>=2', 'b2<=1')}, 'leaves no value for b2'),
        ({'form': 'paper'}, "does not have the law 'least_squares'"),
        ({'order': 7}, 'outside'),
        ({'memory': 1e-5}, "'memory' = 1e-05 s"),
    ],
)
def test_bad_gains_are_refused_in_one_line(gains, words):
    with pytest.raises(UsageError) as caught:
        joint(**gains)
    assert words in str(caught.value) and '\n' not in str(caught.value)


def test_euler_is_refused_where_it_is_unstable():
    design = Adaptive.design(Gains(form='paper', **PAPER), Circle())
    assert Adaptive.limits(design, 0.16) is None
    assert '0.167' in Adaptive.limits(design, 0.17)
    assert Adaptive.limits(Adaptive.design(Gains(), Circle()), 10.0) is None


def test_gain_matrix_and_list_agree():
    u = excited(3000)
    angles, _ = servo(2.0, 5.0, 30.0, u, 1e-3)
    diagonal = (10.0, 20.0, 30.0, 40.0)
    coupled = np.diag(diagonal)
    coupled[0, 1] = coupled[1, 0] = 5.0
    thetas = []
    for gamma in (diagonal, np.diag(diagonal).ravel(), coupled.ravel()):
        made = joint(0.0, law='gradient', gamma=tuple(gamma))
        feed(made, angles, u)
        thetas.append(made.state.theta)
    assert thetas[1] == pytest.approx(thetas[0], rel=1e-12)
    assert thetas[2] != pytest.approx(thetas[0], rel=1e-3)


# Numbers that run away


@pytest.mark.long
def test_least_squares_that_forgets_does_not_run_away_while_nothing_moves():
    """At rest without a gate P grows as exp(t/memory), past every float within 700 memories."""
    made = joint(memory=0.04, gate='none', knock=0.0, noise=1e-4)
    angle, _ = servo(2.0, 3.0, 5.0, excited(4000), 1e-3)
    feed(made, angle, excited(4000))
    rest = np.full(8000, angle[-1])  # 1000 memories
    feed(made, rest, np.zeros(len(rest) - 1), dt=5e-3, start_ns=10**18 + 10**10)
    theta, p = made.state.theta, made.state.p
    assert all(map(math.isfinite, theta))
    start = structure(made.gains).variance
    assert all(0.0 < row[i] <= 1.2 * most for i, (row, most) in enumerate(zip(p, start)))
    angle, velocity = servo(2.0, 3.0, 5.0, excited(8000, seed=2), 1e-3, start=(angle[-1], 0.0))
    out, _ = feed(made, angle, excited(8000, seed=2), start_ns=10**18 + 3 * 10**12)
    assert np.max(np.abs(out.velocity[-2000:] - velocity[-2000:])) < 0.01


def test_an_observer_whose_numbers_ran_away_starts_again():
    """Whatever made a parameter nan, no later sample could mend it."""
    made = joint()
    angle, velocity = servo(2.0, 3.0, 5.0, excited(6000), 1e-3)
    feed(made, angle[:3000], excited(6000)[:2999])
    made.state.theta = np.full(4, math.nan)
    out, _ = feed(made, angle[3000:], excited(6000)[3000:], start_ns=10**18 + 3 * 10**9)
    assert out.status[1] == INITIALISING and out.status[-1] == TRACKING
    assert np.max(np.abs(out.velocity[-500:] - velocity[-500:])) < 0.05
