"""Adaptive velocity observer: velocity of a linear servo of unknown parameters, which it learns.

The plant x' = A x + B u, y = C x in observable canonical form is written (2)

    x' = A_c x + y L + u B,   theta = (L, B)

with A_c chosen, so that A = A_c + L C. From angle and input the observer learns theta and
estimates x; the velocity of the angle is C (A x + B u). A constant load and gravity, the sine of
the angle, are known regressors in the last equation, by choice.

Two forms. `paper` is (11) to (13) by forward Euler at the sample times. `sampled` (default) uses
that x - Upsilon theta is a filter of y alone: the regressor Upsilon is filtered exactly for an
angle that changes linearly and an input that is held, and the law acts a posteriori, so that it
is stable for every gain and sample time. Both keep (31), xi+ = exp((A_c - K C) dt) xi, the second
one exactly.

Measurement: the angle [rad], unwrapped here since a spring needs it over several turns. Input: u
over the interval that ends at the sample.

Files: `adaptive_gains` the parameters, `adaptive_filter` the filters, `adaptive_motion` from
parameters to velocity, `adaptive_law` the law, `adaptive_evidence` what the data say of the
parameters, `adaptive_report` all of it in words.

Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; corrections in
docs/papers/adaptive.md.
"""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.adaptive_filter import companion
from estimator_pkg.observers.adaptive_gains import GRADIENT, PAPER, SETTLED, Gains, structure
from estimator_pkg.observers.adaptive_law import ADAPTING, GATED, INIT, law
from estimator_pkg.observers.adaptive_motion import as_rows, gramian, motion
from estimator_pkg.observers.adaptive_theta import unrolled_theta
from estimator_pkg.observers.angle import LARGEST, is_angle, variance_floor
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
from estimator_pkg.observers.least_squares import kept
from estimator_pkg.observers.scatter import begin_scatter, follow_scatter, resume_scatter
from estimator_pkg.observers.unrolled import algebra

LOOK = 20          # samples between two looks at excitation and trust
DOUBT = 9.0        # the slow innovation's power may be so many times that of the noise, ...
CLOSE = 2e-4       # ... or so large a part of the motion's: then the velocity is right to 3 %
SHORTEST = 0.5     # time over which both are averaged, at least [s]
FRESH = 10.0       # so many times faster they are averaged in the beginning
SURPRISE = 25.0    # a square counts at most so many times the usual one


