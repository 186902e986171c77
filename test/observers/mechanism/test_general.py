# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Remark 6: systems that are linear in what is not measured."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.mechanism.general import GeneralObserver


def lorenz_like(y):
    """B for one unmeasured state behind two measured ones."""
    return np.array([[1.0 + 0.5 * math.sin(y[1])], [0.3]])


def drift(y, u):
    """f1."""
    return np.array([-0.4 * y[0], -0.2 * y[1] + 0.1 * y[0]])


def push(y, u):
    """f2."""
    return np.array([math.cos(y[0]) + u[0]])


def run(observer, dt=1e-3, count=4000):
    """Error of the unmeasured state over a motion integrated 20 times finer."""
    x = np.array([0.2, -0.3, 1.5])
    u = np.array([0.3])
    state = observer.start(x[:2])
    errors = []
    for _ in range(count):
        before = x[:2].copy()
        for _ in range(20):
            rate = np.concatenate([lorenz_like(x[:2]) @ x[2:] + drift(x[:2], u), push(x[:2], u)])
            middle = x + 0.5 * dt / 20 * rate
            x = x + dt / 20 * np.concatenate(
                [lorenz_like(middle[:2]) @ middle[2:] + drift(middle[:2], u), push(middle[:2], u)]
            )
        state = observer.step(state, before, x[:2].copy(), u, dt)
        errors.append(abs(state.unmeasured[0] - x[2]))
    return np.array(errors)


@pytest.mark.long
@pytest.mark.parametrize(
    'L, gamma',
    [
        pytest.param(np.diag([8.0, 8.0]), 20.0, marks=pytest.mark.slow),  # the other has no sign
        (np.array([[-0.5, 6.0], [-6.0, 4.0]]), 100.0),
    ],
    ids=('positive', 'Hurwitz alone'),
)
def test_error_goes_to_zero_exponentially(L, gamma):
    observer = GeneralObserver(lorenz_like, push, L, np.array([[gamma]]), drift)
    assert observer.observable_everywhere(np.random.default_rng(0).normal(size=(50, 2)))
    errors = run(observer, count=6000)
    assert errors[0] > 1.0
    assert errors[2000] < 0.05 * errors[0]
    assert errors[-1] < 1e-3


@pytest.mark.long
def test_without_the_drift_it_is_wrong():
    """f1 matters: left out, an error remains."""
    observer = GeneralObserver(lorenz_like, push, np.diag([8.0, 8.0]), np.array([[20.0]]))
    assert run(observer)[-1] > 1e-2


@pytest.mark.parametrize(
    'L, gamma, words',
    [
        (np.diag([1.0, -1.0]), np.eye(1), 'not Hurwitz'),
        (np.eye(2), -np.eye(1), 'not positive definite'),
        (np.ones(2), np.eye(1), 'square matrix'),
        (np.eye(2), np.eye(2), 'B has the shape (2, 1): with this L and Gamma it must be (2, 2)'),
    ],
)
def test_wrong_gains_are_refused_in_one_line(L, gamma, words):
    with pytest.raises(UsageError) as error:
        observer = GeneralObserver(lorenz_like, push, L, gamma)
        observer.step(observer.start(np.zeros(2)), np.zeros(2), np.zeros(2), np.zeros(1), 1e-3)
    assert words in str(error.value)


def test_the_example_of_the_guide_finds_the_speed(capsys):
    guide = Path(__file__).resolve().parents[3] / 'docs/own_model.md'
    code = guide.read_text().split('## Other systems')[1].split('```python\n')[1]
    names: dict = {}
    exec(code.split('```')[0], names)
    found = [float(word.strip('[]')) for word in capsys.readouterr().out.split()]
    assert found == pytest.approx([59.838, 59.838], abs=1e-3)
    assert names['motor'].observable_everywhere(np.zeros((1, 1)))
