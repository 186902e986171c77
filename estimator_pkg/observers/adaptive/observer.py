# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Adaptive velocity observer: velocity of a linear servo whose parameters it identifies.

The plant x' = A x + B u, y = C x in observable canonical form is written (2)

    x' = A_c x + y L + u B,   theta = (L, B)

with A_c chosen, so that A = A_c + L C. From angle and input the observer learns theta and
estimates x; the velocity of the angle is C (A x + B u). Optional regressors in the last equation
are a constant load, and gravity with the sine of the angle.

There are two forms. `paper` is (11) to (13) by forward Euler at the sample times. `sampled`
(default) uses that x - Upsilon theta is a filter of y only. The regressor Upsilon is filtered
exactly for an angle that changes linearly and an input that is constant over a sample. The law
uses the a posteriori innovation, so it is stable for every gain and sample time. Both forms fulfil
(31), xi+ = exp((A_c - K C) dt) xi, the second one exactly.

Measurement: the angle [rad], unwrapped here because a spring needs it over several turns. Input: u
over the interval that ends at the sample.

Files: `gains` the parameters, `filter` the filters, `motion` from parameters to velocity, `law` the
adaptation law, `evidence` the standard deviations of the parameters, `report` the report for users.

Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; corrections in
docs/papers/adaptive.md.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.adaptive.filter import companion
from estimator_pkg.observers.adaptive.gains import GRADIENT, PAPER, SETTLED, Gains, structure
from estimator_pkg.observers.adaptive.law import ADAPTING, GATED, INIT, law
from estimator_pkg.observers.adaptive.motion import as_rows, gramian, motion
from estimator_pkg.observers.adaptive.theta import unrolled_theta
from estimator_pkg.observers.angle.core import variance_floor
from estimator_pkg.observers.circle import LARGEST, Circle, is_angle, wrap
from estimator_pkg.observers.contract import (
    COASTING,
    INITIALISING,
    NOT_OBSERVABLE,
    TRACKING,
    Functions,
    Observer,
)
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.observers.maths.least_squares import kept
from estimator_pkg.observers.maths.scatter import begin_scatter, follow_scatter, resume_scatter
from estimator_pkg.observers.maths.unroll import algebra

LOOK = 20  # samples between two checks of excitation and trust
DOUBT = 9.0  # largest power of the slow innovation relative to that of the noise, ...
CLOSE = 2e-4  # ... or relative to that of the motion: then the velocity is right to 3 %
SHORTEST = 0.5  # shortest time over which both are averaged [s]
FRESH = 10.0  # factor by which they are averaged faster after a start
SURPRISE = 25.0  # a square is clamped to this multiple of the usual one


class Design(NamedTuple):
    """Everything that follows from the gains alone; companion matrices by their first column."""

    a_k: tuple  # of A_c - K C
    fastest: float  # upper bound of its poles' magnitudes [1/s]
    a_c: tuple  # of A_c
    k: tuple  # K, the injection
    fixed: tuple  # the known parameters in theta
    start: tuple  # initial values of the free parameters
    low: tuple  # bounds of the free parameters
    high: tuple
    gamma: tuple  # Gamma of the free parameters: its diagonal if it is diagonal
    floor: tuple  # the matrix that the information matrix must exceed to open the gate
    w: tuple  # `gramian` of A_c - K C
    settle: float  # settling time of the filters [s]
    average: float  # time over which the innovation's power is averaged [s]
    young: float  # age until which theta still converges [s]
    memory: float  # of least squares [s]
    keep: float  # memory of the information matrix [s]
    pace: float  # geometric mean of the poles [1/s]
    slowest: float  # slowest pole [1/s]
    knock: float  # square of e at a knock, relative to the usual square
    moving_above: float  # speed below which the joint may stick by dry friction [rad/s]
    adapt: float  # 1.0: theta may change
    has_theta: float  # 1.0: theta is a parameter that the user has set
    period: float  # wrap period [rad]; 0: none
    unwrap: float
    noise: float  # variance of the measurement noise [rad^2]; 0: estimated
    finest: float  # its smallest value, from the encoder's quantum [rad^2]
    p_start: tuple  # initial P of least squares


class Coefficients(NamedTuple):
    """Everything that follows from the sample time h."""

    f: tuple  # exp((A_c - K C) h)
    g0: tuple  # first row of its integral, for a constant input ...
    g1: tuple  # ... and for a ramp
    h: float  # sample time [s]
    weight: float  # of the newest sample in averages
    slow_weight: float  # of the newest check in averages
    keep: float  # part of the information matrix that is kept over a sample
    forget: float  # part of the information that least squares keeps over a sample
    low_pass: float  # weight of the newest sample in the low-passed innovation


