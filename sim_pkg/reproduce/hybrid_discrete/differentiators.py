"""Rows of the differentiators on which the hybrid observer is built (B5 of the specification)."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from estimator_pkg.driver.compiled import compiled
from estimator_pkg.observers.angle.super_twisting import observer as super_twisting
from estimator_pkg.observers.circle import Circle
from sim_pkg.reproduce.adaptive.plant import Array, lcg
from sim_pkg.reproduce.contract import PERCENT, Part, Reference, Values, family

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
TOLERANCE = {'implicit': 1.0, 'matching': 5.0, 'taylor': 25.0, 'explicit': 25.0}  # [%]


def signal(t: Array) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration of the test signal."""
    w, u = math.pi, 2.6 * math.pi
    return (
        0.8 * np.sin(w * t) + 0.2 * np.sin(u * t),
        0.8 * w * np.cos(w * t) + 0.2 * u * np.cos(u * t),
        -0.8 * w * w * np.sin(w * t) - 0.2 * u * u * np.sin(u * t),
    )


@lru_cache
def _loop(form: str, order: int) -> Callable:
    correct = super_twisting.correction(form, order)
    step = super_twisting.euler if form == 'explicit' else super_twisting.taylor
    implicit = form == 'implicit'

    def loop(
        state: tuple, coefficients: tuple, dt: float, measured: Array, v: Array, a: Array
    ) -> None:
        for k in range(len(measured)):
            _, v[k], a[k], _ = step(state[:4], dt)
            state = correct(state, coefficients, measured[k])[0]
            if implicit:
                v[k], a[k] = state[1], state[2]

    return loop


def estimated(
    form: str, order: int, dt: float, measured: Array, bound: float = 0.0
) -> tuple[Array, Array]:
    """Return velocity and acceleration, shape (n,), started at rest at the first sample.

    Both are predictions before a sample is used, except for the implicit form, which uses it.
    """
    gains = super_twisting.Gains(order=order, form=form, bound=bound or BOUND[order])
    design = super_twisting.build(gains, Circle(0.0)).design()[0]
    v, a = np.empty(len(measured)), np.empty(len(measured))
    # one step before the first sample, at rest there, so that the prediction is the start itself
    first = super_twisting.at_rest(float(measured[0]))
    compiled(_loop(form, order))(
        first, super_twisting.prepare(design, dt), dt, np.asarray(measured, float), v, a
    )
    return v, a


