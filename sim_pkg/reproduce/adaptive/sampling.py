# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows on sampling, noise and excitation, which the paper leaves open (A3, A4, A5)."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from sim_pkg.reproduce.adaptive.examples import FORMS, NAMES, rms
from sim_pkg.reproduce.adaptive.plant import (
    IDENTIFICATION,
    VELOCITY,
    Array,
    lcg,
    random_input,
    response,
)
from sim_pkg.reproduce.adaptive.runs import Run, gains, run
from sim_pkg.reproduce.contract import Values

# A3: sampling

# a11 + l1, a21 + l2, b1, b2, rms error of (38) in the last 100 s of 800 s
QUANTITIES = ('-b/J', '-k/J', 'b1', 'b2', 'e_w')


def _learnt(form: str, dt: float, seconds: float, scale: float | None = None) -> tuple[Run, Array]:
    """Return (run, error of (38)): example 4.1 with Gamma times `scale`, else example 4.2."""
    example = IDENTIFICATION if scale is None else VELOCITY
    inputs = random_input(example, dt, seconds)
    angles, speeds = response(example, inputs, dt)
    gamma = tuple((scale or 1.0) * value for value in example.gamma)
    found = run(gains(example, form=FORMS[form], gamma=gamma), angles, inputs, dt)
    return found, found.paper - speeds[1:]


def a3_values() -> Values:
    """The values of A3."""
    first, last = IDENTIFICATION.model_poles
    for h, form in product((1, 5, 10, 20), FORMS):
        found, error = _learnt(form, 1e-3 * h, 800.0)
        l1, l2, b1, b2 = found.theta[-1]
        row = (first + last + l1, -first * last + l2, b1, b2, rms(error[-round(1e5 / h) :]))
        for name, value in zip(QUANTITIES, row):
            yield f'A3 {form} {h} ms {name}', value
        if (h, form) == (20, 'Euler'):
            yield from _mapped_back(row, 1e-3 * h)
    for g in (1, 10, 100):
        for h in (1, 10, 20):
            for form in FORMS:
                error = _learnt(form, 1e-3 * h, 100.0, scale=float(g))[1][-round(1e4 / h) :]
                largest = np.abs(error).max() if np.all(np.isfinite(error)) else 1e300
                yield (
                    (
                        f'A3 late error {form} {h} ms'
                        if g == 1
                        else f'A3 {form} Gamma x {g}, {h} ms'
                    ),
                    largest,
                )


def _mapped_back(row: tuple[float, ...], dt: float) -> Values:
    """Yield the poles' sum and product of the continuous plant that Euler's step represents."""
    step = np.eye(2) + dt * np.array([[row[0], 1.0], [row[1], 0.0]])
    poles, vectors = np.linalg.eig(step.astype(complex))
    matrix = (vectors @ np.diag(np.log(poles)) @ np.linalg.inv(vectors) / dt).real
    yield 'A3 Euler mapped back -b/J', np.trace(matrix)
    yield 'A3 Euler mapped back -k/J', -np.linalg.det(matrix)


# A4: noise

# standard deviation of the angles [rad], Gamma; of the first only the largest values are rows
NOISE = ((1e-3, 1e3), (1e-2, 1e3), (1e-1, 1e3), (1e-1, 1e2))
ENCODERS = ('12 bit', '10 bit', 'sigma 0.01')
STEPS = (1, 5, 20)  # [ms]


def _filtered_difference(angles: Array, dt: float) -> Array:
    """Return a finite difference with a 10 Hz low-pass, a common baseline [rad/s]."""
    kept = math.exp(-20.0 * math.pi * dt)
    value = 0.0
    found = []
    for change in np.diff(angles).tolist():
        value = kept * value + (1.0 - kept) * change / dt
        found.append(value)
    return np.array(found)


def a4_values() -> Values:
    """The values of A4."""
    example = IDENTIFICATION
    for h in STEPS:
        dt = 1e-3 * h
        inputs = random_input(example, dt, 1000.0)
        angles, speeds = response(example, inputs, dt)
        noise = lcg(777, len(angles))
        last = round(200.0 / dt)
        for name in ENCODERS:
            if name == 'sigma 0.01':
                measured = angles + 0.01 * noise
            else:
                quantum = 2.0 * math.pi / 2.0 ** int(name[:2])
                measured = np.round(angles / quantum) * quantum
            found = run(gains(example), measured, inputs, dt)
            yield f'A4b {name} {h} ms', rms((found.paper - speeds[1:])[-last:])
        if h > 1:
            continue
        for sigma, gamma in NOISE:
            name = f'A4 {sigma:g} {gamma:g}'
            measured = angles + sigma * noise
            found = run(gains(example, gamma=(gamma,)), measured, inputs, dt)
            spread = found.theta[-last:].std(axis=0)
            if sigma == 1e-3:
                yield f'{name} mean', np.abs(found.theta[-last:].mean(axis=0) - example.theta).max()
                yield f'{name} std', spread.max()
            else:
                mean = found.theta[-last:].mean(axis=0) - example.theta
                for parameter, value, off in zip(NAMES, spread, mean):
                    yield f'{name} std {parameter}', value
                    yield f'{name} mean {parameter}', off
            yield f'{name} e_w', rms((found.paper - speeds[1:])[-last:])
            yield (
                f'{name} difference',
                rms((_filtered_difference(measured, dt) - speeds[1:])[-last:]),
            )


# A5: excitation and the effect of its lack

