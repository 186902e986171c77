# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of the differentiators on which the hybrid observer is built (B5 of the specification)."""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg.circle import Circle
from estimator_pkg.observers.angle.super_twisting import observer as super_twisting
from sim_pkg.reproduce.adaptive.plant import Array, lcg
from sim_pkg.reproduce.contract import Values

BOUND = {1: 25.0, 2: 150.0, 3: 1000.0}  # bounds of the test signal's acceleration, jerk, snap
DURATION, FROM = 20.0, 5.0  # [s]; errors count from FROM on
COLUMNS = {
    'o1 explicit': ('explicit', 1),
    'o1 implicit': ('implicit', 1),
    'o1 matching': ('matching', 1),
    'o2 taylor': ('taylor', 2),
    'o2 matching': ('matching', 2),
    'o3 taylor': ('taylor', 3),
    'o3 matching': ('matching', 3),
}
DIRTY = '20 Hz dirty'
FIRST_ORDER = ('explicit', 'implicit', 'matching')
STARTS = ((5.0, 1.0), (25.0, 5.0), (100.0, 5.0))  # L, v0
TIMES = (0.1, 1, 5, 10, 20)  # sample times [ms]
SAMPLES = (1, 2, 3, 10, 100, 1000)  # of the vectors, at 1 ms
NOISY = ('eps 1e-5', 'eps 1e-4', 'eps 1e-3', '12 bit', '16 bit')
BOUNDS = (2.5, 10, 15, 21, 25, 50, 100, 400)