def build(gains: Gains, circle: Circle) -> Functions:
    """Return the functions of the observer with these gains.

    `design` is a `Design` and `coefficients` are `Coefficients`. The state is a tuple of

    - (psi_y, psi_u, psi_1, psi_s): first rows of the filtered regressor for y, u, 1 and sin y;
    - z: in the sampled form the decaying effect of the initial state on x, in the paper form x;
    - the free parameters in theta; the information matrix; P of least squares;
    - convention; scatter;
    - (y [rad], time since the start [s], mean square of the innovation [rad^2], mean square of the
      velocity [rad^2/s^2], time spent adapting [s], remaining pause of the adaptation [s], usual
      square of the innovation while adapting [rad^2], innovation and acceleration after the
      low-pass, mean square of the low-passed innovation [rad^2]);
    - (phase, trusted, samples since the last check);
    - the sums of `evidence`.

    Raises
    ------
    UsageError : gains that contradict each other.
    """
    made = structure(gains)
    n, m = gains.order, len(made.free)
    is_paper, is_gradient = gains.form == PAPER, gains.law == GRADIENT
    if is_paper and not is_gradient:
        raise UsageError(
            f"form 'paper' does not have the law '{gains.law}': set law to 'gradient', or form to "
            "'sampled'"
        )
    if gains.moving_above > 0.0 and n < 2:
        raise UsageError(
            f"parameter 'moving_above' = {gains.moving_above:g} rad/s needs order 2 or more, not "
            f"{n}: set it to 0 or raise 'order'"
        )
    has_load, has_gravity = gains.load, gains.gravity
    is_full, is_watched, needs_motion = (
        gains.velocity == 'full',
        gains.knock > 0.0,
        gains.moving_above > 0.0,
    )
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

    settling = SETTLED / made.slowest if gains.settle is None else gains.settle
    average = max(SHORTEST, SETTLED / made.slowest)
    pace = (-made.observer[-1]) ** (1.0 / n)  # geometric mean of the poles [1/s]
    noise_of = gramian(made.observer)

    def floor_of_gate() -> tuple:
        if gains.gate == 'gamma':
            return as_rows(gains.excitation * np.linalg.inv(made.gamma))
        noise = np.zeros((len(made.names), len(made.names)))
        noise[:n, :n] = noise_of
        return as_rows(
            gains.signal_to_noise * gains.excitation_memory * noise[np.ix_(made.free, made.free)]
        )

    def design() -> Design:
        finest = variance_floor(gains.quantum)
        noise = gains.noise * gains.noise + finest if gains.noise is not None else 0.0
        is_diagonal = bool(np.all(made.gamma == np.diag(np.diag(made.gamma))))
        return Design(
            a_k=made.observer,
            fastest=float(made.fastest),
            a_c=made.model,
            k=made.injection,
            fixed=made.fixed,
            start=made.start,
            low=made.low,
            high=made.high,
            gamma=tuple(float(x) for x in np.diag(made.gamma))
            if is_diagonal
            else as_rows(made.gamma),
            floor=floor_of_gate(),
            w=noise_of,
            settle=float(settling),
            average=float(average),
            young=float(settling + 2.0 * average),
            memory=float(gains.memory),
            keep=float(gains.excitation_memory),
            pace=float(pace),
            slowest=float(made.slowest),
            knock=float(gains.knock * gains.knock),
            moving_above=float(gains.moving_above),
            adapt=float(gains.adapt),
            has_theta=float(gains.theta is not None),
            period=float(circle.period),
            unwrap=float(circle.unwrap),
            noise=noise,
            finest=finest,
            p_start=as_rows(np.diag(made.variance)) if not is_gradient else ((0.0,),),
        )

    def prepare(design: Any, dt: float) -> Coefficients:
        f, g0, g1 = series(design.a_k, design.fastest, dt)
        return Coefficients(
            rows(f, design.a_k),
            g0,
            g1,
            dt,
            -math.expm1(-dt / design.average),
            -math.expm1(-LOOK * dt / design.average),
            math.exp(-dt / design.keep),
            kept(dt, design.memory),
            -math.expm1(-dt * design.slowest),
        )

    def init(measurement: float, design: Any) -> tuple:
        theta = design.start
        inner, z = started(zeros, theta, design, measurement, 0.0)
        if is_paper:
            z = paper_start(theta, design, measurement, 0.0)
        return (
            inner,
            z,
            theta,
            empty,
            design.p_start,
            begin(measurement),
            begin_scatter(measurement),
            (measurement, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            (INIT, 0, 0),
            nothing,
        )

    def pause(
        paused: float,
        usual: float,
        e: float,
        psi_y: tuple,
        adapted: float,
        design: Any,
        weight: float,
    ) -> tuple[float, float]:
        """Return (remaining pause of the adaptation [s], usual square of the innovation [rad^2]).

        The plant's equation is not valid after a knock, and while dry friction may stop the joint.
        Adaptation pauses until the filters have forgotten that.
        """
        square = e * e
        if needs_motion and (
            -design.moving_above < -design.a_k[n - 1] * psi_y[n - 2] < design.moving_above
        ):
            paused = SETTLED / design.slowest
        elif is_watched:
            if adapted > design.average:
                if square > design.knock * usual:
                    paused = SETTLED / design.slowest
                if square > SURPRISE * usual:
                    square = SURPRISE * usual
            usual += (square - usual) * weight
        return paused, usual

    def step(
        state: tuple, coefficients: Any, design: Any, measurement: float, known_input: float
    ) -> tuple:
        inner, z, theta, information, p, convention, scatter, signals, flags, evidence = state
        psi_y, psi_u, psi_1, psi_s = inner
        y, age, power, speed_power, adapted, paused, usual, slow_e, slow_bend, slow_power = signals
        phase, trusted, tick = flags
        f, g0, g1, h, weight, slow_weight, keep, forget, low_pass = coefficients
        last_measurement, lowest, highest, wraps, turns = convention
        change, period = measurement - last_measurement, design.period
        if period > 0.0 and not -0.5 * period <= change < 0.5 * period:
            change = wrap(change, period)
        if is_paper:
            e = y - z[0]
            of_y, of_u, load, gravity = parts(theta, design)
            slope = add(times(design.a_c, z), y, of_y)
            slope = add(add(slope, known_input, of_u), e, design.k)
            if has_load:
                slope = add(slope, load, last)
            if has_gravity:
                slope = add(slope, gravity * math.sin(y), last)
            before = (psi_y, psi_u, psi_1, psi_s)
            psi = pick(psi_y, psi_u, psi_1, psi_s)
            z = add(z, h, slope)
        psi_y = add(add(left(psi_y, f), y, g0), change, g1)
        psi_u = add(left(psi_u, f), known_input, g0)
        if has_load:
            psi_1 = add(left(psi_1, f), 1.0, g0)
        if has_gravity:
            sine = math.sin(y)
            psi_s = add(add(left(psi_s, f), sine, g0), math.sin(y + change) - sine, g1)
        y += change
        if not is_paper:
            z = apply(f, z)
            psi = pick(psi_y, psi_u, psi_1, psi_s)
            e = (
                y
                - z[0]
                - dot(psi_y, design.k)
                - explained(psi_y, psi_u, psi_1, psi_s, design.fixed)
                - dot_m(psi, theta)
            )
        if not -LARGEST < e < LARGEST:
            return init(measurement, design)  # the state has diverged: start again
        age += h
        tick += 1
        if phase == INIT and age >= design.settle:
            phase = judged(information, scatter, design, h)
        if phase != INIT:
            information = rank_one(information, keep, h, psi)
            slow_e += (e - slow_e) * low_pass
            slow_bend += (y + dot(psi_y, design.a_k) - slow_bend) * low_pass
            if phase == ADAPTING and design.adapt > 0.0:
                if is_watched or needs_motion:
                    paused, usual = pause(paused, usual, e, psi_y, adapted, design, weight)
                if paused > 0.0:
                    paused -= h
                else:
                    was = theta
                    evidence = gathered(evidence, psi, e + dot_m(psi, theta), (slow_e, slow_bend))
                    theta, p = moved(theta, p, psi, e, design, h, forget)
                    adapted += h
                    if is_paper:  # the last term of (13), which must end with the law
                        of_y, of_u, load, gravity = all_parts(add_m(theta, -1.0, was), none_known)
                        z = add(z, 1.0, moved_by(before, of_y, of_u, load, gravity, design))
            recent = weight
            if age < design.young:  # while theta converges
                recent = FRESH * weight if FRESH * weight < 1.0 else 1.0
            power += (e * e - power) * recent
            slow_power += (slow_e * slow_e - slow_power) * recent
        if tick >= LOOK:
            tick = 0
            if phase != INIT:
                phase = judged(information, scatter, design, h)
                x1, x2, speed = states((psi_y, psi_u, psi_1, psi_s), z, theta, design)
                speed_power += (speed * speed - speed_power) * slow_weight
                most = DOUBT * expected(scatter, theta, design, h) * low_pass / (2.0 - low_pass)
                close = CLOSE * speed_power / (design.pace * design.pace)
                if slow_power > 4.0 * most and slow_power > 4.0 * close:
                    trusted = 0
                elif (slow_power <= most or slow_power <= close) and (
                    age > design.settle + design.average
                ):
                    trusted = 1
        convention = follow(convention, measurement, period)
        scatter = follow_scatter(scatter, measurement, h, period)
        inner, flags = (psi_y, psi_u, psi_1, psi_s), (phase, trusted, tick)
        signals = y, age, power, speed_power, adapted, paused, usual, slow_e, slow_bend, slow_power
        return inner, z, theta, information, p, convention, scatter, signals, flags, evidence

    def output(
        state: tuple, coefficients: Any, design: Any, measurement: float, known_input: float
    ) -> tuple:
        inner, z, theta, information, p, convention, scatter, signals, flags, evidence = state
        y, age, power, speed_power, adapted, paused, usual, slow_e, slow_bend, slow_power = signals
        phase, trusted, tick = flags
        x1, x2, speed = states(inner, z, theta, design)
        if is_full:
            of_y, of_u, load, gravity = parts(theta, design)
            speed += of_u[0] * known_input  # b1 u
        if phase == INIT:
            status = COASTING if trusted > 0 else INITIALISING
        elif phase == GATED and design.has_theta == 0.0 and adapted == 0.0:
            status = NOT_OBSERVABLE
        else:
            status = TRACKING if trusted > 0 else INITIALISING
        return present(convention, x1, design.period, design.unwrap), speed, math.nan, status

    def stddev(state: tuple, coefficients: Any, design: Any) -> tuple[float, float]:
        """Return one standard deviation of position [rad] and velocity [rad/s].

        They contain white noise through the filters, and the model error: a slow innovation e comes
        with a velocity error of (a1 - o1) e, where o1 and a1 are the first entries of A_c - K C and
        A.
        """
        inner, z, theta, information, p, convention, scatter, signals, flags, evidence = state
        y, age, power, speed_power, adapted, paused, usual, slow_e, slow_bend, slow_power = signals
        h, low_pass = coefficients.h, coefficients.low_pass
        of_y, of_u, load, gravity = parts(theta, design)
        injected = add(design.k, 1.0, of_y)  # K + L
        first = design.a_c[0] + of_y[0] - design.a_k[0]
        to_speed = add(times(design.a_k, injected), first, injected)
        of_position = h * dot(injected, apply(design.w, injected))
        of_speed = h * dot(to_speed, apply(design.w, to_speed))
        noise = variance(scatter, design)
        seen = (power - slow_power) / (1.0 + of_position)  # noise variance seen in the innovation
        if seen > noise:
            noise = seen
        slow = slow_power - noise * (1.0 + of_position) * low_pass / (2.0 - low_pass)
        if slow < 0.0:
            slow = 0.0
        return (
            math.sqrt(of_position * noise + slow),
            math.sqrt(of_speed * noise + first * first * slow),
        )

    def restart(state: tuple, coefficients: Any, design: Any, measurement: float) -> tuple:
        state = resume(state, coefficients, design, measurement)
        inner, z, theta, information, p, convention, scatter, signals, flags, evidence = state
        y, age, power, speed_power, adapted, paused, usual, slow_e, slow_bend, slow_power = signals
        inner, z = started(zeros, theta, design, y, 0.0)
        if is_paper:
            z = paper_start(theta, design, y, 0.0)
        flags = (INIT, 0, 0)
        return inner, z, theta, information, p, convention, scatter, signals, flags, evidence

    def resume(state: tuple, coefficients: Any, design: Any, measurement: float) -> tuple:
        inner, z, theta, information, p, convention, scatter, signals, flags, evidence = state
        psi_y, psi_u, psi_1, psi_s = inner
        y, age, power, speed_power, adapted, paused, usual, slow_e, slow_bend, slow_power = signals
        phase, trusted, tick = flags
        last_measurement, lowest, highest, wraps, turns = convention
        y += wrap(measurement - last_measurement, design.period)
        x1, x2, speed = states(inner, z, theta, design)
        inner, z = started(psi_u, theta, design, y, speed)
        if is_paper:
            z = paper_start(theta, design, y, speed)
        convention = follow(convention, measurement, design.period)
        scatter = resume_scatter(scatter, measurement)
        signals = (y, 0.0, power, speed_power, adapted, paused, usual, 0.0, 0.0, slow_power)
        flags = (INIT, trusted, 0)
        return inner, z, theta, information, p, convention, scatter, signals, flags, evidence

    def limits(dt: float) -> str | None:
        if is_paper and made.fastest * dt >= 2.0:
            return (
                f"form 'paper' is unstable at a sample time of {dt:.3g} s: its fastest pole "
                f"needs less than {2.0 / made.fastest:.3g} s; set form to 'sampled', or use slower "
                'observer poles'
            )
        return None

    return Functions(
        design,
        prepare,
        init,
        step,
        output,
        stddev,
        resume,
        limits,
        lambda dt: 0.0,  # with the plant's parameters it has no delay
        is_angle,
        restart=restart,
        driven=True,
    )


OBSERVER = Observer(
    name='adaptive',
    summary='velocity of a servo with unknown parameters, which it identifies',
    gains=Gains,
    build=build,
    reference='Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; sampled form '
    'of our own',
    kind='angle_and_input',
)
