"""Adaptive velocity observer: velocity of a linear servo of unknown parameters, which it learns.

The plant x' = A x + B u, y = C x in observable canonical form is written (2)

    x' = A_c x + y L + u B,   theta = (L, B)

with A_c chosen, so that A = A_c + L C. From angle and input the observer learns theta and
estimates x; the velocity of the angle is C (A x + B u).

Two forms. `paper` is (11) to (13) by forward Euler at the sample times. `sampled` (default) uses
that x - Upsilon theta is a filter of y alone: the regressor Upsilon is filtered exactly for an
angle that changes linearly and an input that is held, and the law acts a posteriori, so that it
is stable for every gain and sample time. Both keep (31), xi+ = exp((A_c - K C) dt) xi, the second
one exactly.

Measurement: the angle [rad], unwrapped here since a spring needs it over several turns. Input: u
over the interval that ends at the sample.

Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; corrections in
docs/papers/adaptive.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.adaptive_filter import companion
from estimator_pkg.observers.adaptive_gains import GRADIENT, PAPER, SETTLED, Gains, structure
from estimator_pkg.observers.angle import is_angle, variance_floor
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import (
    COASTING,
    INITIALISING,
    NOT_OBSERVABLE,
    TRACKING,
    Functions,
    Observer,
)
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.observers.scatter import begin_scatter, follow_scatter, resume_scatter
from estimator_pkg.observers.unrolled import algebra

# What the parameter law does
INIT = 0       # the filters forget their start
ADAPTING = 1
GATED = 2      # the signals carry too little to tell the parameters apart
FROZEN = 3     # by order of the user
PHASES = ('INIT', 'ADAPTING', 'GATED', 'FROZEN')
REASONS = ('the filters forget their start values',
           'the signals tell the parameters apart',
           'the signals do not tell the parameters apart: too little excitation',
           "held by the user ('adapt' is false)")

REGULAR = 1.0 - 1e-9  # of the diagonal: what is singular but for rounding is singular
LOOK = 20          # samples between two looks at excitation and trust
DOUBT = 9.0        # the innovation's power may be so many times that of the noise, ...
CLOSE = 1e-4       # ... or so large a part of the motion's
SHORTEST = 0.5     # time over which both are averaged, at least [s]


class _Theta(NamedTuple):
    """Functions unrolled for which parameters are free.

    pick : (psi_y, psi_u, psi_1) -> the free parameters' entries of C Upsilon.
    explained : (psi_y, psi_u, psi_1, fixed) -> what the known parameters contribute.
    parts : (free, fixed) -> (L, B, load).
    """

    pick: Callable[..., tuple]
    explained: Callable[..., float]
    parts: Callable[..., tuple]


@lru_cache
def _theta(order: int, load: bool, free: tuple[int, ...]) -> _Theta:
    signals = [*(f'y[{i}]' for i in range(order)), *(f'u[{i}]' for i in range(order)),
               *([f'one[{order - 1}]'] if load else [])]
    known = [i for i in range(len(signals)) if i not in free]
    values = [f'x[{free.index(i)}]' if i in free else f'fixed[{i}]' for i in range(len(signals))]

    def vector(entries: list[str]) -> str:
        return '(' + ''.join(f'{entry}, ' for entry in entries) + ')'

    text = '\n'.join([
        f'def pick(y, u, one): return {vector([signals[i] for i in free])}',
        'def explained(y, u, one, fixed): return '
        + (' + '.join(f'fixed[{i}] * {signals[i]}' for i in known) or '0.0'),
        f'def parts(x, fixed): return ({vector(values[:order])}, '
        f'{vector(values[order:2 * order])}, {values[-1] if load else "0.0"})'])
    names: dict[str, Any] = {}
    exec(compile(text, '<parameters>', 'exec'), names)
    return _Theta(names['pick'], names['explained'], names['parts'])


def _gramian(column: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    """W = int exp(A's)' C'C exp(A s) ds: gives the noise of every output of the filters."""
    n = len(column)
    a = np.diag(np.ones(n - 1), 1)
    a[:, 0] = column
    both = np.kron(a.T, np.eye(n)) + np.kron(np.eye(n), a.T)
    c = np.zeros(n)
    c[0] = 1.0
    w = np.linalg.solve(both, -np.outer(c, c).ravel()).reshape(n, n)
    return _rows(0.5 * (w + w.T))


def _rows(matrix: Any) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(x) for x in row) for row in matrix)


