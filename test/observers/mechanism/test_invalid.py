# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers of mechanisms where something is missing, singular or far off."""

import math

import numpy as np
import pytest
from mechanism_runs import FAST, driven, made, motion

from estimator_pkg.estimate import COASTING, INITIALISING, NOT_OBSERVABLE, TRACKING


def leg(**values):
    """An observer of the leg."""
    return made('geso', model='robotic_leg', bandwidth_hz=5.0, **values)


def test_leaving_the_domain_coasts_and_is_never_infinite():
    dt = 1e-3
    plan = leg()
    angle = 2.6 + 1.0 * dt * np.arange(1000)  # passes pi at 0.54 s
    readings = [(2.0, float(a), 0.4) for a in angle]
    velocities, statuses, state = driven(plan, dt, 1000, readings, [(0.0, 0.0)] * 1000)
    assert np.all(np.isfinite(velocities))
    outside = np.abs(np.sin(angle[1:])) <= 0.02
    assert outside.sum() > 20
    assert all(statuses[k] != TRACKING for k in np.flatnonzero(outside))
    assert COASTING in statuses or NOT_OBSERVABLE in statuses or INITIALISING in statuses
    assert np.max(np.abs(velocities[:, 1])) < 20.0


def test_standing_at_the_singularity_is_not_observable():
    plan = leg()
    _, statuses, state = driven(plan, 1e-3, 600, [(2.0, math.pi, 0.4)] * 600, [(0.0, 0.0)] * 600)
    assert statuses[-1] == NOT_OBSERVABLE
    assert 'outside the domain' in plan.why(state)


def test_missing_effort_coasts_and_then_withholds():
    plan = made('geso', model='cart_pendulum', bandwidth_hz=10.0)
    readings = [(0.1, 0.0)] * 1600
    inputs = [(0.0,)] * 1000 + [(math.nan,)] * 600
    velocities, statuses, state = driven(plan, 1e-3, 1600, readings, inputs)
    assert statuses[990] == TRACKING
    assert statuses[1005] == COASTING
    assert statuses[-1] == NOT_OBSERVABLE
    assert np.all(np.isfinite(velocities))
    assert 'no effort for cart' in plan.why(state)
    for _ in range(1000):
        plan.step(state, 1e-3, (0.1, 0.0), (0.0,))
    assert state.status == TRACKING


def test_far_off_positions_start_the_observer_again():
    plan = made('hgo', model='single_joint', bandwidth_hz=0.05)
    readings = [(0.0,)] * 10 + [(1.5,)] * 11000
    _, statuses, _ = driven(plan, 1e-3, len(readings), readings)
    assert statuses[20] != TRACKING


def test_wrapping_joints_wrap_and_sliding_ones_do_not():
    dt, count = 1e-3, 4000
    plan = made('geso', model='cart_pendulum', model_parameters=list(FAST), bandwidth_hz=5.0)
    positions, truth = motion('cart_pendulum', FAST, (0.0, 0.0), (9.0, 4.0), dt, count)
    wrapped = [((q1 + math.pi) % (2.0 * math.pi) - math.pi, q2) for q1, q2 in positions]
    velocities, statuses, state = driven(plan, dt, count, wrapped)
    assert np.max(np.abs(velocities[2000:] - truth[2001:])) < 0.05
    at = plan.estimate(state)[0]
    assert at[0] == pytest.approx(wrapped[-1][0], abs=0.01)
    assert positions[-1][1] > 5.0 and at[1] == pytest.approx(positions[-1][1], abs=0.01)


@pytest.mark.parametrize('name', ('geso', 'hgo'))
def test_a_users_model_that_fails_on_the_way_is_flagged_and_said(name):
    """Its own error is in the reason; nothing is raised, nothing infinite or wrong is given."""
    plan = made(name, model='own_models:FailsLater', bandwidth_hz=10.0)
    angle = np.minimum(1e-3 * np.arange(1600), 1.6)
    readings = [(float(q), 0.0) for q in angle]
    velocities, statuses, state = driven(plan, 1e-3, 1600, readings, [(0.0,)] * 1600)
    assert statuses[1400] == TRACKING and statuses[-1] != TRACKING
    assert np.all(np.isfinite(velocities))
    assert 'ValueError: out of the table' in plan.why(state)
