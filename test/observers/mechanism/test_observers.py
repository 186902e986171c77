# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""geso, hgo, ehgo and smo: steps, frequency response, motion at speed, the driver."""

import math
import re
from functools import lru_cache

import numpy as np
import pytest
from mechanism_runs import FAST, NAMES, driven, made, motion

from estimator_pkg import observers
from estimator_pkg.driver.mechanism import Mechanism, MechanismSettings
from estimator_pkg.estimate import TRACKING
from estimator_pkg.models.mechanics import solved
from estimator_pkg.observers.mechanism.flow import balance, flow
from estimator_pkg.observers.mechanism.noise import discrete
from estimator_pkg.parameters import build

# The exact step


@pytest.mark.parametrize('n', (1, 2, 3, 5))
@pytest.mark.parametrize(
    'diagonal, damped, disturbed',
    [(True, False, False), (False, True, False), (True, True, True), (False, False, True)],
)
@pytest.mark.parametrize('dt', (1e-3, 0.1, 3.0))
def test_flow_is_the_matrix_exponential(n, diagonal, damped, disturbed, dt):
    expm = pytest.importorskip('scipy.linalg').expm
    random = np.random.default_rng(n)
    calm, psi, weights = (random.normal(size=(n, n)) for _ in range(3))
    L = np.diag(random.uniform(5.0, 15.0, n))
    if not diagonal:
        L = L + 0.3 * random.normal(size=(n, n))
    b = np.diag(random.uniform(20.0, 100.0, n)) @ calm.T
    none = np.zeros((n, n))
    decay = 0.1 * weights * damped
    A = np.block([[-L, calm, none], [-b, -decay, psi.T], [-2.0 * weights, none, none]])
    size = (3 if disturbed else 2) * n
    A, z, c = A[:size, :size], random.normal(size=size), random.normal(size=size)
    whole = np.zeros((size + 1, size + 1))
    whole[:-1, :-1], whole[:-1, -1] = A, c
    wanted = (expm(whole * dt) @ np.append(z, 1.0))[:-1]
    np.testing.assert_allclose(
        flow(A, c, z, dt, balance(A, n)), wanted, rtol=0.0, atol=1e-11 * np.max(np.abs(wanted))
    )


STUCK = ('inertia=0.01', 'coulomb=0.5')  # 50 rad/s^2: half a rad/s within a sample of 10 ms


def test_exact_step_needs_no_small_dt():
    """Gains far beyond dt K < L: Euler is refused with the limit, the exact step is stable."""
    gains = {'L': [50.0, 80.0], 'Gamma': [400.0, 150.0], 'model': 'cart_pendulum'}
    euler = made('geso', form='paper', **gains)
    words = euler.limits(1.0 / 112.0)
    assert 'form: exact' in words and 'less than' in words
    assert made('geso', **gains).limits(1.0) is None
    limit = float(words.split('less than ')[1].split(' ')[0])
    assert euler.limits(0.999 * limit) is None and euler.limits(1.001 * limit) is not None
    positions, truth = motion(
        'cart_pendulum', (), (math.pi - 0.4, 0.0), (0.0, 0.2), 1.0 / 112.0, 400
    )
    velocities, _, _ = driven(made('geso', **gains), 1.0 / 112.0, 400, positions)
    assert np.max(np.abs(velocities[200:] - truth[201:])) < 0.03


@pytest.mark.long
def test_error_of_geso_is_linear_at_any_speed():
    """At 40 rad/s and strong coupling, GESO beats HGO by far more than 10 times (spec 5.3)."""
    dt, count = 1e-4, 20000
    positions, truth = motion('cart_pendulum', FAST, (1.37, -0.1), (40.0, 0.35), dt, count)
    found = {}
    for name, gains in (('geso', {'Gamma': [70.0]}), ('hgo', {'K': [70.0]})):
        plan = made(name, model='cart_pendulum', model_parameters=list(FAST), L=[10.0], **gains)
        velocities, _, _ = driven(plan, dt, count, positions)
        error = (velocities - truth[1:])[15000:]
        found[name] = math.sqrt(np.mean(np.sum(error**2, axis=1)))
    assert found['hgo'] > 10.0 * found['geso']
    assert found['geso'] < 0.05


# Frequency response, about a frozen configuration


