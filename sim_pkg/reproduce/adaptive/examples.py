# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of the adaptive paper: its two examples, and the vectors of the sampled recursions."""

from __future__ import annotations

import numpy as np

from estimator_pkg.observers.mechanism.noise import exponential
from sim_pkg.reproduce.adaptive.plant import (
    IDENTIFICATION,
    RK4_STEP,
    VELOCITY,
    Array,
    continuous,
    held,
    random_input,
    response,
    square,
)
from sim_pkg.reproduce.adaptive.runs import gains, run
from sim_pkg.reproduce.contract import Values

NAMES = ('l1', 'l2', 'b1', 'b2')
FROZEN_FROM = 100.0  # when the parameters are frozen and the input changes [s]


def rms(values: Array) -> float:
    """Return the root mean square of `values`, of any shape, in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))


# A1: velocity of the DC motor, 4.1


def example_1() -> Array:
    """Return the input of example 4.1 [V], random and then square; shape (140 s / RK4_STEP,)."""
    return np.concatenate([random_input(VELOCITY, RK4_STEP, FROZEN_FROM), square(RK4_STEP, 40.0)])


def a1_values() -> Values:
    """The values of A1."""
    inputs = example_1()
    whole = continuous(VELOCITY, inputs, freeze=FROZEN_FROM)
    end = whole.at(FROZEN_FROM)
    largest = np.abs(whole.velocity[: end + 1]).max()
    yield 'A1 max |y|', np.abs(whole.angle[: end + 1]).max()
    yield 'A1 max |w|', largest
    for percent, part in (('1 %', 0.01), ('0.1 %', 0.001)):
        astray = np.flatnonzero(np.abs(whole.error[:end]) > part * largest)
        yield f'A1 within {percent}', whole.time[astray[-1]] + RK4_STEP
    for t in (5, 10, 20, 40):
        for name, value in zip(NAMES, whole.theta[whole.at(t)]):
            yield f'A1 theta({t}) {name}', value
        yield f'A1 |e_w| {t} s', abs(whole.error[whole.at(t)])
    for name, value, right in zip(NAMES, whole.theta[end], VELOCITY.theta):
        yield f'A1 theta(100) {name}', abs(value - right)
    yield 'A1 frozen', rms(whole.error[end:])
    for t in (5, 8, 12):
        for word, stays in (('off', False), ('on', True)):
            early = continuous(VELOCITY, inputs, freeze=t, injection_stays=stays)
            yield f'A1 frozen early, injection {word} {t} s', rms(early.error[early.at(t) :])
    for gamma in (10, 1000):
        scalar = continuous(VELOCITY, inputs[:end], gamma=(float(gamma),) * 4)
        yield f'A1 scalar Gamma {gamma}', np.abs(scalar.error[scalar.at(90.0) :]).max()


# A2: identification, 4.2


def parallel_error(theta: Array) -> float:
    """Return the rms angle error of the identified model under another input, 100 s [rad].

    `theta` has shape (4,), as in `Example`.
    """
    example = IDENTIFICATION
    inputs = random_input(example, RK4_STEP, 100.0, seed=999)
    return rms(parallel(theta, inputs) - response(example, inputs, RK4_STEP)[0])


def parallel(theta: Array, inputs: Array) -> Array:
    """Return the angle of the identified model alone [rad], shape (n + 1,).

    Parameters
    ----------
    theta : shape (4,), as in `Example`.
    inputs : shape (n,), u of `Example`, each constant for one RK4_STEP.
    """
    first, last = IDENTIFICATION.model_poles
    matrix = np.zeros((3, 3))
    matrix[:2] = [
        [first + last + theta[0], 1.0, theta[2]],
        [-first * last + theta[1], 0.0, theta[3]],
    ]
    step = exponential(matrix * RK4_STEP)
    x: Array = np.zeros(3)
    found = [0.0]
    for u in inputs:
        x[2] = u
        x = step @ x
        found.append(x[0])
    return np.array(found)


def a2_values() -> Values:
    """The values of A2."""
    example = IDENTIFICATION
    whole = continuous(example, random_input(example, RK4_STEP, 600.0))
    for t in range(100, 601, 100):
        l1, l2, b1, b2 = theta = whole.theta[whole.at(t)]
        if t < 600:
            for name, value in zip(NAMES, theta):
                yield f'A2 theta({t}) {name}', value
        inertia = example.Kv / b2
        first, last = example.model_poles
        for name, value in zip(
            ('J', 'b', 'k'),
            (inertia, -inertia * (first + last + l1), -inertia * (-first * last + l2)),
        ):
            yield f'A2 physical({t}) {name}', value
    for t in (300, 400):
        yield f'A2 parallel {t} s', parallel_error(whole.theta[whole.at(t)])
    for kind in ('uniform', 'Gauss'):
        times = sorted(_time_to_converge(kind, seed) for seed in range(12))
        yield f'A2 time to 0.002 {kind} min', times[0]
        yield f'A2 time to 0.002 {kind} median', np.median(times)
        yield f'A2 time to 0.002 {kind} max', times[-1]
    inputs = random_input(example, 1e-3, 60.0)
    found = run(
        gains(example, law='least_squares'), response(example, inputs, 1e-3)[0], inputs, 1e-3
    )
    error = np.abs(found.theta - example.theta).max(axis=1)
    yield 'A2 least squares time', found.time[np.flatnonzero(error > 0.01)[-1]]
    yield 'A2 least squares error', error[-1]


def _time_to_converge(kind: str, seed: int) -> float:
    example, dt = IDENTIFICATION, 5e-3
    random = np.random.default_rng(seed)
    values = (
        random.uniform(-np.sqrt(3.0), np.sqrt(3.0), 101)
        if kind == 'uniform'
        else random.normal(size=101)
    )
    inputs = held(values, example.hold, dt, 500.0)
    found = run(gains(example), response(example, inputs, dt)[0], inputs, dt)
    error = np.abs(found.theta - example.theta).max(axis=1)
    return float(found.time[np.flatnonzero(error > 0.002)[-1]])


# A6: vectors of both sampled recursions

SAMPLES = {'Euler': (10, 100, 1000, 40000), 'FOH': (1, 10, 100, 1000, 40000)}
FORMS = {'Euler': 'paper', 'FOH': 'sampled'}


def a6_values() -> Values:
    """The values of A6."""
    example, dt = IDENTIFICATION, 1e-2
    inputs = random_input(example, dt, 400.0)
    angles = response(example, inputs, dt)[0]
    for form, samples in SAMPLES.items():
        found = run(gains(example, form=FORMS[form]), angles, inputs, dt)
        for k in samples:
            yield f'A6 {form} {k} xhat1', found.position[k - 1]
            for name, value in zip(NAMES, found.theta[k - 1]):
                yield f'A6 {form} {k} {name}', value
