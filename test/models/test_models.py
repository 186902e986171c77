# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Models of mechanisms: the checks at load, users' own models, wrong ones refused in one line."""

import math
import types
from pathlib import Path

import numpy as np
import pytest
from mechanism_runs import driven, made

from estimator_pkg import observers
from estimator_pkg.circle import Circle
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.models import cart_pendulum, check, robotic_leg, single_joint, two_links
from estimator_pkg.models.load import load
from estimator_pkg.models.mechanics import Mechanics, assignments_of
from estimator_pkg.models.motion import move

MODELS = (single_joint, cart_pendulum, robotic_leg)


@pytest.mark.parametrize('module', MODELS, ids=lambda module: module.MODEL.name)
def test_built_in_models_pass_their_checks(module):
    mechanics = load(module.MODEL.name)
    worst = max(
        check.linear_residual(mechanics, q, v)[0] for q, v in check.random_states(mechanics)
    )
    assert worst < 1e-8


@pytest.mark.parametrize('module', MODELS[1:], ids=lambda module: module.MODEL.name)
def test_the_check_sees_a_small_mistake_in_psi(module):
    """A Psi that is off by a part in a thousand of one entry is not partially linear."""
    right = load(module.MODEL.name)

    def psi(q):
        other = right.factors(q)[1]
        return other * (1.0 + 1e-3 * np.sin(q[0]) * np.eye(len(other))[0])

    names = 'joints', 'centre', 'reach', 'inertia', 'coriolis', 'gradient', 'inputs', 'actuated'
    given = {each: getattr(right.model, each) for each in names if hasattr(right.model, each)}
    wrong = types.SimpleNamespace(psi=psi, **given)
    with pytest.raises(UserError, match=r"PLvCC.* with its Psi.* use the observer 'hgo'"):
        check.check(Mechanics(wrong, 'wrong'))


def test_two_links_keep_their_energy_and_are_not_for_geso():
    """Without friction and torque: inertia, Coriolis forces and gravity belong together."""
    p = two_links.Parameters(
        shoulder_damping=0.0, elbow_damping=0.0, shoulder_coulomb=0.0, elbow_coulomb=0.0
    )
    mechanics = two_links.MODEL.build(p)

    def energy(q, v):
        v = np.array(v)
        return (
            0.5 * v @ mechanics.inertia(q) @ v
            - p.shoulder_gravity * np.cos(q[0])
            - p.elbow_gravity * np.cos(q[0] + q[1])
        )

    q, v = np.array([2.0, -1.0]), np.array([3.0, -5.0])
    q2, v2 = move(mechanics, *map(np.array, (q, v, (0.0, 0.0))), 1.0, 4000)
    assert abs(q2[0] - q[0]) > 0.5
    assert energy(q2, v2) == pytest.approx(energy(q, v), rel=1e-9)
    assert not load('two_links').linearisable
    with pytest.raises(UsageError, match='mass matrix is not positive'):
        load('two_links', ('coupling=0.2',))


def test_own_model_without_psi_and_coriolis_gets_both():
    own, built_in = (
        load('own_models:CartPendulum'),
        load(
            'cart_pendulum',
            ('pendulum_inertia=1', 'pendulum_moment=0.5', 'moving_mass=1', 'gravity=1'),
        ),
    )
    q, v, u = np.array([0.7, 0.1]), np.array([1.1, -0.3]), np.array([0.4])
    assert own.linearisable
    for function in ('inertia', 'force', 'coriolis'):
        arguments = {'inertia': (q,), 'force': (q, v, u), 'coriolis': (q, v)}[function]
        np.testing.assert_allclose(
            getattr(own, function)(*arguments), getattr(built_in, function)(*arguments), rtol=1e-7
        )
    np.testing.assert_allclose(own.factors(q)[0], built_in.factors(q)[0], rtol=1e-9, atol=1e-15)


def test_a_curved_mechanism_has_no_factors():
    assert not load('own_models:TwoLinks').linearisable


def test_an_own_model_may_have_more_positions_than_ours():
    plan = made('geso', model='own_models:SixJoints')
    readings = [tuple(0.1 * math.sin(0.01 * k + j) for j in range(6)) for k in range(400)]
    velocities, statuses, state = driven(plan, 1e-3, 400, readings)
    np.testing.assert_allclose(velocities[-1], np.diff(readings, axis=0)[-1] / 1e-3, atol=0.25)
    assert np.shape(plan.deviations(state, 1e-3)) == (2, 6)
    q, v = move(plan.mechanics, np.zeros(6), np.full(6, 0.5), np.zeros(6), 0.1, 3)
    np.testing.assert_allclose(q, 0.05)


@pytest.mark.parametrize(
    'name, words',
    [
        ('own_models:WrongPsi', 'not partially linearisable (PLvCC) with its Psi: correct'),
        ('own_models:WrongCoriolis', 'Coriolis forces do not belong to the mass matrix'),
        ('own_models:Singular', 'mass matrix is not positive'),
        ('own_models:Lopsided', 'mass matrix is not symmetric'),
        ('own_models:WrongSize', 'inputs fails'),
        ('own_models:Incomplete', 'has no inertia'),
        ('own_models:Driving', 'the damping drives the mechanism'),
        ('own_models:NoReach', 'it must be above 0 for each position'),
        ('own_models:OneName', 'joints must be a list of names'),
        ('own_models:Missing', "has no 'Missing'"),
        ('no_such_module:Name', "cannot import 'no_such_module'"),
        ('cart_pendulm', "did you mean 'cart_pendulum'?"),
    ],
)
def test_wrong_models_are_refused_in_one_line(name, words):
    with pytest.raises(UserError) as error:
        load(name)
    assert words in str(error.value)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(
    'assignments, words',
    [
        (('pendulum_moment=1.3',), 'mass matrix is not positive'),
        (('pendulum_mass=1',), "did you mean 'pendulum_moment'?"),
        (('moving_mass=-1',), 'outside'),
    ],
)
def test_wrong_numbers_are_refused_in_one_line(assignments, words):
    with pytest.raises(UsageError) as error:
        load('cart_pendulum', assignments)
    assert words in str(error.value)


def test_numbers_survive_being_written_as_assignments():
    parameters = single_joint.Parameters(inertia=0.123456789012, gravity=-2e-7)
    texts = assignments_of(single_joint.MODEL, parameters)
    assert load('single_joint', texts).model.numbers == parameters


def test_the_example_of_the_guide_works(tmp_path, monkeypatch):
    """The code of docs/known_inputs.md, in a module outside the package."""
    guide = (Path(__file__).parents[2] / 'docs/known_inputs.md').read_text()
    (tmp_path / 'guide_crane.py').write_text(guide.split('```python\n')[1].split('```')[0])
    monkeypatch.syspath_prepend(tmp_path)
    crane = load('guide_crane:Crane')
    assert crane.linearisable and crane.actuated == (1,)
    record = observers.find('geso')
    plan = record.plan(record.gains(model='guide_crane:Crane'), Circle())
    assert plan.mechanics.degrees == 2