def build(gains: Gains, circle: Circle) -> Functions:
    """The functions of the observer at these gains.

    State: (psi_y, psi_u, psi_1): first rows of the filtered regressor for y, u and 1; z: in the
    sampled form what is left of the start in x, in the paper form x itself; theta, free ones;
    information matrix; P of least squares; convention; scatter; (y [rad], time since the start
    [s], mean square of the innovation [rad^2], of the velocity, time spent adapting [s]);
    (phase, trusted, samples since the last look); the information and the innovation's mean
    square when theta last moved, for its standard deviation.

    Raises
    ------
    UsageError : gains that do not fit each other.
    """
    made = structure(gains)
    n, m = gains.order, len(made.free)
    is_paper, is_gradient = gains.form == PAPER, gains.law == GRADIENT
    if is_paper and not is_gradient:
        raise UsageError("form 'paper' has the gradient law only: set law to 'gradient'")
    has_load, bounded = gains.load, any(map(math.isfinite, (*made.low, *made.high)))
    is_diagonal = bool(np.all(made.gamma == np.diag(np.diag(made.gamma))))
    is_full = gains.velocity == 'full'
    is_gated, is_noise_gate = gains.gate != 'off', gains.gate == 'noise'
    second = n > 1

    filters = companion(n)
    rows, left, after, times = filters.rows, filters.left, filters.after, filters.times
    series = filters.euler if is_paper else filters.series
    vectors, free = algebra(n), algebra(m)
    dot, add, apply = vectors.dot, vectors.add, vectors.apply
    dot_m, add_m, apply_m = free.dot, free.add, free.apply
    times_m, clip_m, rank_one, exceeds = free.times, free.clip, free.rank_one, free.exceeds
    pick, explained, all_parts = _theta(n, has_load, made.free)
    zeros, none_known = (0.0,) * n, (0.0,) * len(made.names)

    unit, last = (1.0, *zeros[1:]), (*zeros[1:], 1.0)
    next_unit = (0.0, 1.0, *zeros[2:]) if second else zeros
    empty = _rows(np.zeros((m, m)))

    settle = SETTLED / made.slowest if gains.settle is None else gains.settle
    average = max(SHORTEST, SETTLED / made.slowest)
    pace = (-made.observer[-1]) ** (1.0 / n)  # geometric mean of the poles [1/s]
    start_p = _rows(np.diag(made.variance)) if not is_gradient else ((0.0,),)

    gramian = _gramian(made.observer)

    def floor_of_gate() -> tuple:
        if gains.gate == 'gamma':
            return _rows(gains.excitation * np.linalg.inv(made.gamma))
        noise = np.zeros((len(made.names), len(made.names)))
        noise[:n, :n] = gramian
        return _rows(gains.signal_to_noise * gains.excitation_memory
                     * noise[np.ix_(made.free, made.free)])

    def design() -> tuple:
        floor = variance_floor(gains.quantum)
        noise = gains.noise * gains.noise + floor if gains.noise is not None else 0.0
        return (made.observer, float(made.fastest), made.model, made.injection, made.fixed,
                made.start, (made.low, made.high),
                tuple(float(x) for x in np.diag(made.gamma)) if is_diagonal
                else _rows(made.gamma),
                floor_of_gate(), gramian,
                (float(settle), float(average), float(gains.memory),
                 float(gains.excitation_memory), float(pace)),
                (float(gains.adapt), float(gains.theta is not None)),
                (float(circle.period), float(circle.unwrap)), (noise, floor))

    def prepare(design: tuple, dt: float) -> tuple:
        f, g0, g1 = series(design[0], design[1], dt)
        average, memory, keep = design[10][1], design[10][2], design[10][3]
        return (rows(f, design[0]), g0, g1, dt, -math.expm1(-dt / average),
                -math.expm1(-LOOK * dt / average), math.exp(-dt / keep),
                math.exp(-dt / memory) if memory > 0.0 else 1.0)

    def parts(theta: tuple, design: tuple) -> tuple:
        """(L, B, load). Least squares itself goes on unbounded: held at a bound it would diverge,
        as P would count what theta has not done.
        """
        if bounded and not is_gradient:
            theta = clip_m(theta, design[6][0], design[6][1])
        return all_parts(theta, design[4])

    def states(inner: tuple, z: tuple, theta: tuple, design: tuple) -> tuple[float, float, float]:
        """The first two states x and the velocity without b1 u."""
        of_y, of_u, load = parts(theta, design)
        first = design[2][0] + of_y[0]
        if is_paper:
            x1 = z[0]
            x2 = z[1] if second else 0.0
            return x1, x2, x2 + first * x1
        y, u, one = inner
        injected = add(design[3], 1.0, of_y)
        x1 = z[0] + dot(y, injected) + dot(u, of_u)
        x2 = 0.0
        if second:
            a = design[0]
            x2 = (z[1] + dot(y, add(times(a, injected), -a[0], injected))
                  + dot(u, add(times(a, of_u), -a[0], of_u)))
        if has_load:
            x1 += load * one[n - 1]
            if second:
                x2 += load * (after(one, a)[n - 1] - a[0] * one[n - 1])
        return x1, x2, x2 + first * x1

    def started(u: tuple, theta: tuple, design: tuple, y: float, speed: float) -> tuple:
        """(filters, z) in steady state at this y [rad], with this speed [rad/s]."""
        rest = add(zeros, -1.0 / design[0][n - 1], last)
        inner = (add(zeros, y, rest), u, rest)
        of_y, of_u, load = parts(theta, design)
        x1, x2, w = states(inner, zeros, theta, design)
        wanted = speed - (design[2][0] + of_y[0]) * y
        if second:
            return inner, add(add(zeros, y - x1, unit), wanted - x2, next_unit)
        return inner, add(zeros, y - x1, unit)

    def init(measurement: float, design: tuple) -> tuple:
        theta = design[5]
        inner, z = started(zeros, theta, design, measurement, 0.0)
        if is_paper:
            z = paper_start(theta, design, measurement, 0.0)
        return (inner, z, theta, empty, start_p, begin(measurement), begin_scatter(measurement),
                (measurement, 0.0, 0.0, 0.0, 0.0), (INIT, 0, 0), (empty, 0.0))

    def moved(theta: tuple, p: tuple, psi: tuple, e: float, design: tuple, h: float,
              forget: float) -> tuple:
        """(theta, P) after the parameter law has seen an innovation e [rad]."""
        if is_gradient:
            if is_diagonal:
                direction = times_m(design[7], psi)
            else:
                direction = apply_m(design[7], psi)
            size = h * e if is_paper else h * e / (1.0 + h * dot_m(psi, direction))
        else:
            direction = apply_m(p, psi)
            spread = forget + dot_m(psi, direction)
            size = e / spread
            p = rank_one(p, 1.0 / forget, -1.0 / (forget * spread), direction)
        theta = add_m(theta, size, direction)
        if bounded and is_gradient:
            theta = clip_m(theta, design[6][0], design[6][1])
        return theta, p

    def expected(scatter: tuple, theta: tuple, design: tuple, h: float) -> float:
        """Variance of the innovation that the noise of the reading explains [rad^2]."""
        injected = add(design[3], 1.0, parts(theta, design)[0])
        return variance(scatter, design) * (1.0 + h * dot(injected, apply(design[9], injected)))

    def variance(scatter: tuple, design: tuple) -> float:
        """Of the reading's noise [rad^2]."""
        if design[13][0] > 0.0:
            return design[13][0]
        return scatter[0] if scatter[0] > design[13][1] else design[13][1]

    def judged(information: tuple, scatter: tuple, design: tuple, h: float) -> int:
        """What the parameter law may do."""
        if design[11][0] == 0.0:
            return FROZEN
        if is_gated:
            if is_noise_gate:
                open_now = exceeds(information, REGULAR, h * variance(scatter, design), design[8])
            else:
                open_now = exceeds(information, 1.0, 1.0, design[8])
            if not open_now:
                return GATED
        return ADAPTING

    def step(state: tuple, coefficients: tuple, design: tuple, measurement: float,
             given: float) -> tuple:
        ((psi_y, psi_u, psi_1), z, theta, information, p, convention, scatter,
         (y, age, power, speed_power, adapted), (phase, trusted, tick), kept) = state
        f, g0, g1, h, weight, slow_weight, keep, forget = coefficients
        period = design[12][0]
        change = measurement - convention[0]
        if period > 0.0 and not -0.5 * period <= change < 0.5 * period:
            change = wrap(change, period)
        if is_paper:
            e = y - z[0]
            of_y, of_u, load = parts(theta, design)
            slope = add(times(design[2], z), y, of_y)
            slope = add(add(slope, given, of_u), e, design[3])
            if has_load:
                slope = add(slope, load, last)
            before = (psi_y, psi_u, psi_1)
            psi = pick(psi_y, psi_u, psi_1)
            z = add(z, h, slope)
        psi_y = add(add(left(psi_y, f), y, g0), change, g1)
        psi_u = add(left(psi_u, f), given, g0)
        if has_load:
            psi_1 = add(left(psi_1, f), 1.0, g0)
        y += change
        if not is_paper:
            z = apply(f, z)
            psi = pick(psi_y, psi_u, psi_1)
            e = (y - z[0] - dot(psi_y, design[3]) - explained(psi_y, psi_u, psi_1, design[4])
                 - dot_m(psi, theta))
        age += h
        tick += 1
        if phase == INIT and age >= design[10][0]:
            phase = judged(information, scatter, design, h)
        if phase != INIT:
            information = rank_one(information, keep, h, psi)
            if phase == ADAPTING and design[11][0] > 0.0:
                was = theta
                theta, p = moved(theta, p, psi, e, design, h, forget)
                adapted += h
                if is_paper:  # the last term of (13), which must end with the law
                    of_y, of_u, load = all_parts(add_m(theta, -1.0, was), none_known)
                    z = add(z, 1.0, moved_by(before, of_y, of_u, load, design))
                kept = (information, power)
            power += (e * e - power) * weight
        if tick >= LOOK:
            tick = 0
            if phase != INIT:
                phase = judged(information, scatter, design, h)
                speed = states((psi_y, psi_u, psi_1), z, theta, design)[2]
                speed_power += (speed * speed - speed_power) * slow_weight
                most = DOUBT * expected(scatter, theta, design, h)
                close = CLOSE * speed_power / (design[10][4] * design[10][4])
                if power > 4.0 * most and power > 4.0 * close:
                    trusted = 0
                elif (power <= most or power <= close) and age > design[10][0] + design[10][1]:
                    trusted = 1
        return ((psi_y, psi_u, psi_1), z, theta, information, p,
                follow(convention, measurement, period),
                follow_scatter(scatter, measurement, h, period),
                (y, age, power, speed_power, adapted), (phase, trusted, tick), kept)

    def moved_by(inner: tuple, of_y: tuple, of_u: tuple, load: float, design: tuple) -> tuple:
        """Upsilon times a change of theta."""
        y, u, one = inner
        shift = add(apply(rows(y, design[0]), of_y), 1.0, apply(rows(u, design[0]), of_u))
        if has_load:
            shift = add(shift, load, apply(rows(one, design[0]), last))
        return shift

    def output(state: tuple, coefficients: tuple, design: tuple, measurement: float,
               given: float) -> tuple:
        x1, x2, speed = states(state[0], state[1], state[2], design)
        if is_full:
            speed += parts(state[2], design)[1][0] * given
        phase, trusted, tick = state[8]
        if phase == INIT:
            status = COASTING if trusted > 0 else INITIALISING
        elif phase == GATED and state[7][4] == 0.0 and design[11][1] == 0.0:
            status = NOT_OBSERVABLE
        else:
            status = TRACKING if trusted > 0 else INITIALISING
        return present(state[5], x1, design[12][0], design[12][1]), speed, math.nan, status

    def stddev(state: tuple, coefficients: tuple, design: tuple) -> tuple[float, float]:
        h = coefficients[3]
        of_y = parts(state[2], design)[0]
        injected = add(design[3], 1.0, of_y)
        first = design[2][0] + of_y[0] - design[0][0]
        to_speed = add(times(design[0], injected), first, injected)
        gramian = design[9]
        of_position = dot(injected, apply(gramian, injected))
        of_speed = dot(to_speed, apply(gramian, to_speed))
        power = variance(state[6], design)
        seen = state[7][2] / (1.0 + h * of_position)  # the innovation may show more than noise
        if seen > power:
            power = seen
        return math.sqrt(h * of_position * power), math.sqrt(h * of_speed * power)

    def resume(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        inner, z, theta, information, p, convention, scatter, numbers, flags, kept = state
        y = numbers[0] + wrap(measurement - convention[0], design[12][0])
        speed = states(inner, z, theta, design)[2]
        inner, z = started(inner[1], theta, design, y, speed)
        if is_paper:
            z = paper_start(theta, design, y, speed)
        return (inner, z, theta, information, p, follow(convention, measurement, design[12][0]),
                resume_scatter(scatter, measurement), (y, 0.0, numbers[2], numbers[3], numbers[4]),
                (INIT, flags[1], 0), kept)

    def paper_start(theta: tuple, design: tuple, y: float, speed: float) -> tuple:
        """x itself at this y [rad] with this speed [rad/s]."""
        x = add(zeros, y, unit)
        if second:
            first = design[2][0] + parts(theta, design)[0][0]
            x = add(x, speed - first * y, next_unit)
        return x

    def limits(dt: float) -> str | None:
        if is_paper and made.fastest * dt >= 2.0:
            return (f"form 'paper' is unstable at a sample time of {dt:.3g} s: its fastest pole "
                    f'needs less than {2.0 / made.fastest:.3g} s')
        return None

    return Functions(design, prepare, init, step, output, stddev, resume, limits,
                     lambda dt: math.nan, is_angle)


OBSERVER = Observer(
    name='adaptive', summary='velocity of a servo of unknown parameters, which it identifies',
    gains=Gains, build=build,
    reference='Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; sampled form '
              'of our own',
    kind='angle_and_input')
