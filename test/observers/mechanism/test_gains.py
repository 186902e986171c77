# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Gains of observers of mechanisms, what follows from them, and those that are refused."""

import math

import numpy as np
import pytest
from mechanism_runs import FAST, driven, made, motion

from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.models.load import load
from estimator_pkg.observers.mechanism import gains as mechanical_gains
from estimator_pkg.observers.mechanism.parameters import per_joint

# Gains


def test_a_list_of_another_length_is_refused_with_the_right_one():
    for count, right in ((1, '1 position: set 1'), (3, '3 positions: set 1 or 3')):
        with pytest.raises(UsageError, match=f"'mu' has 2 numbers for {right}$"):
            per_joint('mu', (1.0, 2.0), count)


def test_gamma_follows_from_k_at_the_operating_point():
    plan = made('geso', model='robotic_leg', L=[1.2, 2.0, 2.0], K=[3.9, 2.5, 1.3])
    K = np.array(plan.describe(1e-3)['K'])
    np.testing.assert_allclose(K, np.diag([3.9, 2.5, 1.3]), atol=1e-12)
    other = plan.describe(1e-3)
    assert other['slowest_pole_over_range'] > 0.0
    assert other['noise_figure'][0] == pytest.approx(3.9**2 / 2.4)
    assert other['dt_K_below_L']


@pytest.mark.parametrize(
    'name, values, words',
    [
        ('geso', {'L': [10.0], 'Gamma': [-3.0]}, "'Gamma' is not positive definite"),
        ('geso', {'L': [-10.0], 'Gamma': [3.0]}, 'not Hurwitz'),
        ('geso', {'L': [10.0]}, "'L' is set, but neither 'Gamma' nor 'K'"),
        ('geso', {'L': [10.0, 2.0, 3.0], 'Gamma': [1.0]}, 'takes 1, 2 or 4'),
        ('geso', {'L': [10.0], 'Gamma': [1.0, 2.0, 0.0, 1.0]}, 'not symmetric'),
        ('geso', {'L': [10.0], 'Gamma': [1.0], 'K': [1.0]}, 'not both'),
        ('geso', {'operating_point': [1.0]}, 'operating_point'),
        ('hgo', {'L': [10.0], 'K': [-70.0]}, 'does not decay'),
        ('hgo', {'h': [1.0, 2.0, 3.0]}, "'hgo' takes 2"),
        ('ehgo', {'h': [1.0, 1.0, 4.0]}, 'do not make the error decay'),
        ('ehgo', {'damping': 0.7}, "unknown parameter 'damping'"),
        ('ehgo', {'disturbance_hz': 1.0}, "unknown parameter 'disturbance_hz'"),
        ('smo', {'bandwidth_hz': 20.0}, "unknown parameter 'bandwidth_hz'"),
        ('smo', {'L': [1.0]}, "unknown parameter 'L'"),
    ],
)
def test_wrong_gains_are_refused_in_one_line(name, values, words):
    with pytest.raises(UsageError) as error:
        made(name, model='cart_pendulum', **values)
    assert words in str(error.value)


def test_geso_of_a_curved_mechanism_offers_hgo():
    with pytest.raises(UserError, match="use the observer 'hgo'"):
        made('geso', model='own_models:TwoLinks')
    assert made('hgo', model='own_models:TwoLinks').mechanics.degrees == 2


def test_guaranteed_rate_holds_and_the_printed_one_does_not():
    """Proposition 4.1 with b = 0.9: dW/dt <= -c4 |e|^2 with k0; with k1 in its place it fails."""
    mechanics = load('cart_pendulum', FAST)
    L, gamma = np.eye(2) * 10.0, np.eye(2) * 70.0
    speed, step = 3.0, 1e-6
    angles = np.linspace(-math.pi, math.pi, 61)

    def calm(angle):
        return mechanics.factors(np.array([angle, 0.0]))[0]

    rates = [speed * (calm(a + step) - calm(a - step)) / (2.0 * step) for a in angles]
    sizes = np.array([np.linalg.svd(calm(a), compute_uv=False) for a in angles])
    k0, k1 = sizes[:, 1].min(), sizes[:, 0].max()
    k2 = max(np.linalg.norm(rate, 2) for rate in rates)

    def worst(found):
        value = -math.inf
        for angle, rate in zip(angles, rates):
            m = calm(angle)
            a = np.block([[-L, m], [-gamma @ m.T, np.zeros((2, 2))]])
            for sign in (1.0, -1.0):
                p = np.block([[found.c1 * np.eye(2), -m], [-m.T, found.c1 * np.linalg.inv(gamma)]])
                p_rate = np.block(
                    [[np.zeros((2, 2)), -sign * rate], [-sign * rate.T, np.zeros((2, 2))]]
                )
                w = 0.5 * (p @ a + a.T @ p + p_rate)
                value = max(value, np.linalg.eigvalsh(w + found.c4 * np.eye(4))[-1])
        return value

    assert worst(mechanical_gains.guaranteed_rate(L, gamma, k0, k1, k2)) <= 1e-9
    printed = mechanical_gains.guaranteed_rate(L, gamma, k1, k1, k2)
    assert worst(printed) > 0.0


def test_an_unknown_constant_force_is_found():
    """With a disturbance state, a constant force that the model does not know leaves no error."""
    dt, count = 1e-3, 4000
    inputs = [(0.2,)] * count
    positions, truth = motion(
        'single_joint', ('inertia=0.1', 'damping=0.5'), (0.0,), (0.0,), dt, count, inputs
    )
    error = {}
    for hertz in (0.0, 2.0):
        plan = made(
            'geso',
            model='single_joint',
            model_parameters=['inertia=0.1', 'damping=0.5'],
            bandwidth_hz=5.0,
            disturbance_hz=hertz,
        )
        velocities, _, _ = driven(plan, dt, count, positions, [(0.0,)] * count)
        error[hertz] = abs(velocities[-1, 0] - truth[-1, 0])
    assert error[0.0] > 0.03
    assert error[2.0] < 0.01 * error[0.0]