@pytest.mark.long
@pytest.mark.parametrize('name', ('geso', 'hgo', 'ehgo'))
@pytest.mark.parametrize(
    'form, hold', [('exact', 'linear'), ('exact', 'previous'), ('paper', 'previous')]
)
@pytest.mark.parametrize(
    'hertz', [*(pytest.param(each, marks=pytest.mark.slow) for each in (0.5, 10.0)), 3.0, 40.0]
)
def test_frequency_response_is_the_closed_form(name, form, hold, hertz):
    """From the pendulum's angle to its velocity, gain within 5 % and phase within 3 degrees."""
    dt = 1e-3
    plan = made(
        name,
        model='cart_pendulum',
        form=form,
        hold=hold,
        bandwidth_hz=8.0,
        model_parameters=['gravity=0'],
        operating_point=[0.6, 0.0],
    )
    at = np.array([0.6, 0.0])
    matrix, shown = plan.linear(at, np.zeros(2))
    step, arrival = discrete(
        matrix, 2, dt, euler=form == 'paper', linear_hold=form == 'exact' and hold == 'linear'
    )
    z = np.exp(2j * math.pi * hertz * dt)
    response = np.linalg.solve(np.eye(len(step)) - step / z, arrival[:, 0] * (1.0 - 1.0 / z))
    wanted = (shown @ response[2:4])[0]
    count = round((1.0 + 3.0 / hertz) / dt)
    size = 1e-6
    wave = size * np.exp(2j * math.pi * hertz * dt * np.arange(count))
    readings = [(0.6 + value.imag, 0.0) for value in wave]
    velocities, _, _ = driven(plan, dt, count, readings)
    last = round(2.0 / hertz / dt)
    part, carrier = velocities[-last:, 0], wave[-last:] / size
    fit = np.linalg.lstsq(np.column_stack([carrier.imag, carrier.real]), part, rcond=None)[0]
    found = complex(fit[0], fit[1]) / size
    assert abs(abs(found) / abs(wanted) - 1.0) < 0.05
    assert abs(math.degrees(np.angle(found / wanted))) < 3.0


@pytest.mark.parametrize('name', ('geso', 'hgo', 'ehgo'))
def test_bandwidth_is_the_minus_3_db_frequency(name):
    """From true to estimated velocity, for motion that the model does not foresee."""
    damping = {} if name == 'ehgo' else {'damping': 0.8}
    plan = made(name, model='single_joint', bandwidth_hz=12.0, **damping)
    matrix, shown = plan.linear(np.zeros(1), np.zeros(1))
    s = 2j * math.pi * 12.0
    arrival = np.zeros(len(matrix))
    arrival[0] = -1.0
    gain = (shown @ np.linalg.solve(s * np.eye(len(matrix)) - matrix, arrival)[1:2])[0]
    # e' holds the rate of the measurement, so the transfer is from velocity
    assert abs(gain) == pytest.approx(math.sqrt(0.5), rel=1e-6)


# Through the driver, and with a user's model


def test_a_users_numpy_model_gives_the_same_as_the_built_in_one():
    record = observers.find('geso')
    numbers = ['pendulum_inertia=1', 'pendulum_moment=0.5', 'moving_mass=1', 'gravity=1']
    found = []
    for values in (
        {'model': 'own_models:CartPendulum'},
        {'model': 'cart_pendulum', 'model_parameters': numbers},
    ):
        gains = build(record.gains, {'bandwidth_hz': 5.0, **values})
        joint = Mechanism('m', record, gains, MechanismSettings(), 'joint_states')
        for k in range(200):
            joint.update(10**12 + k * 10**6, (0.3 + 1e-3 * k, 0.2), (0.4,))
        found.append(joint.estimate()[1])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)


def test_the_driver_drops_numbers_that_are_no_readings():
    record = observers.find('hgo')
    gains = record.gains(model='cart_pendulum')
    joint = Mechanism('m', record, gains, MechanismSettings(), 'joint_states')
    assert joint.update(10**9, (0.0, 0.0), (0.0,))
    assert not joint.update(2 * 10**9, (math.nan, 0.0), (0.0,))
    assert joint.dropped() == {'non_finite': 1}


@pytest.mark.long
def test_exact_step_is_of_second_order_in_fast_motion():
    """The model is evaluated half-way between samples: a quarter of the error at half the dt."""
    found = []
    for dt in (2e-3, 1e-3):
        count = round(6.0 / dt)  # the start is forgotten after 5 s
        positions, truth = motion('cart_pendulum', FAST, (1.37, -0.1), (12.0, 0.35), dt, count)
        plan = made(
            'geso', model='cart_pendulum', model_parameters=list(FAST), L=[10.0], Gamma=[70.0]
        )
        velocities, _, _ = driven(plan, dt, count, positions)
        late = round(5.0 / dt)
        found.append(math.sqrt(np.mean((velocities - truth[1:])[late:] ** 2)))
    assert found[1] < 0.27 * found[0]


