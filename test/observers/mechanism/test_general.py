# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Remark 6: systems that are linear in what is not measured."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
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


DT, INPUT = 1e-3, np.array([0.3])


@lru_cache
def motion(count=6000):
    """The true states [(3,)], by Runge-Kutta."""

    def rate(x):
        measured, unmeasured = x[:2], x[2:]
        known = lorenz_like(measured) @ unmeasured + drift(measured, INPUT)
        return np.concatenate([known, push(measured, INPUT)])

    states = [np.array([0.2, -0.3, 1.5])]
    for _ in range(count):
        x = states[-1]
        one = rate(x)
        two = rate(x + 0.5 * DT * one)
        three = rate(x + 0.5 * DT * two)
        four = rate(x + DT * three)
        states.append(x + DT / 6.0 * (one + 2.0 * two + 2.0 * three + four))
    return states


def run(observer, count=6000):
    """Error of the unmeasured state over a motion."""
    states = motion()
    state = observer.start(states[0][:2])
    errors = []
    for before, x in pairwise(states[: count + 1]):
        state = observer.step(state, before[:2], x[:2], INPUT, DT)
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
    errors = run(observer)
    assert errors[0] > 1.0
    assert errors[2000] < 0.05 * errors[0]
    assert errors[-1] < 1e-3


@pytest.mark.long
def test_without_the_drift_it_is_wrong():
    """f1 matters: left out, an error remains."""
    observer = GeneralObserver(lorenz_like, push, np.diag([8.0, 8.0]), np.array([[20.0]]))
    assert run(observer, 4000)[-1] > 1e-2


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
