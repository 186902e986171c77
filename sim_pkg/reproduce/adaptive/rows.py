"""Rows of the adaptive paper: its two examples, and the vectors of the sampled recursions."""

from __future__ import annotations

import numpy as np

from sim_pkg.reproduce.adaptive.plant import (
    IDENTIFICATION,
    RK4_STEP,
    VELOCITY,
    Array,
    continuous,
    exponential,
    held,
    random_input,
    response,
    square,
)
from sim_pkg.reproduce.adaptive.runs import gains, run
from sim_pkg.reproduce.contract import ABSOLUTE, AT_MOST, PERCENT, Part, Reference, Values, family

NAMES = ('l1', 'l2', 'b1', 'b2')
FROZEN_FROM = 100.0  # when the parameters are frozen and the input changes [s]


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


# A1: velocity of the DC motor, 4.1

A1_THETA = {
    5: (1.548828, 2.523197, -1.130413, 30.836372),
    10: (2.841124, 1.680930, -13.398951, 17.020510),
    20: (2.517461, 1.507999, -0.035927, 9.887306),
    40: (2.500256, 1.500194, -0.003959, 9.999076),
}
A1_ERROR = {5: (3.006, 5e-4), 10: (16.44, 5e-3), 20: (7.18e-2, 5e-5), 40: (3.2e-3, 5e-5)}
EARLY = {5: (9.82, 16.38), 8: (18.35, 27.51), 12: (0.356, 1.316)}

A1 = (
    Reference('A1 max |y|', 'largest angle, 0 to 100 s [rad]', 30.001, 1e-3),
    Reference('A1 max |w|', 'largest velocity, 0 to 100 s [rad/s]', 22.799, 1e-3),
    Reference(
        'A1 within 1 %',
        'time until (38) stays within 1 % of max |w| [s]',
        14.115,
        0.05,
        paper='Fig. 1a: before 40 s',
    ),
    Reference('A1 within 0.1 %', 'time until (38) stays within 0.1 % of max |w| [s]', 37.09, 0.2),
    *(
        reference
        for t, theta in A1_THETA.items()
        for reference in family(
            f'A1 theta({t})', f'parameters after {t} s', dict(zip(NAMES, theta)), 1e-2, PERCENT
        )
    ),
    *(
        Reference(f'A1 |e_w| {t} s', 'error of (38) [rad/s]', error, half_digit)
        for t, (error, half_digit) in A1_ERROR.items()
    ),
    *family(
        'A1 theta(100)', 'parameters after 100 s, error', dict.fromkeys(NAMES, 1e-6), kind=AT_MOST
    ),
    Reference(
        'A1 frozen',
        'rms error of (38) from 100 s on, parameters held, other input [rad/s]',
        1e-6,
        kind=AT_MOST,
        paper='practically zero',
    ),
    *family(
        'A1 frozen early, injection off',
        'rms error of (38) from then to 140 s [rad/s]',
        {f'{t} s': pair[0] for t, pair in EARLY.items()},
        2.0,
        PERCENT,
    ),
    *family(
        'A1 frozen early, injection on',
        'rms error of (38) from then to 140 s [rad/s]',
        {f'{t} s': pair[1] for t, pair in EARLY.items()},
        2.0,
        PERCENT,
    ),
    *family(
        'A1 scalar Gamma',
        'largest error of (38), 90 to 100 s [rad/s]',
        {'10': 5.3, '1000': 8.3},
        2.0,
        PERCENT,
    ),
)


def example_1() -> Array:
    """The input of example 4.1, random and then square [V]."""
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
    for t in A1_THETA:
        for name, value in zip(NAMES, whole.theta[whole.at(t)]):
            yield f'A1 theta({t}) {name}', value
        yield f'A1 |e_w| {t} s', abs(whole.error[whole.at(t)])
    for name, value, right in zip(NAMES, whole.theta[end], VELOCITY.theta):
        yield f'A1 theta(100) {name}', abs(value - right)
    yield 'A1 frozen', rms(whole.error[end:])
    for t in EARLY:
        for word, stays in (('off', False), ('on', True)):
            early = continuous(VELOCITY, inputs, freeze=t, injection_stays=stays)
            yield f'A1 frozen early, injection {word} {t} s', rms(early.error[early.at(t) :])
    for gamma in (10, 1000):
        scalar = continuous(VELOCITY, inputs[:end], gamma=(float(gamma),) * 4)
        yield f'A1 scalar Gamma {gamma}', np.abs(scalar.error[scalar.at(90.0) :]).max()


# A2: identification, 4.2

A2_THETA = {
    100: (4.2781248, 3.1747524, -5.634e-2, 0.5385532),
    200: (3.9930001, 3.4566641, -1.1429e-2, 0.1865342),
    300: (3.9878892, 3.4500353, 1.1893e-4, 0.1961522),
    400: (3.9899773, 3.4500204, 1.81e-6, 0.1999160),
    500: (3.9899991, 3.4499997, -5.06e-7, 0.1999965),
}
A2_PHYSICAL = {
    100: (3.713653, -1.03286, 2.13627),
    200: (10.721892, 0.0750523, 3.145116),
    300: (10.196163, 0.1234836, 3.058489),
    400: (10.004201, 0.100269, 3.001056),
    500: (10.000175, 0.1000108, 3.000055),
    600: (10.000001, 0.0999998, 3.000000),
}
B1_DIGIT = {100: 5e-6, 200: 5e-7, 300: 5e-9, 400: 5e-9, 500: 5e-10}  # half the last printed
PRINTED = {'l1': 3.99, 'l2': 3.45, 'b1': 1.0857e-5, 'b2': 0.2}
PHYSICAL = ('J', 'b', 'k')

