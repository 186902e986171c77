# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of observers of mechanisms measures what it says."""

import numpy as np
import pytest

from benchmarks import mechanism


@pytest.mark.slow
def test_every_row_is_measured_and_has_its_limit(monkeypatch):
    monkeypatch.setattr(mechanism, 'STEPS', 50)
    monkeypatch.setattr(mechanism, 'ENGINE_STEPS', 2000)
    rows = mechanism.mechanisms(1)
    assert [(row['limit'], row['required']) for row in rows] == [
        (15.0, 'at most'),
        (200.0, 'at most'),
        (3.0, 'at least'),
    ]
    assert all(row['value'] > 0.0 for row in rows)


def test_the_numpy_model_is_the_built_in_one():
    """So that their costs are those of the same work."""
    built_in, own = (
        mechanism.mechanism(name).plan.mechanics for name in (mechanism.BUILT_IN, mechanism.NUMPY)
    )
    q, v, u = (0.4, 0.1), (1.0, -2.0), (0.7,)
    np.testing.assert_allclose(own.force(q, v, u), built_in.force(q, v, u), rtol=1e-3)
    np.testing.assert_allclose(own.inertia(q), built_in.inertia(q))
