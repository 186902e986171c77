# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of Algorithm 1 at 100 Hz: Figure 6, stability, noise, and its limits.

The limits are ramps that it cannot follow, starts that do not lock, and tan.
A `run` takes angles [rad], shape (n,), one every PERIOD.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from estimator_pkg.observers.angle.hybrid import observer as hybrid_angle
from estimator_pkg.sensor.guard import longest_dt
from sim_pkg.joints import profiles
from sim_pkg.reproduce import splitmix
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.hybrid_angle.continuous import FOUR, K1, K2, SEEDS, rms
from sim_pkg.reproduce.hybrid_angle.sampled import (
    FIGURE_6,
    PERIOD,
    QUANTUM,
    TURN,
    Alone,
    Array,
    Run,
    algorithm_1,
    error_of,
    robust,
    rows,
    samples,
    wrapped,
)

START = 0.3  # angle of the shaft before the run-up [rad]
COLD = tuple(range(10, 311, 10))  # speeds of the cold starts [rad/s]
DECAYS = (0.15, 0.05)  # time constants of the run-down [s]: 1000 and 3000 rad/s^2
EPSILON = FIGURE_6['epsilon']
NO_RESET = 1e-6  # a delta_pi so small that J2 never applies [rad]


def figure_6_values() -> Values:
    """Rows F6, of Figure 6."""
    spread = 0.0
    for name in FOUR:
        resets = 0
        for decay in DECAYS:
            motion = profiles.figure_6(decay)
            _, velocity, angles = samples(motion, 8.0, start=START)
            run = algorithm_1(name, angles)
            error = error_of(run, velocity)
            resets += int(run.resets.sum())
            yield f'F6 RMS e2 [5,6) td={decay:g} {name}', rms(error[rows(5, 6)])
            if decay == DECAYS[0]:
                yield f'F6 RMS e2 [0,2) {name}', rms(error[rows(0, 2)])
                yield f'F6 mean xh2 [4,5) {name}', run.velocity[rows(4, 5)].mean()
            shifted = [
                rms(
                    error_of(
                        algorithm_1(name, samples(motion, 6.0, start=start)[2]), velocity[:601]
                    )[rows(5, 6)]
                )
                for start in range(-3, 4)
            ]
            spread = max(spread, max(shifted) - min(shifted))
        yield f'F6 J2 resets {name}', resets
    yield 'F6 spread of RMS e2 [5,6)', spread


def stability_values() -> Values:
    """Rows on the stability of Algorithm 1."""
    low, high = 0.2, 0.4
    while high - low > 1e-7:
        middle = 0.5 * (low + high)
        if max(abs(pole) for pole in z_poles(PERIOD / middle)) < 1.0:
            low = middle
        else:
            high = middle
    yield 'stability T/eps', low
    design = Alone(form='paper', **FIGURE_6).design
    refused = longest_dt(lambda dt: hybrid_angle.limits(design, dt))
    yield 'stability T/eps refused', refused / EPSILON
    slow, fast = sorted(z_poles(EPSILON), key=abs, reverse=True)
    yield 'stability slow z-pole', slow.real
    yield 'stability fast z-pole', fast.real
    _, velocity, angles = samples(profiles.constant(10.0), 6.0)
    converged = error_of(algorithm_1('saw', angles, epsilon=0.0340), velocity)
    yield 'stability saw eps=0.0340 |e2| at 6 s', abs(converged[-1])
    cycling = error_of(algorithm_1('sin', angles, epsilon=0.0335), velocity)
    yield 'stability sin eps=0.0335 limit cycle', rms(cycling[rows(5, 6)])
    yield 'stability order of line 3: position bias', unpredicted_bias(150.0)


def z_poles(epsilon: float) -> list[complex]:
    """Return the poles of Algorithm 1 near zero error, from its response to one small angle.

    The velocity's response h obeys h[k+2] = s h[k+1] - p h[k] with the sum s and the product p of
    the poles, which follow from four samples.
    """
    h = algorithm_1('saw', [1e-3, 0.0, 0.0, 0.0, 0.0], epsilon=epsilon).velocity[1:]
    total, product = np.linalg.solve([[h[1], -h[0]], [h[2], -h[1]]], [h[2], h[3]])
    return [complex(pole) for pole in np.roots([1.0, -total, product])]


def unpredicted_bias(speed: float) -> float:
    """Return the position error [rad] at `speed` [rad/s] if line 3 compares before predicting.

    Adding T times the observer's own speed to the measurement has the same effect as that line; the
    estimate is then compared with the true angle.
    """
    alone = Alone(form='paper', **FIGURE_6)
    for place in range(600):
        angle = speed * place * PERIOD
        alone.correct(angle + PERIOD * alone.core.velocity)
    return float(wrapped([angle - alone.core.position])[0])


DESIGNS: dict[str, Callable[[Array], Run]] = {
    'Algorithm 1 eps=0.1': partial(algorithm_1, 'saw'),
    'Algorithm 1 eps=0.07': partial(algorithm_1, 'saw', epsilon=0.07),
    'matched eps=0.1': partial(robust, 'saw'),
    'third order 10x3': partial(robust, 'saw', order=3, epsilon=1.0 / 10.0),
    'third order 15x3': partial(robust, 'saw', order=3, epsilon=1.0 / 15.0),
    'third order 20x3': partial(robust, 'saw', order=3, epsilon=1.0 / 20.0),
}


def noise_values() -> Values:
    """Rows on noise, and what each design trades for it in the run-down."""
    impulse = np.zeros(1000)
    impulse[0] = 1e-3
    yield (
        'noise sigma_v/sigma_y',
        math.sqrt(np.square(algorithm_1('saw', impulse).velocity / 1e-3).sum()),
    )
    yield 'noise sigma_v/sigma_y reported', reported_noise(form='paper', **FIGURE_6)
    yield 'noise sigma_v/sigma_y matched', reported_noise(order=2, epsilon=EPSILON)
    time, _, angles = samples(profiles.constant(150.0), 30.0, quantum=QUANTUM)
    settled = rows(4, 30)
    yield 'noise std xh2 14 bit', algorithm_1('saw', angles).velocity[settled].std()
    noisy = [wrapped(150.0 * time + splitmix.uniforms(seed, len(time), 0.002)) for seed in SEEDS]
    _, velocity, angles = samples(profiles.figure_6(DECAYS[0]), 8.0, start=START)
    for name, run in DESIGNS.items():
        std = float(np.mean([run(angle).velocity[settled].std() for angle in noisy]))
        yield f'noise std xh2 2 mrad {name}', std
        if name == 'Algorithm 1 eps=0.1':
            yield 'noise std xh2 2 mrad', std
        yield (
            f'noise RMS e2 [5,6) td=0.15 {name}',
            rms(error_of(run(angles), velocity)[rows(5, 6)]),
        )


def reported_noise(**gains: Any) -> float:
    """Return sigma_v/sigma_y [1/s] from the observer's own noise gain in steady state."""
    alone = Alone(**gains)
    for _ in range(1000):
        alone.correct(0.0)
    return math.sqrt(alone.noise_gains()[1])


def ramp_values() -> Values:
    """Rows on ramps.

    The capacity of sin and sat is l2 max|phi|. Algorithm 1 tests J2 after the correction, so saw
    reaches l2 pi. The slope of tan at the lag makes the discrete loop unstable above
    4/(2 alpha + beta) = 3.2, long before the 22900 of its formula.
    """
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


def start_values() -> Values:
    """Rows on starts."""
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


def tan_values() -> Values:
    """Rows on tan. J1 has reduced the position after an update by one turn."""
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
