# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The phase-locked loop, and the algebra of loops with fixed gains."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_lyapunov
from test_frequency_response import placed, transition

from estimator_pkg.observers.maths.tracking import matched, natural_frequency, noise_of_three

poles = st.floats(0.01, 0.995)


@pytest.mark.parametrize(
    'damping, factor', [(1.0, math.sqrt(math.sqrt(2.0) - 1.0)), (math.sqrt(0.5), 1.0)]
)
def test_natural_frequency_of_the_dampings_with_a_closed_form(damping, factor):
    assert natural_frequency(10.0, damping) == pytest.approx(20.0 * math.pi / factor, rel=1e-12)


@given(st.floats(0.1, 1e3), st.floats(-1e6, 1.0), st.floats(1e-4, 1.0))
def test_matched_poles_are_the_continuous_ones(decay, part, dt):
    square = part * decay * decay * 0.99 if part > 0.0 else part
    alpha, beta = matched(decay, square, dt)
    expected = np.exp(
        np.array([-decay + np.sqrt(complex(square)), -decay - np.sqrt(complex(square))]) * dt
    )
    assert alpha == pytest.approx(1.0 - np.prod(expected).real, rel=1e-9, abs=1e-12)
    assert beta == pytest.approx(np.prod(1.0 - expected).real, rel=1e-6, abs=1e-12)


def test_matched_gains_of_a_slow_loop_keep_their_digits():
    """0.001 Hz at 100 kHz: alpha and beta by their series, 1 - z would have lost eight digits."""
    w, dt = 2.0 * math.pi * 1e-3, 1e-5
    alpha, beta = matched(w, 0.0, dt)
    assert alpha == pytest.approx(2.0 * w * dt, rel=1e-6)
    assert beta == pytest.approx((w * dt) ** 2, rel=1e-6)
    assert matched(w, -w * w, dt)[1] == pytest.approx(2.0 * (w * dt) ** 2, rel=1e-6)


def exact(gain, dt):
    """Variances of position, velocity and innovation, from the Lyapunov equation."""
    order = len(gain)
    scale = dt ** np.arange(order)
    gain, f = gain * scale, transition(order, 1.0)
    keep = np.eye(order) - np.outer(gain, np.eye(order)[0])
    p = solve_discrete_lyapunov(keep @ f, np.outer(gain, gain))
    return p[0, 0], p[1, 1] / dt**2, (f @ p @ f.T)[0, 0] + 1.0


@given(poles, poles, poles, st.floats(1e-4, 1.0))
def test_noise_of_three_is_the_lyapunov_solution(one, other, third, dt):
    gain = placed([one, other, third], dt)
    ours = noise_of_three(gain[0], gain[1] * dt, gain[2] * dt * dt, dt)
    assert ours == pytest.approx(exact(gain, dt), rel=1e-4)
