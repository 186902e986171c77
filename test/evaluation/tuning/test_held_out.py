# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The comparison of tuned gains with the defaults on held-out data."""

import numpy as np
import pytest

from estimator_pkg.evaluation import pairs
from estimator_pkg.evaluation.tuning import held_out
from estimator_pkg.evaluation.tuning.objective import Weights


@pytest.mark.parametrize('weights', ((1.0, 0.0, 1.0), (1.0, 0.1, 0.1), (1.0, 1.0, 0.0)))
def test_a_constant_velocity_in_truth_and_estimate_costs_nothing(weights):
    time = 2e-3 * np.arange(4000)
    truth = np.sin(3.0 * time)
    estimate = truth + np.random.default_rng(1).normal(0.0, 0.05, len(time))
    block = pairs.blocks(time)
    slow, fast = (
        held_out._score(time, estimate + speed, truth + speed, Weights(*weights), block)
        for speed in (0.0, 20.0)
    )
    assert fast == pytest.approx(slow, rel=1e-6)