ERRORS = {  # largest velocity error, by sample time [ms]
    0.1: (0.00823, 0.00106, 0.00955, 9.8e-6, 6.2e-5, 1.6e-8, 3.7e-6, 0.00106),
    1: (0.0805, 0.0106, 0.0940, 9.3e-4, 5.2e-3, 1.5e-5, 1.2e-3, 0.0106),
    5: (0.331, 0.0531, 0.417, 0.0256, 0.0779, 1.7e-3, 0.0351, 0.0531),
    10: (0.605, 0.106, 0.743, 0.0967, 0.218, 0.0148, 0.134, 0.106),
    20: (1.54, 0.212, 1.26, 0.398, 0.561, 0.134, 0.641, 0.212),
}
VECTORS = {  # z1 after samples 1, 2, 3, 10, 100, 1000 at 1 ms
    'o1 explicit': (0, 0.0275, 0.055, 0.2475, 2.7225, -2.9975),
    'o1 implicit': (0.0275, 0.055, 0.0825, 0.275, 2.75, -3.011738),
    'o1 matching': (0, 0.0259446, 0.0523025, 0.2396536, 2.6806321, -2.9929272),
    'o2 taylor': (0, 0.0096155, 0.0217601, 0.1434586, 3.2687512, -3.0185383),
    'o2 matching': (0, 0.0094631, 0.0214496, 0.1419374, 3.244337, -3.0182613),
    'o3 taylor': (0, 0.0084714, 0.0203895, 0.1604622, 4.4032246, -3.0191024),
    'o3 matching': (0, 0.0083294, 0.0200768, 0.1585548, 4.3688868, -3.0215016),
}
SAMPLES = (1, 2, 3, 10, 100, 1000)
ROUGH = (25.2, 0.040, 0.25, 0.27, 0.018, 0.0043, 0.0053)
NOISY = {  # largest and rms velocity error at 1 ms; last: a 20 Hz dirty derivative
    'eps 1e-5': (
        (0.091, 0.025),
        (0.029, 0.010),
        (0.094, 0.031),
        (0.0077, 0.0027),
        (0.0073, 0.0032),
        (0.0040, 0.0017),
        (0.0043, 0.0021),
        (0.17, 0.087),
    ),
    'eps 1e-4': (
        (0.131, 0.039),
        (0.107, 0.032),
        (0.102, 0.042),
        (0.027, 0.011),
        (0.027, 0.012),
        (0.020, 0.010),
        (0.020, 0.010),
        (0.18, 0.088),
    ),
    'eps 1e-3': (
        (0.272, 0.097),
        (0.269, 0.095),
        (0.269, 0.104),
        (0.106, 0.051),
        (0.106, 0.053),
        (0.101, 0.053),
        (0.104, 0.055),
        (0.32, 0.11),
    ),
    '12 bit': (
        (0.23, 0.090),
        (0.24, 0.090),
        (0.22, 0.096),
        (0.084, 0.043),
        (0.088, 0.045),
        (0.077, 0.044),
        (0.080, 0.045),
        (0.27, 0.10),
    ),
    '16 bit': (
        (0.10, 0.032),
        (0.074, 0.023),
        (0.095, 0.036),
        (0.017, 0.0069),
        (0.016, 0.0078),
        (0.011, 0.0056),
        (0.013, 0.0062),
        (0.18, 0.087),
    ),
}
ACCELERATION = {  # largest and rms acceleration error, forms with Taylor terms
    '12 bit': {'o2 taylor': (4.7, 2.6), 'o3 taylor': (3.4, 2.0)},
    '16 bit': {'o2 taylor': (2.3, 1.0), 'o3 taylor': (0.90, 0.51)},
    'eps 1e-5': {'o2 taylor': (1.7, 0.63), 'o3 taylor': (0.47, 0.24)},
}
VECTOR_ACCELERATION = {
    'o2 taylor': -13.035000,
    'o2 matching': -12.832002,
    'o3 taylor': -12.877244,
    'o3 matching': -13.098411,
}
COLD = {'time': 1.23, 'overshoot': 0.158}  # of L/v0, of v0
BOUNDS = {
    2.5: (4.9, 4.9),
    10: (2.06, 2.18),
    15: (0.64, 0.79),
    21: (0.0106, 0.217),
    25: (0.0106, 0.236),
    50: (0.0106, 0.298),
    100: (0.0106, 0.370),
    400: (0.0106, 0.750),
}
REST = {
    'o1 explicit': 0.0275,
    'o1 implicit': 0.0,
    'o1 matching': 0.0,
    'o2 matching': 0.0,
    'o3 matching': 0.0,
}


def _tolerance(column: str) -> float:
    return TOLERANCE[column.split()[1]]


def _near(value: float, sample: int) -> float:
    """Return half of the last printed digit for the first samples, a thousandth later."""
    return 1e-6 if sample <= 10 else 1e-3 * max(1.0, abs(value))