def signal(t: Array) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration of the test signal [rad, rad/s, rad/s^2].

    All have shape (n,), that of the times t [s].
    """
    w, u = math.pi, 2.6 * math.pi
    return (
        0.8 * np.sin(w * t) + 0.2 * np.sin(u * t),
        0.8 * w * np.cos(w * t) + 0.2 * u * np.cos(u * t),
        -0.8 * w * w * np.sin(w * t) - 0.2 * u * u * np.sin(u * t),
    )


def at_rest(measurement: float) -> super_twisting.Core:
    """Return a differentiator of a shaft that is known to rest at this angle [rad]."""
    core = super_twisting.Core()
    core.chain.x, core.ticks = measurement, 1
    return core


def made(form: str, order: int, bound: float = 0.0) -> super_twisting.Design:
    """Return what these gains imply, without a circle."""
    gains = super_twisting.Gains(order=order, form=form, bound=bound or BOUND[order])
    return super_twisting.design(gains, Circle(0.0))


def estimated(
    form: str, order: int, dt: float, measured: Array, bound: float = 0.0
) -> tuple[Array, Array]:
    """Return velocity and acceleration, shape (n,), started at rest at the first sample.

    Both are predictions before a sample is used, except for the implicit form, which uses it.
    """
    design, coefficients = made(form, order, bound), super_twisting.Coefficients()
    super_twisting.prepare(coefficients, design, dt)
    # one step before the first sample, at rest there, so that the prediction is the start itself
    core = at_rest(float(measured[0]))
    chain, half = core.chain, 0.0 if form == 'explicit' else 0.5 * dt
    rows = []
    for angle in np.asarray(measured, float).tolist():
        rows.append((chain.v + dt * (chain.a + half * chain.j), chain.a + dt * chain.j))
        super_twisting.correct(core, coefficients, design, angle)
        if form == 'implicit':
            rows[-1] = chain.v, chain.a
    v, a = np.array(rows).T
    return v, a


def _measured(name: str, exact: Array) -> Array:
    if name.endswith('bit'):
        quantum = 2.0 * math.pi / 2.0 ** int(name[:2])
        return np.round(exact / quantum) * quantum
    return exact + float(name[4:]) / math.sqrt(3.0) * lcg(777, len(exact))


def b5_values() -> Values:
    """The values of B5."""
    for h in TIMES:
        dt = 1e-3 * h
        t = np.arange(round(DURATION / dt) + 1) * dt
        position, velocity, _ = signal(t)
        judged = t >= FROM
        for column, (form, order) in COLUMNS.items():
            error = estimated(form, order, dt, position)[0] - velocity
            yield f'B5 {column} {h:g} ms', np.abs(error[judged]).max()
        difference = np.diff(position, prepend=position[0]) / dt - velocity
        yield f'B5 backward difference {h:g} ms', np.abs(difference[judged]).max()
    t = np.arange(round(DURATION / 1e-3) + 1) * 1e-3
    position, velocity, acceleration = signal(t)
    judged = t >= FROM
    for column, (form, order) in COLUMNS.items():
        v, a = estimated(form, order, 1e-3, position)
        for sample in SAMPLES:
            yield f'B5 vector {column} {sample}', v[sample]
        if order > 1:
            yield f'B5 vector {column} acceleration', a[1000]
        yield f'B5 rough {column}', _rms(np.diff((v - velocity)[judged]) / 1e-3)
        for name in NOISY:
            v, a = estimated(form, order, 1e-3, _measured(name, position))
            yield from _both(f'B5 {name} {column}', (v - velocity)[judged])
            if form == 'taylor' and name in ('12 bit', '16 bit', 'eps 1e-5'):
                yield from _both(f'B5 acceleration {name} {column}', (a - acceleration)[judged])
        if form != 'taylor':
            stopped = np.concatenate([position[:2000], np.full(8000, 0.3)])
            yield (
                f'B5 at rest {column}',
                np.abs(estimated(form, order, 1e-3, stopped)[0][-2000:]).max(),
            )
    for name in NOISY:
        error = _dirty(_measured(name, position), 1e-3) - velocity
        yield from _both(f'B5 {name} {DIRTY}', error[judged])
    yield from _cold_starts()
    yield from _jitter()
    for bound in BOUNDS:
        for name in ('exact', '12 bit'):
            measured = position if name == 'exact' else _measured(name, position)
            error = estimated('implicit', 1, 1e-3, measured, float(bound))[0] - velocity
            yield f'B5 bound {bound:g} {name}', np.abs(error[judged]).max()


def _both(name: str, error: Array) -> Values:
    yield f'{name} max', np.abs(error).max()
    yield f'{name} rms', _rms(error)


def _dirty(angles: Array, dt: float) -> Array:
    """Return a finite difference with a low-pass of 20 Hz [rad/s]."""
    kept, value, found = math.exp(-40.0 * math.pi * dt), 0.0, [0.0]
    for change in np.diff(angles).tolist():
        value = kept * value + (1.0 - kept) * change / dt
        found.append(value)
    return np.array(found)


def _cold_starts() -> Values:
    """Yield rows for order 1, started at rest on a shaft that turns at v0."""
    for form in FIRST_ORDER:
        for bound, speed in STARTS:
            dt = 1e-4 * speed / bound
            t = np.arange(60_000) * dt
            error = estimated(form, 1, dt, speed * t, bound)[0] / speed - 1.0
            name = f'L {bound:g}, v0 {speed:g}'
            last = np.flatnonzero(np.abs(error) > 0.01)[-1] + 1
            yield f'B5 cold {form} time, {name}', last * dt * bound / speed
            yield f'B5 cold {form} overshoot, {name}', error.max()


def _jitter() -> Values:
    """Yield rows for the implicit form of order 1, with jittered samples and nominal or true dt."""
    steps = 1e-3 * (1.0 + 0.5 * lcg(4242, 20_000) / math.sqrt(3.0))
    t = np.concatenate([[0.0], np.cumsum(steps)])
    position, velocity, _ = signal(t)
    design, coefficients = made('implicit', 1), super_twisting.Coefficients()
    for name in ('nominal', 'true'):
        core, found = at_rest(float(position[0])), [0.0]
        for dt, angle in zip(steps.tolist(), position[1:].tolist()):
            super_twisting.prepare(coefficients, design, 1e-3 if name == 'nominal' else dt)
            super_twisting.correct(core, coefficients, design, angle)
            found.append(core.chain.v)
        yield f'B5 jitter {name}', np.abs((np.array(found) - velocity)[t >= FROM]).max()


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
