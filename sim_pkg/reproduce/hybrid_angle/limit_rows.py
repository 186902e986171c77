"""Rows on the limits of Algorithm 1: ramps it cannot follow, starts that do not lock, tan."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from sim_pkg.joints import profiles
from sim_pkg.reproduce.contract import (
    AT_LEAST,
    AT_MOST,
    EXACT,
    PERCENT,
    Part,
    Reference,
    Values,
    family,
)
from sim_pkg.reproduce.hybrid_angle.continuous import K1, K2
from sim_pkg.reproduce.hybrid_angle.continuous_rows import FOUR, four
from sim_pkg.reproduce.hybrid_angle.sampled import (
    FIGURE_6,
    PERIOD,
    TURN,
    Array,
    Run,
    algorithm_1,
    error_of,
    rms,
    robust,
    rows,
    samples,
    wrapped,
)

EPSILON = FIGURE_6['epsilon']

RAMPS = (
    Reference('ramp e2 at a=75', 'velocity lag, Algorithm 1 [rad/s]', 8.625, 0.001),
    Reference(
        'ramp e2 at a=75 third order', 'velocity lag, robust form of order 3 [rad/s]', 0.0, 0.001
    ),
    *family(
        'ramp e2 at a=600',
        'velocity error after 2 s at 600 rad/s^2 [rad/s]',
        four(995, 69.0, 69.0, 899),
        1.0,
    ),
    # The capacity of sin and sat is l2 max|phi|. Algorithm 1 tests J2 after the correction, so saw
    # reaches l2 pi. The slope of tan at the lag makes the discrete loop unstable above
    # 4/(2 alpha + beta) = 3.2, long before the 22900 of its formula.
    *family(
        'ramp measured capacity',
        'largest acceleration tracked by Algorithm 1 [rad/s^2]',
        {'sin': 500, 'tan': 1483, 'saw': 1571, 'sat': 500, 'sat M=0.03': 15},
        1.0,
        PERCENT,
    ),
    Reference('ramp e2 at 1200 rad/s', 'after a run-up in 20 s, above 2 pi/T [rad/s]', 0.0, 0.001),
)


def ramp_values() -> Values:
    """The values of RAMPS."""
    yield 'ramp e2 at a=75', ramp_errors(partial(algorithm_1, 'saw'), 75.0, 2.0)[-1]
    yield (
        'ramp e2 at a=75 third order',
        ramp_errors(partial(robust, 'saw', order=3), 75.0, 2.0)[-1],
    )
    for name in FOUR:
        yield f'ramp e2 at a=600 {name}', ramp_errors(partial(algorithm_1, name), 600.0, 2.0)[-1]
        yield f'ramp measured capacity {name}', capacity(partial(algorithm_1, name), 3000.0)
    yield ('ramp measured capacity sat M=0.03', capacity(partial(algorithm_1, 'sat', M=0.03), 30.0))
    motion = profiles.pieces([(20.0, 0.0, 1200.0), (20.0, 1200.0, 1200.0)])
    _, velocity, angles = samples(motion, 40.0)
    yield 'ramp e2 at 1200 rad/s', error_of(algorithm_1('saw', angles), velocity)[-1]


def ramp_errors(run: Callable[[Array], Run], acceleration: float, duration: float) -> Array:
    """Return velocity errors [rad/s], shape (n,), at this acceleration [rad/s^2] from rest."""
    motion = profiles.pieces([(duration, 0.0, acceleration * duration)])
    _, velocity, angles = samples(motion, duration)
    return error_of(run(angles), velocity)


def capacity(run: Callable[[Array], Run], high: float) -> float:
    """Return the acceleration [rad/s^2] below `high` up to which a ramp of 10 s is tracked.

    A ramp is tracked if its lag in the last second is that of small signals,
    a T (alpha/beta - 1/2), to 0.1 %.
    """
    lag = EPSILON * K1 / K2 - 0.5 * PERIOD
    low = 0.0
    while high - low > 1e-3 * high:
        middle = 0.5 * (low + high)
        errors = ramp_errors(run, middle, 10.0)[rows(9, 10)]
        if np.abs(errors / (lag * middle) - 1.0).max() < 1e-3:
            low = middle
        else:
            high = middle
    return low


COLD = tuple(range(10, 311, 10))  # speeds of the cold starts [rad/s]
NO_RESET = 1e-6  # a delta_pi so small that J2 never applies [rad]

STARTS = (
    *family(
        'start locked of 31',
        'cold starts at 10..310 rad/s locked within 6 s, Algorithm 1',
        four(27, 31, 26, 19),
        kind=EXACT,
    ),
    *family(
        'start locked of 31 without J2', 'the same with J2 off', four(27, 31, 26, 19), kind=EXACT
    ),
    *family(
        'start locked of 31 robust',
        'the same, robust form of order 2',
        four(30, 30, 30, 30),
        kind=AT_LEAST,
    ),
    Reference(
        'start false lock', 'mean e2 [4,5), saw, eps=0.4, run-up of Figure 6 [rad/s]', 104.8, 0.05
    ),
    Reference('start false lock std', 'how quiet the wrong speed is, std of e2 [rad/s]', 0.5, 0.05),
    Reference(
        'start false lock robust',
        'RMS e2 [4,5) of the robust form there [rad/s]',
        0.14,
        kind=AT_MOST,
    ),
    Reference(
        'start stationary tan',
        'start angles of 360 that end on an alias, Algorithm 1',
        8,
        kind=EXACT,
    ),
    Reference('start stationary tan worst', 'largest of those wrong speeds [rad/s]', 2513, 1.0),
    Reference(
        'start stationary tan robust', 'start angles of 360 that end on an alias', 0, kind=EXACT
    ),
)


def start_values() -> Values:
    """The values of STARTS."""
    for name in FOUR:
        yield f'start locked of 31 {name}', locked(partial(algorithm_1, name))
        yield (
            f'start locked of 31 without J2 {name}',
            locked(partial(algorithm_1, name, delta_pi=NO_RESET)),
        )
        yield f'start locked of 31 robust {name}', locked(partial(robust, name))
    _, velocity, angles = samples(profiles.figure_6(0.15), 5.0)
    error = error_of(algorithm_1('saw', angles, epsilon=0.4), velocity)[rows(4, 5)]
    yield 'start false lock', error.mean()
    yield 'start false lock std', error.std()
    yield (
        'start false lock robust',
        rms(error_of(robust('saw', angles, epsilon=0.4), velocity)[rows(4, 5)]),
    )
    degrees = wrapped(np.radians(np.arange(360) + 0.5))
    finals = np.array([algorithm_1('tan', [angle] * 600).velocity[-1] for angle in degrees])
    yield 'start stationary tan', np.sum(np.abs(finals) > 1.0)
    yield 'start stationary tan worst', np.abs(finals).max()
    finals = np.array([robust('tan', [angle] * 100).velocity[-1] for angle in degrees])
    yield 'start stationary tan robust', np.sum(np.abs(finals) > 1.0)


def locked(run: Callable[[Array], Run]) -> int:
    """Return how many speeds of COLD lock within 6 s from angle 0: |e2| < 0.1 rad/s from 5.5 s."""
    count = 0
    for speed in COLD:
        _, velocity, angles = samples(profiles.constant(float(speed)), 6.0)
        error = error_of(run(angles), velocity)
        count += bool(np.abs(error[rows(5.5, 6)]).max() < 0.1)
    return count


TAN = (
    Reference('tan one update at 150 deg', 'how far it moves xh1 [rad]', 4.48, 0.005),
    Reference('tan one update at 150 deg: error after', 'y - xh1 [deg]', -107, 0.5),
    Reference('tan one update at 175 deg', 'how far it moves xh1 [rad]', 27, 0.5),
    Reference('tan one update at 175 deg: xh2', 'the speed it leaves [rad/s]', 229, 0.5),
    Reference('tan outlier 3.13 rad', 'largest velocity error, 150 rad/s [rad/s]', 1880, 10.0),
    Reference(
        'tan outlier 3.13 rad: after 5 s', 'velocity error that stays [rad/s]', 100, kind=AT_LEAST
    ),
)


def tan_values() -> Values:
    """Yield the values of TAN. J1 has reduced the position after an update by one turn."""
    for degrees in (150, 175):
        angle = math.radians(degrees)
        run = algorithm_1('tan', [angle])
        yield f'tan one update at {degrees} deg', run.position[0] + TURN
        if degrees == 150:
            after = wrapped([angle - run.position[0]])[0]
            yield 'tan one update at 150 deg: error after', math.degrees(after)
        else:
            yield 'tan one update at 175 deg: xh2', run.velocity[0]
    _, velocity, angles = samples(profiles.constant(150.0), 10.0)
    angles[500] = wrapped([angles[500] + 3.13])[0]
    error = np.abs(error_of(algorithm_1('tan', angles), velocity))
    yield 'tan outlier 3.13 rad', error[500:].max()
    yield 'tan outlier 3.13 rad: after 5 s', error[-1]


PARTS = (
    Part('ramp', RAMPS, ramp_values),
    Part('start', STARTS, start_values),
    Part('tan', TAN, tan_values),
)
