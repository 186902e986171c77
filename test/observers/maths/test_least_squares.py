# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Least squares that forgets, as `adaptive` and `switched` use it."""

import math

import numpy as np
import pytest

from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.switched import SwitchedJoint
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import TRACKING
from estimator_pkg.observers.maths.least_squares import LEAST_KEPT, kept, update
from estimator_pkg.observers.switched.observer import Gains, Switched
from estimator_pkg.parameters import build

MOST = np.full(2, 1e6)


def begun():
    return np.zeros(2), np.diag(MOST)


def test_it_is_the_weighted_fit():
    random = np.random.default_rng(1)
    rows, forget = random.normal(size=(60, 2)), 0.9
    targets = rows @ [2.0, -3.0] + random.normal(0.0, 0.1, 60)
    theta, p = begun()
    for row, target in zip(rows, targets):
        theta, p, _ = update(theta, p, row, target - row @ theta, forget, MOST)
    weights = forget ** np.arange(59, -1, -1.0)
    information = rows.T @ (weights[:, None] * rows)
    np.testing.assert_allclose(
        theta, np.linalg.solve(information, rows.T @ (weights * targets)), rtol=1e-5
    )
    np.testing.assert_allclose(p, np.linalg.inv(information), rtol=1e-4)


@pytest.mark.parametrize('row', [(0.0, 0.0), (1.0, 0.0), (1.0, 1e-9), (1e6, 1e6)])
def test_what_no_sample_shows_is_forgotten_no_further_than_the_start(row):
    theta, p = begun()
    row = np.array(row)
    for _ in range(20_000):
        theta, p, _ = update(theta, p, row, 1.0 - row @ theta, 0.9, MOST)
    assert 0.0 < p[0][0] <= 1.001 * MOST[0] and 0.0 < p[1][1] <= 1.001 * MOST[1]
    assert all(map(math.isfinite, theta))
    random = np.random.default_rng(2)  # and it can still learn
    for new in random.normal(size=(300, 2)):
        theta, p, _ = update(theta, p, new, new @ ((2.0, -3.0) - theta), 0.9, MOST)
    assert theta == pytest.approx((2.0, -3.0), abs=1e-6)


def test_what_samples_show_is_forgotten_though_another_parameter_is_not():
    """The second never moves; the first changes, and is followed within its memory."""
    theta, p = begun()
    for k in range(2000):
        target = 5.0 if k < 1900 else -5.0
        theta, p, _ = update(theta, p, np.array([1.0, 0.0]), target - theta[0], 0.9, MOST)
    assert theta[0] == pytest.approx(-5.0, abs=10.0 * 0.9**100 + 1e-6)


def test_a_sample_time_far_beyond_the_memory_leaves_a_rest():
    assert kept(1.0, 0.0) == 1.0
    assert kept(0.1, 1.0) == pytest.approx(math.exp(-0.1))
    assert kept(1.0, 1e-9) == LEAST_KEPT


def test_switched_refuses_a_memory_shorter_than_that_of_its_filter():
    with pytest.raises(UsageError, match=r"'memory' = 1e-05 s .* at least 0.04"):
        SwitchedJoint(Switched, build(Gains, {'memory': 1e-5}), JointSettings())


@pytest.mark.long
@pytest.mark.parametrize('gains', [{}, {'model': 'example'}, {'velocity': 'cascade'}])
def test_switched_starts_again_when_its_numbers_ran_away(gains):
    """Whatever made an estimate nan, no later sample could mend it."""
    joint = SwitchedJoint(Switched, build(Gains, gains), JointSettings())
    outputs = len(joint.model.indices)
    known_input = joint.model.probe(0.0)
    for i in range(1500):
        joint.update(10**9 + i * 10**6, (0.1,) * outputs, [0.0] * len(known_input))
        if i == 50:
            for observed, zt in zip(joint.state.observed, joint.state.zt):
                observed[:], zt[:] = [math.nan] * len(observed), [1e300] * len(zt)
    position, velocity, _, status = joint.estimates()[0]
    assert position == pytest.approx(0.1, abs=0.01) and abs(velocity) < 5.0
    assert status == TRACKING
