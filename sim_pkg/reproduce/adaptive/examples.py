# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of the adaptive paper: its two examples, and the vectors of the sampled recursions."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from estimator_pkg.circle import Circle
from estimator_pkg.estimate import Estimate
from estimator_pkg.observers.adaptive import observer as adaptive
from estimator_pkg.observers.adaptive.state import Coefficients, State
from sim_pkg.reproduce.adaptive.plant import (
    IDENTIFICATION,
    STEP,
    VELOCITY,
    Array,
    Continuous,
    Example,
    continuous,
    random_input,
    response,
    simulate,
    square,
)
from sim_pkg.reproduce.contract import Values

NAMES = ('l1', 'l2', 'b1', 'b2')
FROZEN_FROM = 100.0  # when the parameters are frozen and the input changes [s]


def rms(values: Array) -> float:
    """Return the root mean square of `values`, of any shape, in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))


# A1: velocity of the DC motor, 4.1


def example_1() -> Array:
    """Return the input of example 4.1 [V], random and then square; shape (140 s / STEP,)."""
    return np.concatenate([random_input(VELOCITY, STEP, FROZEN_FROM), square(STEP, 40.0)])


def a1_values() -> Values:
    """The values of A1."""
    whole = continuous(VELOCITY, example_1(), freeze=FROZEN_FROM)
    end = whole.at(FROZEN_FROM)
    largest = np.abs(whole.velocity[: end + 1]).max()
    for percent, part in (('1 %', 0.01), ('0.1 %', 0.001)):
        astray = np.flatnonzero(np.abs(whole.error[:end]) > part * largest)
        yield f'A1 within {percent}', whole.time[astray[-1]] + STEP
    for name, value, right in zip(NAMES, whole.theta[end], VELOCITY.theta):
        yield f'A1 theta(100) {name}', abs(value - right)
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
    return simulate(matrix, [[b1], [b2]], inputs, STEP)


@lru_cache
def identified() -> Continuous:
    """Return the run of example 4.2, 400 s."""
    return continuous(IDENTIFICATION, random_input(IDENTIFICATION, STEP, 400.0))


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
    inputs = random_input(example, STEP, 100.0, seed=999)
    angle = response(example, inputs, STEP)
    for t in (300, 400):
        yield f'A2 parallel {t} s', rms(parallel(whole.theta[whole.at(t)], inputs) - angle)


# A6: vectors of both sampled recursions

FORMS = {'Euler': 'paper', 'FOH': 'sampled'}


def a6_values() -> Values:
    """The values of A6."""
    example, dt, count = IDENTIFICATION, 1e-2, 1000
    inputs = random_input(example, dt, count * dt)
    angles = response(example, inputs, dt)
    for name, form in FORMS.items():
        position, theta = run(example, form, angles, inputs, dt)
        yield f'A6 {name} {count} xhat1', position
        for parameter, value in zip(NAMES, theta):
            yield f'A6 {name} {count} {parameter}', value


def run(
    example: Example, form: str, angles: Array, inputs: Array, dt: float
) -> tuple[float, list[float]]:
    """Return angle and theta of the observer `adaptive`, as the paper has it, after n samples.

    Parameters
    ----------
    angles : shape (n + 1,) [rad]. inputs : shape (n,), constant between the samples.
    """
    settings = adaptive.Gains(
        form=form,
        law='gradient',
        observer_poles=example.observer_poles,
        model_poles=example.model_poles,
        gamma=example.gamma,
        settle=0.0,
        gate='none',
        velocity='paper',
        start_variance=(1e6,),
        knock=0.0,
    )
    design, coefficients = adaptive.design(settings, Circle(0.0)), Coefficients()
    adaptive.prepare(coefficients, design, dt)
    state, out = State(), Estimate()
    adaptive.start(adaptive, state, design, float(angles[0]))
    for angle, given in zip(angles[1:].tolist(), inputs.tolist()):
        adaptive.step(adaptive, state, coefficients, design, angle, given)
        adaptive.estimate(adaptive, out, state, coefficients, design, angle, given)
    return out.position, state.theta
