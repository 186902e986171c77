"""Rows on excitation and the effect of its lack, which the paper leaves open (A5)."""

from __future__ import annotations

import numpy as np

from sim_pkg.reproduce.adaptive.plant import (
    IDENTIFICATION,
    VELOCITY,
    Array,
    lcg,
    random_input,
    response,
)
from sim_pkg.reproduce.adaptive.rows import NAMES, rms
from sim_pkg.reproduce.adaptive.runs import gains, run
from sim_pkg.reproduce.contract import AT_LEAST, AT_MOST, PERCENT, Part, Reference, Values, family

REST = -0.2 / 0.3  # where the spring of 4.2 balances a load of -0.2 rad/s^2 [rad]

A5 = (
    *family(
        'A5a one sine theta',
        'parameters after 300 s of sin 0.7 t, example 4.1',
        dict(zip(NAMES, (1.639, 1.7413, 10.542, 27.01))),
        0.1,
        PERCENT,
    ),
    Reference('A5a one sine e_y', 'rms error of the angle, last 100 s [rad]', 1e-5, 5.0, PERCENT),
    Reference('A5a one sine e_w38', 'rms error of (38), last 100 s [rad/s]', 7.47, 5.0, PERCENT),
    Reference(
        'A5a one sine e_wful',
        'rms error of the full formula, last 100 s [rad/s]',
        5.2e-3,
        5.0,
        PERCENT,
    ),
    *family(
        'A5a two sines theta',
        'parameters after 300 s of sin 0.7 t + sin 1.9 t',
        dict(zip(NAMES, (2.5053, 1.5073, 0.1251, 9.9508))),
        0.1,
        PERCENT,
    ),
    Reference('A5a two sines e_w38', 'rms error of (38), last 100 s [rad/s]', 0.26, 5.0, PERCENT),
    Reference(
        'A5a two sines e_wful',
        'rms error of the full formula, last 100 s [rad/s]',
        0.045,
        5.0,
        PERCENT,
    ),
    *family(
        'A5b drift at rest',
        'parameter error under noise alone (0.01 rad, 2 ms)',
        {'1000 s l1': 0.001, '1000 s l2': -0.004, '4000 s l1': 0.003, '4000 s l2': -0.018},
        6e-4,
    ),
    *family('A5b drift at rest, Gamma 1e6', 'after 300 s', {'l1': 0.13, 'l2': -1.32}, 5.0, PERCENT),
    *family(
        'A5b drift with the gate',
        'largest change in 4000 s',
        {'gamma': 1e-12, 'noise': 1e-12},
        kind=AT_MOST,
    ),
    *family(
        'A5b drift with other remedies',
        'largest change in 1000 s, leak 0.01/s, dead zone 0.04 rad, frozen',
        {'leak': 5e-4, 'dead zone': 1e-12, 'frozen': 1e-12},
        kind=AT_MOST,
    ),
    Reference(
        'A5c gate in training',
        'largest parameter error after 600 s with the gate',
        1.2e-5,
        kind=AT_MOST,
    ),
    Reference('A5c adapting', 'samples that adapt [%]', 98.8, 0.1),
    Reference('A5d load, unmodelled: J', 'error of J after 800 s [%]', 5.0, kind=AT_LEAST),
    Reference('A5d load, unmodelled: b', 'error of b after 800 s [%]', 300.0, kind=AT_LEAST),
    *family(
        'A5d load, learnt',
        'J, b, k with one more regressor',
        {'J': 10.0004, 'b': 0.1, 'k': 3.0},
        0.02,
        PERCENT,
    ),
    *family(
        'A5e load at rest, plain',
        'k/J, 0.3 is right, gradient without a gate',
        {'30 s': 0.154, '100 s': 0.018, '600 s': -0.0001},
        5e-3,
    ),
    *family(
        'A5e load at rest',
        'k/J after 600 s with other remedies: leak 0.01/s, leak 0.1/s, '
        'projection on 0.1, dead zone 0.004 rad',
        {'leak 0.01': 0.073, 'leak 0.1': 0.229, 'projection': 0.100, 'dead zone': 0.363},
        5.0,
        PERCENT,
    ),
    *family(
        'A5e load at rest, gate',
        'k/J after 600 s',
        {'gamma': 0.3, 'noise': 0.3, 'noise, least squares': 0.3},
        0.5,
        PERCENT,
    ),
    Reference('A5e load at rest, frozen', 'k/J after 600 s', 0.3, 0.5, PERCENT),
)


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
        every: int = 10_000,
        zero: bool = False,
        leak: float = 0.0,
        dead_zone: float = 0.0,
        **changes: object,
    ) -> Array:
        found = run(
            gains(example, theta=example.theta, **changes),
            angles,
            inputs,
            dt,
            every,
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


PARTS = (Part('A5', A5, a5_values),)
