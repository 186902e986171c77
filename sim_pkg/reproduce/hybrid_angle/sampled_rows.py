"""Rows of Algorithm 1 at 100 Hz: Figure 6, stability, noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from estimator_pkg.driver.compiled import longest_dt
from estimator_pkg.observers.angle.hybrid import observer as hybrid_angle
from estimator_pkg.observers.circle import Circle
from estimator_pkg.parameters import build
from sim_pkg.joints import profiles
from sim_pkg.reproduce import splitmix
from sim_pkg.reproduce.contract import AT_MOST, EXACT, PERCENT, Part, Reference, Values, family
from sim_pkg.reproduce.hybrid_angle.continuous_rows import FOUR, SEEDS, four
from sim_pkg.reproduce.hybrid_angle.sampled import (
    FIGURE_6,
    PERIOD,
    QUANTUM,
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

START = 0.3  # angle of the shaft before the run-up [rad]
DECAYS = (0.15, 0.05)  # time constants of the run-down [s]: 1000 and 3000 rad/s^2
EPSILON = FIGURE_6['epsilon']


FIGURE_6_ROWS = (
    *family(
        'F6 RMS e2 [0,2)',
        'RMS velocity error in the run-up [rad/s]',
        four(10.879, 10.875, 10.876, 10.876),
        0.05,
        paper=dict.fromkeys(FOUR, 'similar'),
    ),
    *family(
        'F6 mean xh2 [4,5)',
        'mean estimate at the steady speed [rad/s]',
        four(150.0, 150.0, 150.0, 150.0),
        0.1,
        paper=dict.fromkeys(FOUR, 150),
    ),
    *family(
        'F6 RMS e2 [5,6) td=0.15',
        'RMS velocity error, run-down at 1000 rad/s^2 [rad/s]',
        four(24.16, 24.01, 24.04, 24.04),
        1.0,
        PERCENT,
    ),
    *family(
        'F6 RMS e2 [5,6) td=0.05',
        'RMS velocity error, run-down at 3000 rad/s^2 [rad/s]',
        four(60.24, 30.56, 30.73, 46.37),
        1.0,
        PERCENT,
        {'sin': 'slower', 'tan': 'faster', 'saw': 'faster', 'sat': 'slower'},
    ),
    *family('F6 J2 resets', 'number of J2 jumps, both run-downs', four(0, 0, 0, 0), kind=EXACT),
    Reference(
        'F6 spread of RMS e2 [5,6)',
        'over 7 start angles, all injections [rad/s]',
        0.002,
        kind=AT_MOST,
    ),
)


def figure_6_values() -> Values:
    """The values of FIGURE_6_ROWS."""
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


STABILITY = (
    Reference(
        'stability T/eps', 'largest T/epsilon with both z-poles inside the circle', 0.29666, 1e-4
    ),
    Reference(
        'stability T/eps refused', 'T/epsilon from which the observer refuses to run', 0.29666, 1e-4
    ),
    Reference('stability slow z-pole', 'at epsilon 0.1 s', 0.911, 0.0005),
    Reference('stability fast z-pole', 'at epsilon 0.1 s', 0.439, 0.0005),
    Reference(
        'stability saw eps=0.0340 |e2| at 6 s', 'from rest, 10 rad/s [rad/s]', 1e-4, kind=AT_MOST
    ),
    Reference(
        'stability sin eps=0.0335 limit cycle', 'RMS velocity error, 5 to 6 s [rad/s]', 4.49, 0.5
    ),
    Reference(
        'stability order of line 3: position bias',
        'truth minus estimate at 150 rad/s if line 3 compares without predicting [rad]',
        -1.50,
        0.005,
    ),
)


def stability_values() -> Values:
    """The values of STABILITY."""
    low, high = 0.2, 0.4
    while high - low > 1e-7:
        middle = 0.5 * (low + high)
        if max(abs(pole) for pole in z_poles(PERIOD / middle)) < 1.0:
            low = middle
        else:
            high = middle
    yield 'stability T/eps', low
    core = hybrid_angle.core(build(hybrid_angle.Gains, {'form': 'paper', **FIGURE_6}), Circle())
    yield 'stability T/eps refused', longest_dt(core.limits) / EPSILON
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
    core = hybrid_angle.core(build(hybrid_angle.Gains, {'form': 'paper', **FIGURE_6}), Circle())
    design = core.design()
    coefficients = core.prepare(design, PERIOD)
    state = core.init(0.0, design)
    for place in range(600):
        angle = speed * place * PERIOD
        state, _ = core.correct(state, coefficients, angle + PERIOD * core.estimate(state)[1])
    return float(wrapped([angle - core.estimate(state)[0]])[0])


# name -> (form, order, epsilon or pole [1/s], std of xh2, RMS e2 [5,6)); spec 3.3
TRADE_OFF: dict[str, tuple[Callable[[Array], Run], float, float]] = {
    'Algorithm 1 eps=0.1': (partial(algorithm_1, 'saw'), 0.0065, 24.0),
    'Algorithm 1 eps=0.07': (partial(algorithm_1, 'saw', epsilon=0.07), 0.0123, 17.6),
    'matched eps=0.1': (partial(robust, 'saw'), 0.0053, 24.4),
    'third order 10x3': (partial(robust, 'saw', order=3, epsilon=1.0 / 10.0), 0.0049, 21.1),
    'third order 15x3': (partial(robust, 'saw', order=3, epsilon=1.0 / 15.0), 0.0089, 13.4),
    'third order 20x3': (partial(robust, 'saw', order=3, epsilon=1.0 / 20.0), 0.0135, 9.4),
}

NOISE = (
    Reference('noise sigma_v/sigma_y', 'measured from the impulse response [1/s]', 5.5048, 0.001),
    Reference('noise sigma_v/sigma_y told', 'as the observer reports it [1/s]', 5.5048, 0.001),
    Reference(
        'noise sigma_v/sigma_y matched',
        'robust form, as the observer reports it [1/s]',
        4.51,
        0.005,
    ),
    Reference('noise std xh2 14 bit', 'at 150 rad/s, quantisation alone [rad/s]', 0.00050, 0.00008),
    Reference(
        'noise std xh2 2 mrad',
        'at 150 rad/s, uniform +-2 mrad, mean of 3 seeds [rad/s]',
        0.00647,
        0.0006,
    ),
    *family(
        'noise std xh2 2 mrad',
        'as above, other designs [rad/s]',
        {name: row[1] for name, row in TRADE_OFF.items()},
        10.0,
        PERCENT,
    ),
    *family(
        'noise RMS e2 [5,6) td=0.15',
        'velocity error of each design in the run-down [rad/s]',
        {name: row[2] for name, row in TRADE_OFF.items()},
        1.0,
        PERCENT,
    ),
)


def noise_values() -> Values:
    """The values of NOISE."""
    impulse = np.zeros(1000)
    impulse[0] = 1e-3
    yield (
        'noise sigma_v/sigma_y',
        math.sqrt(np.square(algorithm_1('saw', impulse).velocity / 1e-3).sum()),
    )
    yield 'noise sigma_v/sigma_y told', reported_noise({'form': 'paper', **FIGURE_6})
    yield 'noise sigma_v/sigma_y matched', reported_noise({'order': 2, 'epsilon': EPSILON})
    time, _, angles = samples(profiles.constant(150.0), 30.0, quantum=QUANTUM)
    settled = rows(4, 30)
    yield 'noise std xh2 14 bit', algorithm_1('saw', angles).velocity[settled].std()
    noisy = [wrapped(150.0 * time + splitmix.uniforms(seed, len(time), 0.002)) for seed in SEEDS]
    _, velocity, angles = samples(profiles.figure_6(DECAYS[0]), 8.0, start=START)
    for name, (run, _, _) in TRADE_OFF.items():
        std = float(np.mean([run(angle).velocity[settled].std() for angle in noisy]))
        yield f'noise std xh2 2 mrad {name}', std
        if name == 'Algorithm 1 eps=0.1':
            yield 'noise std xh2 2 mrad', std
        yield (
            f'noise RMS e2 [5,6) td=0.15 {name}',
            rms(error_of(run(angles), velocity)[rows(5, 6)]),
        )


def reported_noise(gains: dict[str, float | str]) -> float:
    """Return sigma_v/sigma_y [1/s] from the observer's own noise gain in steady state."""
    core = hybrid_angle.core(build(hybrid_angle.Gains, gains), Circle())
    design = core.design()
    coefficients = core.prepare(design, PERIOD)
    state = core.init(0.0, design)
    for _ in range(1000):
        state, _ = core.correct(state, coefficients, 0.0)
    return math.sqrt(core.noise_gains(state, coefficients)[1])


PARTS = (
    Part('F6', FIGURE_6_ROWS, figure_6_values),
    Part('stability', STABILITY, stability_values),
    Part('noise', NOISE, noise_values),
)