@lru_cache
def with_friction(dt, rate, count=500):
    """(numbers of its model, torques, positions, velocities) of a joint driven by a sine."""
    assignments = ('inertia=0.01', f'damping={0.01 * rate}')
    torque = [(math.sin(math.pi * dt * k),) for k in range(count)]
    moved = motion('single_joint', assignments, (0.0,), (0.0,), dt, count, torque, parts=60)
    return assignments, torque, *moved


@pytest.mark.long
@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize(
    'dt, rate', (pytest.param(0.01, 5.0, marks=pytest.mark.slow), (0.02, 100.0), (0.01, 1000.0))
)
def test_friction_that_stops_a_joint_within_a_sample_makes_none_unstable(name, dt, rate):
    """D/J of up to ten per sample time: an explicit step of D v grows without bound."""
    assignments, torque, readings, speeds = with_friction(dt, rate)
    count = len(readings)
    plan = made(name, model='single_joint', model_parameters=list(assignments))
    velocities, _, _ = driven(plan, dt, count, readings, torque)
    error = velocities - speeds[1:]
    assert np.max(np.abs(error[count // 2 :])) < 0.02 * np.max(np.abs(speeds)) + 0.03


def test_a_damped_joint_is_as_exact_without_psi_as_with_it():
    """hgo is geso where nothing turns: the same numbers, damping and all."""
    assignments = ['inertia=0.02', 'damping=0.3', 'gravity=0.7']
    readings = [(math.sin(0.03 * k),) for k in range(300)]
    both = [
        driven(
            made(name, model='single_joint', model_parameters=assignments, disturbance_hz=1.0),
            0.01,
            300,
            readings,
            [(0.1,)] * 300,
        )[0]
        for name in ('geso', 'hgo')
    ]
    np.testing.assert_allclose(both[0], both[1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('name', ('geso', 'hgo', 'ehgo'))
def test_gains_far_beyond_the_rate_are_refused_with_the_limit(name):
    plan = made(name, bandwidth_hz=1e5)
    assert plan.limits(1e-4) is None
    assert re.search(r'far too fast .* less than 0.00\d+ s; lower bandwidth_hz', plan.limits(0.01))
    assert made(name, bandwidth_hz=1e3).limits(0.01) is None


def test_a_mass_that_vanishes_gives_no_numbers_instead_of_an_exception():
    """Polar coordinates at the origin: M = diag(1, r^2), in a model that does not say so."""
    assert np.all(np.isnan(solved(np.diag([1.0, 0.0]), np.ones((2, 1)))))
    np.testing.assert_allclose(solved(np.diag([2.0, 4.0]), np.ones((2, 1)))[:, 0], (0.5, 0.25))


# Dry friction


@pytest.mark.parametrize(
    'name, most', (('geso', 0.01), ('hgo', 0.01), ('ehgo', 0.01), ('smo', 0.08))
)
def test_a_joint_that_dry_friction_holds_is_estimated_at_rest(name, most):
    """Held explicitly over a sample, friction throws it to and fro by 0.3 rad/s."""
    random = np.random.default_rng(0)
    readings = [(float(each),) for each in np.rint(random.normal(0.0, 1e-4, 400) / 1.5e-3) * 1.5e-3]
    plan = made(name, model='single_joint', model_parameters=list(STUCK))
    velocities, statuses, _ = driven(plan, 0.01, 400, readings, [(0.2,)] * 400)
    assert statuses[-1] == TRACKING
    assert np.max(np.abs(velocities[200:])) < most + 0.1 * (name == 'smo')
    assert np.sqrt(np.mean(velocities[200:] ** 2)) < most


@pytest.mark.parametrize('name', ('geso', 'hgo', 'ehgo'))
@pytest.mark.long
def test_dry_friction_at_200_hz_through_both_directions(name):
    """A quarter of a rad/s is what friction takes within a sample, and was the error."""
    dt, count = 5e-3, 600
    torque = [(1.2 * math.sin(2.0 * math.pi * 0.7 * dt * k),) for k in range(count)]
    readings, speeds = motion('single_joint', STUCK, (0.0,), (0.0,), dt, count, torque, parts=100)
    plan = made(name, model='single_joint', model_parameters=list(STUCK))
    velocities, _, _ = driven(plan, dt, count, readings, torque)
    error = np.abs(velocities - speeds[1:])[100:]
    assert np.max(np.abs(speeds)) > 20.0 and np.max(error) < 0.06