def build(gains: Gains, circle: Circle) -> Functions:
    """The functions of the observer at these gains.

    State: (psi_y, psi_u, psi_1, psi_s): first rows of the filtered regressor for y, u, 1 and
    sin y; z: in the sampled form what is left of the start in x, in the paper form x itself;
    theta, free ones; information matrix; P of least squares; convention; scatter; (y [rad], time
    since the start [s], mean square of the innovation [rad^2], of the velocity, time spent
    adapting [s], for how long nothing is learnt [s], usual square of the innovation while
    learning, the innovation and the acceleration, both low-passed, mean square of the first
    [rad^2]); (phase, trusted, samples since
    the last look); evidence, see `adaptive_evidence`.

    Raises
    ------
    UsageError : gains that do not fit each other.
    """
    made = structure(gains)
    n, m = gains.order, len(made.free)
    is_paper, is_gradient = gains.form == PAPER, gains.law == GRADIENT
    if is_paper and not is_gradient:
        raise UsageError("form 'paper' has the gradient law only: set law to 'gradient'")
    if gains.moving_above > 0.0 and n < 2:
        raise UsageError("parameter 'moving_above' needs order 2 or more")
    has_load, has_gravity = gains.load, gains.gravity
    is_full, is_watched, needs_motion = (gains.velocity == 'full', gains.knock > 0.0,
                                         gains.moving_above > 0.0)
    moves, laws = motion(gains, made), law(gains, made, motion(gains, made))
    parts, states, started = moves.parts, moves.states, moves.started
    paper_start, moved_by = moves.paper_start, moves.moved_by
    moved, judged, expected, gathered = laws.moved, laws.judged, laws.expected, laws.gathered
    variance = laws.variance

    filters = companion(n)
    rows, left, times = filters.rows, filters.left, filters.times
    series = filters.euler if is_paper else filters.series
    vectors, free = algebra(n), algebra(m)
    dot, add, apply = vectors.dot, vectors.add, vectors.apply
    dot_m, add_m, rank_one = free.dot, free.add, free.rank_one
    chosen = unrolled_theta(n, has_load, has_gravity, made.free)
    pick, explained, all_parts = chosen
    zeros, none_known = (0.0,) * n, (0.0,) * len(made.names)
    last = (*zeros[1:], 1.0)
    empty = as_rows(np.zeros((m, m)))
    nothing = (empty, (0.0,) * m, (0.0, 0.0, 0.0))

    settle = SETTLED / made.slowest if gains.settle is None else gains.settle
    average = max(SHORTEST, SETTLED / made.slowest)
    pace = (-made.observer[-1]) ** (1.0 / n)  # geometric mean of the poles [1/s]
    noise_of = gramian(made.observer)

    def floor_of_gate() -> tuple:
        if gains.gate == 'gamma':
            return as_rows(gains.excitation * np.linalg.inv(made.gamma))
        noise = np.zeros((len(made.names), len(made.names)))
        noise[:n, :n] = noise_of
        return as_rows(gains.signal_to_noise * gains.excitation_memory
                       * noise[np.ix_(made.free, made.free)])

    def design() -> tuple:
        floor = variance_floor(gains.quantum)
        noise = gains.noise * gains.noise + floor if gains.noise is not None else 0.0
        is_diagonal = bool(np.all(made.gamma == np.diag(np.diag(made.gamma))))
        return (made.observer, float(made.fastest), made.model, made.injection, made.fixed,
                made.start, (made.low, made.high),
                tuple(float(x) for x in np.diag(made.gamma)) if is_diagonal
                else as_rows(made.gamma),
                floor_of_gate(), noise_of,
                (float(settle), float(average), float(gains.memory),
                 float(gains.excitation_memory), float(pace), float(made.slowest),
                 float(gains.knock * gains.knock), float(gains.moving_above)),
                (float(gains.adapt), float(gains.theta is not None)),
                (float(circle.period), float(circle.unwrap)), (noise, floor),
                as_rows(np.diag(made.variance)) if not is_gradient else ((0.0,),))

    def prepare(design: tuple, dt: float) -> tuple:
        f, g0, g1 = series(design[0], design[1], dt)
        average, memory, keep = design[10][1], design[10][2], design[10][3]
        return (rows(f, design[0]), g0, g1, dt, -math.expm1(-dt / average),
                -math.expm1(-LOOK * dt / average), math.exp(-dt / keep),
                kept(dt, memory), -math.expm1(-dt * design[10][5]))

    def init(measurement: float, design: tuple) -> tuple:
        theta = design[5]
        inner, z = started(zeros, theta, design, measurement, 0.0)
        if is_paper:
            z = paper_start(theta, design, measurement, 0.0)
        return (inner, z, theta, empty, design[14], begin(measurement), begin_scatter(measurement),
                (measurement, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (INIT, 0, 0), nothing)

    def pause(held: float, usual: float, e: float, psi_y: tuple, adapted: float, design: tuple,
              weight: float) -> tuple[float, float]:
        """(for how long nothing is learnt [s], usual square of the innovation).

        After a knock, and where dry friction may hold the joint, the equation of motion does not
        hold until the filters have forgotten it.
        """
        square = e * e
        if needs_motion and -design[10][7] < -design[0][n - 1] * psi_y[n - 2] < design[10][7]:
            held = SETTLED / design[10][5]
        elif is_watched:
            if adapted > design[10][1]:
                if square > design[10][6] * usual:
                    held = SETTLED / design[10][5]
                if square > SURPRISE * usual:
                    square = SURPRISE * usual
            usual += (square - usual) * weight
        return held, usual

    def step(state: tuple, coefficients: tuple, design: tuple, measurement: float,
             given: float) -> tuple:
        ((psi_y, psi_u, psi_1, psi_s), z, theta, information, p, convention, scatter,
         (y, age, power, speed_power, adapted, held, usual, slow_e, slow_bend, slow_power),
         (phase, trusted, tick), evidence) = state
        f, g0, g1, h, weight, slow_weight, keep, forget, low_pass = coefficients
        period = design[12][0]
        change = measurement - convention[0]
        if period > 0.0 and not -0.5 * period <= change < 0.5 * period:
            change = wrap(change, period)
        if is_paper:
            e = y - z[0]
            of_y, of_u, load, gravity = parts(theta, design)
            slope = add(times(design[2], z), y, of_y)
            slope = add(add(slope, given, of_u), e, design[3])
            if has_load:
                slope = add(slope, load, last)
            if has_gravity:
                slope = add(slope, gravity * math.sin(y), last)
            before = (psi_y, psi_u, psi_1, psi_s)
            psi = pick(psi_y, psi_u, psi_1, psi_s)
            z = add(z, h, slope)
        psi_y = add(add(left(psi_y, f), y, g0), change, g1)
        psi_u = add(left(psi_u, f), given, g0)
        if has_load:
            psi_1 = add(left(psi_1, f), 1.0, g0)
        if has_gravity:
            sine = math.sin(y)
            psi_s = add(add(left(psi_s, f), sine, g0), math.sin(y + change) - sine, g1)
        y += change
        if not is_paper:
            z = apply(f, z)
            psi = pick(psi_y, psi_u, psi_1, psi_s)
            e = (y - z[0] - dot(psi_y, design[3])
                 - explained(psi_y, psi_u, psi_1, psi_s, design[4]) - dot_m(psi, theta))
        if not -LARGEST < e < LARGEST:
            return init(measurement, design)  # numbers ran away: only a new start helps
        age += h
        tick += 1
        if phase == INIT and age >= design[10][0]:
            phase = judged(information, scatter, design, h)
        if phase != INIT:
            information = rank_one(information, keep, h, psi)
            slow_e += (e - slow_e) * low_pass
            slow_bend += (y + dot(psi_y, design[0]) - slow_bend) * low_pass
            if phase == ADAPTING and design[11][0] > 0.0:
                if is_watched or needs_motion:
                    held, usual = pause(held, usual, e, psi_y, adapted, design, weight)
                if held > 0.0:
                    held -= h
                else:
                    was = theta
                    evidence = gathered(evidence, psi, e + dot_m(psi, theta), (slow_e, slow_bend))
                    theta, p = moved(theta, p, psi, e, design, h, forget)
                    adapted += h
                    if is_paper:  # the last term of (13), which must end with the law
                        of_y, of_u, load, gravity = all_parts(add_m(theta, -1.0, was), none_known)
                        z = add(z, 1.0, moved_by(before, of_y, of_u, load, gravity, design))
            recent = weight
            if age < design[10][0] + 2.0 * design[10][1]:  # while theta is on its way
                recent = FRESH * weight if FRESH * weight < 1.0 else 1.0
            power += (e * e - power) * recent
            slow_power += (slow_e * slow_e - slow_power) * recent
        if tick >= LOOK:
            tick = 0
            if phase != INIT:
                phase = judged(information, scatter, design, h)
                speed = states((psi_y, psi_u, psi_1, psi_s), z, theta, design)[2]
                speed_power += (speed * speed - speed_power) * slow_weight
                most = (DOUBT * expected(scatter, theta, design, h)
                        * low_pass / (2.0 - low_pass))
                close = CLOSE * speed_power / (design[10][4] * design[10][4])
                if slow_power > 4.0 * most and slow_power > 4.0 * close:
                    trusted = 0
                elif (slow_power <= most or slow_power <= close) and (
                        age > design[10][0] + design[10][1]):
                    trusted = 1
        return ((psi_y, psi_u, psi_1, psi_s), z, theta, information, p,
                follow(convention, measurement, period),
                follow_scatter(scatter, measurement, h, period),
                (y, age, power, speed_power, adapted, held, usual, slow_e, slow_bend, slow_power),
                (phase, trusted, tick), evidence)

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
        """Of white noise through the filters, and of what the model lacks: a slow innovation e
        goes with an error of the velocity of (a1 - o1) e, o1 and a1 being the first entries of
        A_c - K C and A.
        """
        h, low_pass = coefficients[3], coefficients[8]
        of_y = parts(state[2], design)[0]
        injected = add(design[3], 1.0, of_y)
        first = design[2][0] + of_y[0] - design[0][0]
        to_speed = add(times(design[0], injected), first, injected)
        of_position = h * dot(injected, apply(design[9], injected))
        of_speed = h * dot(to_speed, apply(design[9], to_speed))
        power = variance(state[6], design)
        seen = (state[7][2] - state[7][9]) / (1.0 + of_position)  # it may show more than is known
        if seen > power:
            power = seen
        slow = state[7][9] - power * (1.0 + of_position) * low_pass / (2.0 - low_pass)
        if slow < 0.0:
            slow = 0.0
        return (math.sqrt(of_position * power + slow),
                math.sqrt(of_speed * power + first * first * slow))

    def restart(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        fresh, theta = resume(state, coefficients, design, measurement), state[2]
        y = fresh[7][0]
        inner, z = started(zeros, theta, design, y, 0.0)
        if is_paper:
            z = paper_start(theta, design, y, 0.0)
        return (inner, z, theta, fresh[3], fresh[4], fresh[5], fresh[6], fresh[7], (INIT, 0, 0),
                fresh[9])

    def resume(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        (inner, z, theta, information, p, convention, scatter,
         (y, age, power, speed_power, adapted, held, usual, slow_e, slow_bend, slow_power), flags,
         evidence) = state
        y += wrap(measurement - convention[0], design[12][0])
        speed = states(inner, z, theta, design)[2]
        inner, z = started(inner[1], theta, design, y, speed)
        if is_paper:
            z = paper_start(theta, design, y, speed)
        return (inner, z, theta, information, p, follow(convention, measurement, design[12][0]),
                resume_scatter(scatter, measurement),
                (y, 0.0, power, speed_power, adapted, held, usual, 0.0, 0.0, slow_power),
                (INIT, flags[1], 0), evidence)

    def limits(dt: float) -> str | None:
        if is_paper and made.fastest * dt >= 2.0:
            return (f"form 'paper' is unstable at a sample time of {dt:.3g} s: its fastest pole "
                    f'needs less than {2.0 / made.fastest:.3g} s')
        return None

    return Functions(design, prepare, init, step, output, stddev, resume, limits,
                     lambda dt: 0.0,  # with the plant's parameters it lags nothing
                     is_angle, restart=restart)


OBSERVER = Observer(
    name='adaptive', summary='velocity of a servo of unknown parameters, which it identifies',
    gains=Gains, build=build,
    reference='Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; sampled form '
              'of our own',
    kind='angle_and_input')
