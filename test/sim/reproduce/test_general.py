# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Remark 6: systems that are linear in what is not measured."""

import math
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip('scipy')
from scipy.integrate import solve_ivp

from sim_pkg.reproduce.mechanical.general import GeneralObserver

DT, COUNT, INPUT = 1e-3, 6000, np.array([0.3])


def lorenz_like(y):
    """B for one unmeasured state behind two measured ones."""
    return np.array([[1.0 + 0.5 * math.sin(y[1])], [0.3]])


def drift(y, u):
    """f1."""
    return np.array([-0.4 * y[0], -0.2 * y[1] + 0.1 * y[0]])


def push(y, u):
    """f2."""
    return np.array([math.cos(y[0]) + u[0]])


@pytest.mark.parametrize(
    'L, gamma',
    [(np.diag([8.0, 8.0]), 20.0), (np.array([[-0.5, 6.0], [-6.0, 4.0]]), 100.0)],
    ids=('positive', 'Hurwitz alone'),
)
def test_error_goes_to_zero_exponentially(L, gamma):
    def rate(_, x):
        return np.concatenate([lorenz_like(x) @ x[2:] + drift(x, INPUT), push(x, INPUT)])

    times = DT * np.arange(COUNT + 1)
    truth = solve_ivp(
        rate, (0.0, times[-1]), (0.2, -0.3, 1.5), 'DOP853', times, rtol=1e-9, atol=1e-12
    ).y.T
    observer = GeneralObserver(lorenz_like, drift, push, L, np.array([[gamma]]))
    state, errors = observer.start(truth[0, :2]), []
    for before, x in pairwise(truth):
        state = observer.step(state, before[:2], x[:2], INPUT, DT)
        errors.append(abs(state.unmeasured[0] - x[2]))
    assert errors[0] > 1.0
    assert errors[2000] < 0.05 * errors[0]
    assert errors[-1] < 1e-3
