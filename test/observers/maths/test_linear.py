# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The exact step of a filter, as `adaptive` and `switched` use it."""

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from estimator_pkg.observers.maths.linear import companion, response


@pytest.mark.parametrize('poles', [(-30.0,), (-10.0, -12.0), (-900.0,) * 3, (-1e5,) * 6])
@pytest.mark.parametrize('size', [1e-3, 0.3, 8.0])
def test_a_filter_takes_the_exact_step(poles, size):
    pole, dt = -poles[0], size / -poles[0]
    column = tuple((-np.poly(poles)[1:]).tolist())
    scales = pole ** np.arange(len(poles))
    a = companion(column) * scales / scales[:, None]  # in scipy the size of entries matters
    constant, _ = quad_vec(lambda s: expm(a * s), 0.0, dt, epsrel=1e-13)
    ramp, _ = quad_vec(lambda s: expm(a * (dt - s)) * s / dt, 0.0, dt, epsrel=1e-13)
    found = [each * scales / scales[:, None] for each in response(column, pole, dt)]
    for own, true in zip(found, (expm(a * dt), constant, ramp)):
        np.testing.assert_allclose(own, true, rtol=1e-9, atol=1e-11 * np.abs(true).max())


def test_joints_of_a_message_share_the_step_and_none_can_spoil_it():
    first, second = (response((-30.0, -200.0), 20.0, 1.234567e-3) for _ in 'ab')
    assert first is second
    with pytest.raises(ValueError, match='read-only'):
        first[0][0, 0] = 7.0
