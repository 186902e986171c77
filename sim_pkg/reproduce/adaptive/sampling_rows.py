"""Rows on sampling and noise, which the paper leaves open (A3, A4)."""

from __future__ import annotations

import math

import numpy as np

from sim_pkg.reproduce.adaptive.plant import (
    IDENTIFICATION,
    VELOCITY,
    Array,
    lcg,
    random_input,
    response,
)
from sim_pkg.reproduce.adaptive.rows import FORMS, NAMES, rms
from sim_pkg.reproduce.adaptive.runs import Run, gains, run
from sim_pkg.reproduce.contract import AT_LEAST, AT_MOST, PERCENT, Part, Reference, Values, family

# A3: sampling. a11 + l1, a21 + l2, b1, b2, rms error of (38) in the last 100 s of 800 s
QUANTITIES = ('-b/J', '-k/J', 'b1', 'b2', 'e_w')
SAMPLED = {
    (1, 'Euler'): (
        (-0.010300, 2e-6),
        (-0.299998, 2e-6),
        (1.0000e-4, 2e-8),
        (0.199999, 2e-6),
        (5.1e-4, 2e-5),
    ),
    (1, 'FOH'): (
        (-0.009999, 2e-6),
        (-0.299997, 2e-6),
        (-3.7e-7, 2e-8),
        (0.199998, 2e-6),
        (1.9e-6, 2e-7),
    ),
    (5, 'Euler'): (
        (-0.011500, 2e-6),
        (-0.299992, 2e-6),
        (4.9999e-4, 2e-8),
        (0.199995, 2e-6),
        (2.6e-3, 2e-4),
    ),
    (5, 'FOH'): (
        (-0.009984, 2e-6),
        (-0.299925, 2e-6),
        (-9.2e-6, 2e-7),
        (0.199950, 2e-6),
        (4.7e-5, 2e-6),
    ),
    (10, 'Euler'): (
        (-0.012999, 2e-6),
        (-0.299984, 2e-6),
        (9.9996e-4, 2e-8),
        (0.199989, 2e-6),
        (5.1e-3, 2e-4),
    ),
    (10, 'FOH'): (
        (-0.009935, 2e-6),
        (-0.299701, 2e-6),
        (-3.66e-5, 2e-7),
        (0.199801, 2e-6),
        (1.9e-4, 2e-5),
    ),
    (20, 'Euler'): (
        (-0.015998, 2e-6),
        (-0.299967, 2e-6),
        (1.9998e-3, 2e-7),
        (0.199978, 2e-6),
        (1.0e-2, 2e-3),
    ),
    (20, 'FOH'): (
        (-0.009741, 2e-6),
        (-0.298808, 2e-6),
        (-1.464e-4, 2e-7),
        (0.199205, 2e-6),
        (7.5e-4, 2e-5),
    ),
}
LATE = {
    (1, 'Euler'): 3.8e-3,
    (10, 'Euler'): 3.8e-2,
    (20, 'Euler'): 7.7e-2,
    (1, 'FOH'): 5.5e-6,
    (10, 'FOH'): 5.4e-4,
    (20, 'FOH'): 2.2e-3,
}
DIVERGES = {
    (10, 1): False,
    (10, 10): True,
    (10, 20): True,
    (100, 1): True,
    (100, 10): True,
    (100, 20): True,
}

A3 = (
    *(
        Reference(
            f'A3 {form} {h} ms {name}', 'after 800 s; e_w: rms of the last 100 s', value, tolerance
        )
        for (h, form), row in SAMPLED.items()
        for name, (value, tolerance) in zip(QUANTITIES, row)
    ),
    *family(
        'A3 Euler mapped back',
        'by the matrix logarithm of the step, at 20 ms',
        {'-b/J': -0.01, '-k/J': -0.3},
        1e-6,
    ),
    *family(
        'A3 late error',
        'largest error of (38), 90 to 100 s, example 4.1 [rad/s]',
        {f'{form} {h} ms': value for (h, form), value in LATE.items()},
        5.0,
        PERCENT,
    ),
    *(
        Reference(
            f'A3 Euler Gamma x {g}, {h} ms',
            'largest error of (38), 90 to 100 s [rad/s]',
            1e3,
            kind=AT_LEAST if diverges else AT_MOST,
        )
        for (g, h), diverges in DIVERGES.items()
    ),
    *(
        Reference(
            f'A3 FOH Gamma x {g}, {h} ms',
            'largest error of (38), 90 to 100 s [rad/s]',
            50.0,
            kind=AT_MOST,
        )
        for g, h in DIVERGES
    ),
)


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
    for h, form in SAMPLED:
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

NOISE = {
    (1e-2, 1e3): ((1e-3, 1.8e-3, 2.7e-3, 7e-4), 8.2e-3, 0.62),
    (1e-1, 1e3): ((1e-2, 1.8e-2, 2.7e-2, 6.8e-3), 8.2e-2, 6.2),
    (1e-1, 1e2): ((2e-3, 3e-3, 6e-3, 7e-3), 6.0e-2, 6.2),
}
MEANS = {
    (1e-2, 1e3): (1e-5, -9e-5, 1e-3, 3e-4),
    (1e-1, 1e3): (-1e-3, -1.7e-3, 1e-2, 3.4e-3),
    (1e-1, 1e2): (-7e-4, -2.8e-3, -5e-3, 2.5e-2),
}
ENCODERS = {
    '12 bit': (3.3e-4, 7.7e-4, 1.7e-3),
    '10 bit': (1.3e-3, 3.0e-3, 6.0e-3),
    'sigma 0.01': (8.2e-3, 1.7e-2, 3.2e-2),
}
STEPS = (1, 5, 20)  # [ms]

A4 = (
    Reference(
        'A4 0.001 1000 mean', 'largest mean parameter error, 800 to 1000 s', 1e-4, kind=AT_MOST
    ),
    Reference(
        'A4 0.001 1000 std', 'largest standard deviation of a parameter', 2.7e-4, 30.0, PERCENT
    ),
    Reference('A4 0.001 1000 e_w', 'rms error of (38) [rad/s]', 8e-4, 30.0, PERCENT),
    Reference(
        'A4 0.001 1000 difference',
        'rms error of a 10 Hz filtered difference [rad/s]',
        0.065,
        30.0,
        PERCENT,
    ),
    *(
        reference
        for (sigma, gamma), (spread, error, difference) in NOISE.items()
        for reference in (
            *family(
                f'A4 {sigma:g} {gamma:g} mean',
                'mean error of a parameter, 800 to 1000 s',
                dict(zip(NAMES, MEANS[sigma, gamma])),
                30.0,
                PERCENT,
            ),
            *family(
                f'A4 {sigma:g} {gamma:g} std',
                'standard deviation of a parameter',
                dict(zip(NAMES, spread)),
                30.0,
                PERCENT,
            ),
            Reference(
                f'A4 {sigma:g} {gamma:g} e_w', 'rms error of (38) [rad/s]', error, 30.0, PERCENT
            ),
            Reference(
                f'A4 {sigma:g} {gamma:g} difference',
                'rms error of a 10 Hz filtered difference [rad/s]',
                difference,
                30.0,
                PERCENT,
            ),
        )
    ),
    *(
        Reference(
            f'A4b {name} {h} ms', 'rms error of (38), last 200 s [rad/s]', value, 30.0, PERCENT
        )
        for name, values in ENCODERS.items()
        for h, value in zip(STEPS, values)
    ),
)


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
        for sigma, gamma in ((1e-3, 1e3), *NOISE):
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


PARTS = (Part('A3', A3, a3_values), Part('A4', A4, a4_values))