A2 = (
    *(
        Reference(
            f'A2 theta({t}) {name}',
            f'parameter after {t} s',
            value,
            max(1e-4 * abs(value), B1_DIGIT[t] if name == 'b1' else 0.0),
            ABSOLUTE,
            PRINTED[name] if t >= 400 else None,
        )
        for t, theta in A2_THETA.items()
        for name, value in zip(NAMES, theta)
    ),
    *(
        Reference(
            f'A2 physical({t}) {name}',
            f'after {t} s, with Kv known',
            value,
            0.01,
            PERCENT,
            {'J': 10.0017, 'b': 0.09999, 'k': 3.0005}[name] if t >= 400 else None,
        )
        for t, values in A2_PHYSICAL.items()
        for name, value in zip(PHYSICAL, values)
    ),
    *family(
        'A2 parallel',
        'rms of y, model beside plant for 100 s of another input [rad]',
        {'300 s': 8.1e-2, '400 s': 1.56e-3},
        2.0,
        PERCENT,
        {'400 s': 0.0048},
    ),
    *family(
        'A2 time to 0.002',
        'all parameters within 0.002, over 12 seeds, FOH 5 ms [s]',
        {
            'uniform min': 145,
            'uniform median': 235,
            'uniform max': 406,
            'Gauss min': 170,
            'Gauss median': 250,
            'Gauss max': 413,
        },
        10.0,
        PERCENT,
    ),
    Reference('A2 least squares time', 'parameters within 0.01, 1 ms [s]', 1.52, 0.02),
    Reference(
        'A2 least squares error', 'largest parameter error after 60 s', 2.8e-6, 10.0, PERCENT
    ),
)


def parallel_error(theta: Array) -> float:
    """Return the rms angle error of the identified model under another input, 100 s [rad]."""
    example = IDENTIFICATION
    inputs = random_input(example, RK4_STEP, 100.0, seed=999)
    return rms(parallel(theta, inputs) - response(example, inputs, RK4_STEP)[0])


def parallel(theta: Array, inputs: Array) -> Array:
    """Return the angle of the identified model alone [rad], one longer than `inputs`."""
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
    for t in A2_PHYSICAL:
        l1, l2, b1, b2 = theta = whole.theta[whole.at(t)]
        if t in A2_THETA:
            for name, value in zip(NAMES, theta):
                yield f'A2 theta({t}) {name}', value
        inertia = example.Kv / b2
        first, last = example.model_poles
        for name, value in zip(
            PHYSICAL, (inertia, -inertia * (first + last + l1), -inertia * (-first * last + l2))
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

VECTORS = {
    'Euler': {
        10: (-7.476752657e-04, 4.192042135e-07, 6.502364219e-09, 1.773745411e-03, 7.659266036e-05),
        100: (-1.480187270e-01, 8.664334073e-03, 2.681942417e-03, 2.667477049e-02, 8.512654752e-02),
        1000: (-4.223719507e-01, 7.440460227e-01, 1.121438530e00, 2.913453951e-02, 1.455883561e00),
        40000: (-1.434186663e-01, 3.986978947, 3.450035514, 1.001031469e-03, 1.999081707e-01),
    },
    'FOH': {
        1: (-1.453996361e-06, 1.170573115e-11, 3.973951941e-14, 2.256196726e-06, 1.170615061e-08),
        10: (-8.116999961e-04, 7.063179891e-07, 1.706866453e-08, 1.985576431e-03, 1.074832488e-04),
        100: (-1.480696644e-01, 8.827414742e-03, 2.806082917e-03, 2.766898737e-02, 8.594991367e-02),
        1000: (-4.223660923e-01, 7.435180419e-01, 1.122319598e00, 3.012797754e-02, 1.452443843e00),
        40000: (-1.434186483e-01, 3.990042200, 3.450318885, -3.483751132e-05, 1.997169613e-01),
    },
}
FORMS = {'Euler': 'paper', 'FOH': 'sampled'}

A6 = tuple(
    reference
    for form, samples in VECTORS.items()
    for k, values in samples.items()
    for reference in family(
        f'A6 {form} {k}',
        f'after {k} samples of 10 ms, from rest',
        dict(zip(('xhat1', *NAMES), values)),
        1e-6 if k <= 1000 else 1e-4,
        PERCENT,
    )
)


def a6_values() -> Values:
    """The values of A6."""
    example, dt = IDENTIFICATION, 1e-2
    inputs = random_input(example, dt, 400.0)
    angles = response(example, inputs, dt)[0]
    for form, samples in VECTORS.items():
        found = run(gains(example, form=FORMS[form]), angles, inputs, dt)
        for k in samples:
            yield f'A6 {form} {k} xhat1', found.position[k - 1]
            for name, value in zip(NAMES, found.theta[k - 1]):
                yield f'A6 {form} {k} {name}', value


PARTS = (Part('A1', A1, a1_values), Part('A2', A2, a2_values), Part('A6', A6, a6_values))