REST = -0.2 / 0.3  # where the spring of 4.2 balances a load of -0.2 rad/s^2 [rad]


def a5_values() -> Values:
    """The values of A5."""
    yield from _sines()
    yield from _drift()
    yield from _loads()
    yield from _held_load()


def _sines() -> Values:
    dt = 2e-3
    t = np.arange(150_000) * dt
    for name, frequencies in (('one sine', (0.7,)), ('two sines', (0.7, 1.9))):
        inputs = sum((np.sin(w * t) for w in frequencies), np.zeros_like(t))
        angles, speeds = response(VELOCITY, inputs, dt)
        found = run(gains(VELOCITY), angles, inputs, dt)
        for parameter, value in zip(NAMES, found.theta[-1]):
            yield f'A5a {name} theta {parameter}', value
        if name == 'one sine':
            yield 'A5a one sine e_y', rms((found.position - angles[1:])[-50_000:])
        yield f'A5a {name} e_w38', rms((found.paper - speeds[1:])[-50_000:])
        yield f'A5a {name} e_wful', rms((found.full - speeds[1:])[-50_000:])


def _drift() -> Values:
    example, dt = IDENTIFICATION, 2e-3
    noise = 0.01 * lcg(777, 2_000_001)
    inputs = np.zeros(len(noise) - 1)
    start = gains(example, theta=example.theta)
    found = run(start, noise, inputs, dt, every=500_000)
    for seconds, row in ((1000, 0), (4000, 3)):
        for i in (0, 1):
            yield (
                f'A5b drift at rest {seconds} s {NAMES[i]}',
                found.theta[row, i] - example.theta[i],
            )
    strong = gains(example, theta=example.theta, gamma=(1e6,))
    found = run(strong, noise[:150_001], inputs[:150_000], dt, every=150_000)
    for i in (0, 1):
        yield f'A5b drift at rest, Gamma 1e6 {NAMES[i]}', found.theta[0, i] - example.theta[i]
    part = (noise[:500_001], inputs[:500_000], dt, 50_000)
    for name, leak, dead_zone in (('leak', 0.01, 0.0), ('dead zone', 0.0, 0.04)):
        found = run(start, *part, leak=leak, dead_zone=dead_zone)
        yield f'A5b drift with other remedies {name}', np.abs(found.theta - example.theta).max()
    found = run(gains(example, theta=example.theta, adapt=False), *part)
    yield 'A5b drift with other remedies frozen', np.abs(found.theta - example.theta).max()
    for gate in ('gamma', 'noise'):
        found = run(
            gains(example, theta=example.theta, gate=gate), noise, inputs, dt, every=500_000
        )
        yield f'A5b drift with the gate {gate}', np.abs(found.theta - example.theta).max()


def _loads() -> Values:
    example, dt = IDENTIFICATION, 1e-3
    inputs = random_input(example, dt, 600.0)
    found = run(gains(example, gate='gamma'), response(example, inputs, dt)[0], inputs, dt)
    yield 'A5c gate in training', np.abs(found.theta[-1] - example.theta).max()
    yield 'A5c adapting', 100.0 * np.mean(found.phase == 1)
    inputs = random_input(example, dt, 800.0)
    angles = response(example, inputs, dt, load=-0.2)[0]
    first, last = example.model_poles
    for load in (False, True):
        theta = run(gains(example, load=load, gamma=(1e3,)), angles, inputs, dt).theta[-1]
        inertia = example.Kv / theta[3]
        b, k = -inertia * (first + last + theta[0]), -inertia * (-first * last + theta[1])
        if load:
            yield 'A5d load, learnt J', inertia
            yield 'A5d load, learnt b', b
            yield 'A5d load, learnt k', k
        else:
            yield 'A5d load, unmodelled: J', 100.0 * abs(inertia / example.J - 1.0)
            yield 'A5d load, unmodelled: b', 100.0 * abs(b / example.b - 1.0)


def _held_load() -> Values:
    example, dt = IDENTIFICATION, 1e-3
    angles = REST + 1e-3 * lcg(777, 600_001)
    inputs = np.zeros(600_000)
    own = -example.model_poles[0] * example.model_poles[1]

    def stiffness(
        zero: bool = False, leak: float = 0.0, dead_zone: float = 0.0, **changes: object
    ) -> Array:
        found = run(
            gains(example, theta=example.theta, **changes),
            angles,
            inputs,
            dt,
            10_000,
            from_zero=zero,
            leak=leak,
            dead_zone=dead_zone,
        )
        return -(own + found.theta[:, 1])

    plain = stiffness(zero=True)
    for seconds in (30, 100, 600):
        yield f'A5e load at rest, plain {seconds} s', plain[seconds // 10 - 1]
    for leak in (0.01, 0.1):
        yield f'A5e load at rest leak {leak:g}', stiffness(zero=True, leak=leak)[-1]
    yield 'A5e load at rest projection', stiffness(zero=True, bounds=('k/J>=0.1',))[-1]
    yield 'A5e load at rest dead zone', stiffness(zero=True, dead_zone=4e-3)[-1]
    yield 'A5e load at rest, gate gamma', stiffness(gate='gamma')[-1]
    yield 'A5e load at rest, gate noise', stiffness(gate='noise')[-1]
    yield (
        'A5e load at rest, gate noise, least squares',
        stiffness(gate='noise', law='least_squares')[-1],
    )
    yield 'A5e load at rest, frozen', stiffness(adapt=False)[-1]
