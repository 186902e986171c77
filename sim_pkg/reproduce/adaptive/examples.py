# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of the adaptive paper: its two examples, in continuous time."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sim_pkg.reproduce.adaptive.plant import (
    IDENTIFICATION,
    STEP,
    VELOCITY,
    Array,
    Continuous,
    continuous,
    random_input,
    response,
    simulate,
    square,
)
from sim_pkg.reproduce.contract import Values, rms

NAMES = ('l1', 'l2', 'b1', 'b2')
FROZEN_FROM = 100.0  # when the parameters are frozen and the input changes [s]


# A1: velocity of the DC motor, 4.1


def example_1() -> Array:
    """Return the input of example 4.1 [V], random and then square; shape (140 s / STEP,)."""
    return np.concatenate([random_input(VELOCITY, FROZEN_FROM), square(40.0)])


def a1_values() -> Values:
    """The values of A1."""
    whole = continuous(VELOCITY, example_1(), freeze=FROZEN_FROM)
    end = whole.at(FROZEN_FROM)
    largest = np.abs(whole.velocity[: end + 1]).max()
    astray = np.flatnonzero(np.abs(whole.error[:end]) > 0.01 * largest)
    yield 'A1 within 1 %', whole.time[astray[-1]] + STEP
    yield 'A1 frozen', rms(whole.error[end:])


# A2: identification, 4.2


def parallel(theta: Array, inputs: Array) -> Array:
    """Return the angle of the identified model alone [rad], shape (n + 1,).

    Parameters
    ----------
    theta : shape (4,), as in `Example`.
    inputs : shape (n,), u of `Example`, each constant for one STEP.
    """
    first, last = IDENTIFICATION.model_poles
    l1, l2, b1, b2 = theta.tolist()
    matrix = [[first + last + l1, 1.0], [-first * last + l2, 0.0]]
    return simulate(matrix, [[b1], [b2]], inputs)


@lru_cache
def identified() -> Continuous:
    """Return the run of example 4.2, 400 s."""
    return continuous(IDENTIFICATION, random_input(IDENTIFICATION, 400.0))


def a2_values() -> Values:
    """The values of A2."""
    example, whole = IDENTIFICATION, identified()
    l1, l2, _, b2 = theta = whole.theta[-1]
    for name, value in zip(NAMES, theta):
        yield f'A2 theta(400) {name}', value
    inertia = example.Kv / b2
    first, last = example.model_poles
    yield 'A2 physical(400) J', inertia
    yield 'A2 physical(400) b', -inertia * (first + last + l1)
    yield 'A2 physical(400) k', -inertia * (-first * last + l2)
    inputs = random_input(example, 100.0, seed=999)
    yield 'A2 parallel 400 s', rms(parallel(theta, inputs) - response(example, inputs))