B5 = (
    *(
        Reference(
            f'B5 {column} {h:g} ms',
            'largest velocity error, 5 to 20 s [rad/s]',
            value,
            _tolerance(column),
            PERCENT,
        )
        for h, row in ERRORS.items()
        for column, value in zip(COLUMNS, row)
    ),
    *family(
        'B5 backward difference',
        'largest velocity error, 5 to 20 s [rad/s]',
        {f'{h:g} ms': row[-1] for h, row in ERRORS.items()},
        1.0,
        PERCENT,
    ),
    *(
        Reference(
            f'B5 vector {column} {sample}',
            'velocity after so many samples of 1 ms [rad/s]',
            value,
            _near(value, sample),
        )
        for column, row in VECTORS.items()
        for sample, value in zip(SAMPLES, row)
    ),
    *(
        Reference(
            f'B5 vector {column} acceleration', 'after 1000 samples of 1 ms [rad/s^2]', value, 1e-3
        )
        for column, value in VECTOR_ACCELERATION.items()
    ),
    *(
        Reference(
            f'B5 rough {column}',
            "rms of the velocity error's slope, 1 ms [rad/s^2]",
            value,
            _tolerance(column) + 2.0,
            PERCENT,
        )
        for column, value in zip(COLUMNS, ROUGH)
    ),
    *(
        Reference(
            f'B5 {name} {column} {what}',
            f'{what} velocity error at 1 ms [rad/s]',
            value,
            25.0,
            PERCENT,
        )
        for name, row in NOISY.items()
        for column, pair in zip((*COLUMNS, DIRTY), row)
        for what, value in zip(('max', 'rms'), pair)
    ),
    *(
        Reference(
            f'B5 acceleration {name} {column} {what}',
            f'{what} acceleration error [rad/s^2]',
            value,
            25.0,
            PERCENT,
        )
        for name, row in ACCELERATION.items()
        for column, pair in row.items()
        for what, value in zip(('max', 'rms'), pair)
    ),
    *(
        Reference(
            f'B5 cold {form} {what}, L {bound:g}, v0 {speed:g}',
            'until 1 % from v0 off [L/v0]; overshoot [v0]',
            value,
            2.0,
            PERCENT,
        )
        for form in FIRST_ORDER
        for bound, speed in STARTS
        for what, value in COLD.items()
    ),
    *family(
        'B5 jitter',
        'largest velocity error of o1 implicit, stamps 0.5 to 1.5 ms apart, with '
        'the nominal and the true dt [rad/s]',
        {'nominal': 0.687, 'true': 0.0159},
        1.0,
        PERCENT,
    ),
    *(
        Reference(
            f'B5 bound {bound:g} {name}',
            'largest velocity error of o1 implicit [rad/s]',
            value,
            25.0,
            PERCENT,
        )
        for bound, pair in BOUNDS.items()
        for name, value in zip(('exact', '12 bit'), pair)
    ),
    *(
        Reference(
            f'B5 at rest {column}',
            'largest |velocity| at rest, 1 ms [rad/s]',
            value,
            1e-9 if value == 0.0 else 1e-3,
        )
        for column, value in REST.items()
    ),
)


def _measured(name: str, exact: Array) -> Array:
    if name.endswith('bit'):
        quantum = 2.0 * math.pi / 2.0 ** int(name[:2])
        return np.round(exact / quantum) * quantum
    return exact + float(name[4:]) / math.sqrt(3.0) * lcg(777, len(exact))


def b5_values() -> Values:
    """The values of B5."""
    for h in ERRORS:
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
        if column in VECTOR_ACCELERATION:
            yield f'B5 vector {column} acceleration', a[1000]
        yield f'B5 rough {column}', _rms(np.diff((v - velocity)[judged]) / 1e-3)
        for name in NOISY:
            v, a = estimated(form, order, 1e-3, _measured(name, position))
            yield from _both(f'B5 {name} {column}', (v - velocity)[judged])
            if column in ACCELERATION.get(name, {}):
                yield from _both(f'B5 acceleration {name} {column}', (a - acceleration)[judged])
        if column in REST:
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
    correct = super_twisting.correction('implicit', 1)
    design = super_twisting.build(
        super_twisting.Gains(order=1, form='implicit', bound=BOUND[1]), Circle(0.0)
    ).design()[0]
    for name in ('nominal', 'true'):
        state, found = super_twisting.at_rest(float(position[0])), [0.0]
        for dt, angle in zip(steps.tolist(), position[1:].tolist()):
            coefficients = super_twisting.prepare(design, 1e-3 if name == 'nominal' else dt)
            state = correct(state, coefficients, angle)[0]
            found.append(state[1])
        yield f'B5 jitter {name}', np.abs((np.array(found) - velocity)[t >= FROM]).max()


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


PARTS = (Part('B5', B5, b5_values),)
