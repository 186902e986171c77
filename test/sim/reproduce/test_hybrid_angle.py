# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The basis of the reproduction of the hybrid-angle paper: injections, V, the algorithm."""

import math
from functools import partial

import numpy as np
import pytest
from observer_cases import make, stamps

from estimator_pkg.circle import Circle
from estimator_pkg.observers.angle.hybrid import injections
from estimator_pkg.observers.angle.hybrid.observer import Gains, HybridAngle
from estimator_pkg.parameters import build
from sim_pkg.joints import profiles
from sim_pkg.reproduce.hybrid_angle import observer as continuous
from sim_pkg.reproduce.hybrid_angle.sampled import FIGURE_6, PERIOD, algorithm_1, samples

TURN = 2.0 * math.pi


@pytest.mark.parametrize('name', injections.INJECTIONS)
def test_the_node_runs_the_algorithm_that_is_reproduced(name):
    """What the driver calls (``form: paper``) gives the rows' numbers to the bit."""
    joint = make(
        'hybrid_angle', {'form': 'paper', 'injection': name, **FIGURE_6, 'low_speed_bound': False}
    )
    _, _, angles = samples(profiles.figure_6(0.05), 8.0, 0.3)
    # one sample time later: the paper's first step predicts from (0, 0)
    found = joint.run(stamps(len(angles) + 1, PERIOD), np.concatenate(([0.0], angles))).velocity[1:]
    np.testing.assert_array_equal(found, algorithm_1(name, angles))


@pytest.mark.parametrize('name', injections.INJECTIONS)
def test_the_continuous_observer_has_the_injections_of_the_node(name):
    gains = build(Gains, {'form': 'paper', 'injection': name, **FIGURE_6})
    made = HybridAngle.design(gains, Circle())
    for error in np.linspace(-9.0, 9.0, 61).tolist():
        ours = continuous.injection(injections.INJECTIONS.index(name), error, 1.0)
        assert ours == injections.inject(error, made)


@pytest.mark.parametrize('name', injections.INJECTIONS)
def test_a_potential_is_the_integral_of_its_injection(name):
    """(7) of the paper, at a saturation that is not 1."""
    limit, kind = 0.7, injections.INJECTIONS.index(name)
    potential, injection = partial(continuous.potential, kind), partial(continuous.injection, kind)
    errors = np.linspace(-2.9, 2.9, 59)
    slope = [(potential(e + 1e-6, limit) - potential(e - 1e-6, limit)) / 2e-6 for e in errors]
    assert slope == pytest.approx([injection(e, limit) for e in errors.tolist()], abs=1e-5)
    assert potential(0.0, limit) == 0.0
    assert potential(limit + 1e-12, limit) == pytest.approx(potential(limit - 1e-12, limit))
    assert continuous.lyapunov(kind, 0.0, 3.0, 4.5, limit) == pytest.approx(1.0)
