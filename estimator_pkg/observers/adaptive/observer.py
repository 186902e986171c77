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

Files: `state` the records, `structure` what follows from the gains, `filter` the filters, `motion`
from parameters to velocity, `law` the adaptation law, `evidence` the standard deviations of the
parameters, `report` the report for users.

Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; corrections in
docs/papers/adaptive.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import add
from typing import Any

import numpy as np

from estimator_pkg.circle import LARGEST, Circle, wrap
from estimator_pkg.circle import is_angle as is_reading  # noqa: F401
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.adaptive.filter import euler, feed, rows, series
from estimator_pkg.observers.adaptive.law import (
    ADAPTING,
    GATED,
    INIT,
    adapt,
    expected,
    gather,
    judged,
    variance,
)
from estimator_pkg.observers.adaptive.motion import (
    euler_step,
    follow_parameters,
    gramian,
    set_plant,
    settle,
    signals,
    states,
)
from estimator_pkg.observers.adaptive.state import Coefficients, Design, State
from estimator_pkg.observers.adaptive.structure import Structure, structure
from estimator_pkg.observers.angle.shared import variance_floor
from estimator_pkg.observers.contract import (
    COASTING,
    INITIALISING,
    NOT_OBSERVABLE,
    TRACKING,
    Deviation,
    Estimate,
    Observer,
)
from estimator_pkg.observers.contract import no_reason as why  # noqa: F401
from estimator_pkg.observers.maths.least_squares import kept
from estimator_pkg.observers.maths.vectors import add_square, dot, empty, quadratic, transformed
from estimator_pkg.parameters import parameter, structural
from estimator_pkg.sensor.convention import begin_convention, follow_convention, present
from estimator_pkg.sensor.scatter import begin_scatter, follow_scatter, resume_scatter

SINGLE_ANGLE, EDGES, TURNS, DRIVEN = False, False, False, True
SAMPLED_FORM, PUBLISHED_FORM = 'sampled', 'paper'
GRADIENT, LEAST_SQUARES = 'gradient', 'least_squares'
FILTER_SETTLING = 5.0  # time constants of the slowest pole until the filters have settled
CHECK_SAMPLES = 20  # samples between two checks of excitation and trust
SLOW_POWER_RATIO = 9.0  # largest power of the slow innovation relative to that of the noise, ...
MOTION_POWER_RATIO = 2e-4  # ... or to that of the motion: then the velocity is right to 3 %
LEAST_AVERAGE = 0.5  # shortest time over which both are averaged [s]
START_SPEEDUP = 10.0  # factor by which they are averaged faster after a start
SQUARE_CLIP = 25.0  # a square is clamped to this multiple of the usual one


@dataclass(frozen=True)
class Gains:
    """Parameters of `adaptive`."""

    order: int = structural(
        2,
        range=(1, 6),
        description='order of the plant from input to angle; 2: inertia, damping and spring',
        equation='(1), observable canonical form',
    )
    form: str = structural(
        SAMPLED_FORM,
        choices=(SAMPLED_FORM, PUBLISHED_FORM),
        description='sampled: filters exact for the sample time and a step that is stable for '
        'every gain; paper: (11) to (13) by forward Euler, whose damping b/J has an error of '
        'dt k/J',
    )
    law: str = structural(
        LEAST_SQUARES,
        choices=(LEAST_SQUARES, GRADIENT),
        description='adaptation law: least squares needs no scaling and converges about a hundred '
        "times faster than the paper's gradient (12)",
    )
    observer_poles: tuple[float, ...] | None = structural(
        None,
        unit='1/s',
        kind=list,
        range=(-1e6, -1e-6),
        description='eigenvalues of A_c - K C, one per order: bandwidth of the filters; automatic: '
        'from bandwidth_hz',
    )
    bandwidth_hz: float = structural(
        5.0,
        unit='Hz',
        range=(1e-3, 1e4),
        search=(0.5, 100.0),
        description='magnitude of the observer poles where observer_poles is automatic; set it '
        'well above the frequencies of the motion, and low enough to suppress the noise',
    )
    model_poles: tuple[float, ...] | None = structural(
        None,
        unit='1/s',
        kind=list,
        range=(-1e6, -1e-6),
        description='eigenvalues of A_c, one per order: the plant that is assumed before '
        'adaptation; automatic: half the observer poles',
        equation='(2), (40)',
    )
    gamma: tuple[float, ...] = structural(
        (1000.0,),
        kind=list,
        description='gain of the gradient: one number, one for each free parameter (about '
        '1/mean square of its signal), or a positive definite matrix row by row. It '
        "also weights the parameters in the gate 'gamma'",
        equation='Gamma in (12)',
    )
    memory: float = parameter(
        0.0,
        unit='s',
        range=(0.0, 1e9),
        description='time constant, in time spent adapting, with which least squares forgets; the '
        'variance never exceeds start_variance; 0: it forgets nothing',
    )
    start_variance: tuple[float, ...] | None = structural(
        None,
        kind=list,
        range=(1e-12, 1e18),
        advanced=True,
        description='diagonal of the initial P of least squares, per variance of the measurement: '
        'one number, or one for each free parameter; automatic: 1e4 w^(2 i) for a parameter of '
        'index i, w the geometric mean of the observer poles',
    )
    load: bool = structural(
        False,
        description='learn a constant load (or an offset of the spring) too, as one more parameter '
        'd<order>; without it a constant load biases the other parameters',
    )
    gravity: bool = structural(
        False,
        description='learn a torque proportional to the sine of the angle too (a pendulum or arm, '
        'whose angle is 0 where it hangs), as one more parameter s<order>; set '
        "known: ['k/J=0'] if there is no spring",
    )
    known: tuple[str, ...] = structural(
        (),
        description="parameters that are known, such as 'b1=0', 'k/J=0': l1.., b1.., d<order>, "
        's<order>, and for order 2 b/J, k/J, Kv/J, load/J, mgl/J',
    )
    bounds: tuple[str, ...] = structural(
        (), description="bounds of free parameters, such as 'b/J>=0', 'b2<=50'"
    )
    theta: tuple[float, ...] | None = structural(
        None,
        kind=list,
        description='initial parameters, l1.. then b1.. (then d<order>, s<order>); automatic: zero',
    )
    adapt: bool = parameter(
        True,
        description='false freezes the parameters; the filters keep running, so that adaptation '
        'resumes without a bump',
    )
    velocity: str = structural(
        'full',
        choices=('full', 'paper'),
        description='full: C (A x + B u), correct once the innovation is zero; paper: (38), '
        'which needs b1 = 0 and correct parameters',
    )
    gate: str = structural(
        'noise',
        choices=('noise', 'gamma', 'none'),
        description='adapt only while the signals determine the parameters. noise: the '
        'information matrix exceeds signal_to_noise times the one of measurement noise '
        'alone; gamma: its smallest eigenvalue, weighted by gamma, exceeds '
        'excitation; none: adapt always',
    )
    signal_to_noise: float = parameter(
        100.0,
        range=(1.0, 1e12),
        description="threshold of the gate 'noise': noise in the filtered measurement biases the "
        'parameters by at most about 1/signal_to_noise of their values',
    )
    excitation: float = parameter(
        0.02, range=(1e-12, 1e12), description="threshold of the gate 'gamma'"
    )
    excitation_memory: float = parameter(
        20.0,
        unit='s',
        range=(1e-3, 1e6),
        description='time constant of the information matrix of the gates',
    )
    knock: float = structural(
        5.0,
        range=(0.0, 1e9),
        description='an innovation larger than this multiple of its usual size is a knock from '
        'outside: adaptation pauses until the filters have settled; 0: never',
    )
    moving_above: float = structural(
        0.0,
        unit='rad/s',
        range=(0.0, 1e6),
        description='adapt only while the joint moves faster: the model is not valid while dry '
        'friction sticks; 0: always',
    )
    settle: float | None = parameter(
        None,
        unit='s',
        kind=float,
        range=(0.0, 1e6),
        advanced=True,
        description='time without adaptation after a start or a gap; automatic: five time '
        'constants of the slowest observer pole',
    )
    torque_constant: float | None = parameter(
        None,
        unit='N m per unit of input',
        kind=float,
        range=(1e-9, 1e9),
        description='Kv, if known (1 if the input is a torque): then J, b and k are reported too; '
        'automatic: not known',
    )
    quantum: float = parameter(
        0.0,
        unit='rad',
        range=(0.0, 10.0),
        description='smallest step of the measurement (2 pi / counts); 0: not known',
    )
    noise: float | None = parameter(
        None,
        unit='rad',
        range=(1e-12, 10.0),
        description='standard deviation of the measurement noise, without quantisation; '
        'automatic: estimated from third differences',
    )


def design(gains: Gains, circle: Circle) -> Design:
    """Return what follows from the gains.

    Raises
    ------
    UsageError : gains that contradict each other.
    """
    structured, made = structure(gains), Design()
    made.order = n = gains.order
    made.is_paper, made.is_gradient = gains.form == PUBLISHED_FORM, gains.law == GRADIENT
    if made.is_paper and not made.is_gradient:
        raise UsageError(
            f"form 'paper' does not have the law '{gains.law}': set law to 'gradient', or form to "
            "'sampled'"
        )
    if gains.moving_above > 0.0 and n < 2:
        raise UsageError(
            f"parameter 'moving_above' = {gains.moving_above:g} rad/s needs order 2 or more, not "
            f"{n}: set it to 0 or raise 'order'"
        )
    made.full, made.load, made.gravity = gains.velocity == 'full', gains.load, gains.gravity
    made.gated, made.noise_gate = gains.gate != 'none', gains.gate == 'noise'
    set_numbers(made, structured, gains)
    made.average = max(LEAST_AVERAGE, FILTER_SETTLING / made.slowest)
    made.settle = FILTER_SETTLING / made.slowest if gains.settle is None else float(gains.settle)
    made.young = made.settle + 2.0 * made.average
    made.memory, made.keep = float(gains.memory), float(gains.excitation_memory)
    made.watched, made.knock = gains.knock > 0.0, float(gains.knock * gains.knock)
    made.moving_above = float(gains.moving_above)
    made.adapt, made.has_theta = bool(gains.adapt), gains.theta is not None
    made.period, made.unwrap = float(circle.period), bool(circle.unwrap)
    made.finest = variance_floor(gains.quantum)
    made.noise = gains.noise * gains.noise + made.finest if gains.noise is not None else 0.0
    return made


def set_numbers(made: Design, structured: Structure, gains: Gains) -> None:
    """Set poles, parameters and matrices."""
    n = made.order
    made.names, made.free = len(structured.names), list(structured.free)
    made.known = [i for i in range(made.names) if i not in structured.free]
    made.a_k, made.a_c = list(structured.observer), list(structured.model)
    made.k, made.fixed = list(structured.injection), list(structured.fixed)
    made.start = list(structured.start)
    made.low, made.high = list(structured.low), list(structured.high)
    made.bounded = any(map(math.isfinite, (*made.low, *made.high)))
    made.gamma, made.variance = structured.gamma.tolist(), list(structured.variance)
    made.slowest, made.fastest = float(structured.slowest), float(structured.fastest)
    made.pace = float((-structured.observer[-1]) ** (1.0 / n))
    made.w = gramian(structured.observer)
    if gains.gate == 'gamma':
        floor = gains.excitation * np.linalg.inv(structured.gamma)
    else:
        noise = np.zeros((made.names, made.names))
        noise[:n, :n] = made.w
        floor = (
            gains.signal_to_noise * gains.excitation_memory * noise[np.ix_(made.free, made.free)]
        )
    made.floor = floor.tolist()


def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
    """Set what follows from dt [s]."""
    if design.is_paper:
        f, g0, g1 = euler(design.a_k, dt)
    else:
        f, g0, g1 = series(design.a_k, design.fastest, dt)
    coefficients.f, coefficients.g0, coefficients.g1 = rows(f, design.a_k), g0, g1
    coefficients.columns = [list(column) for column in zip(*coefficients.f)]
    coefficients.h = dt
    coefficients.weight = -math.expm1(-dt / design.average)
    coefficients.slow_weight = -math.expm1(-CHECK_SAMPLES * dt / design.average)
    coefficients.keep = math.exp(-dt / design.keep)
    coefficients.forget = kept(dt, design.memory)
    coefficients.low_pass = -math.expm1(-dt * design.slowest)


def start(observer: Any, state: State, design: Design, measurement: float) -> None:
    """Start at rest at the first angle [rad]."""
    m = len(design.free)
    state.theta, state.plant = design.start[:], design.fixed[:]
    set_plant(state, design)
    state.y = measurement
    state.of_u = [0.0] * design.order
    settle(state, design, 0.0)
    state.information, state.p = ([[0.0] * m for _ in range(m)] for _ in range(2))
    for i, first in enumerate(design.variance):
        state.p[i][i] = first
    begin_convention(state.convention, measurement)
    begin_scatter(state.scatter, measurement)
    state.age = state.power = state.speed_power = state.adapted = state.paused = state.usual = 0.0
    state.slow_e = state.slow_bend = state.slow_power = 0.0
    state.phase, state.trusted, state.tick = INIT, False, 0
    sums = state.sums
    sums.matrix, sums.vector = empty(m), [0.0] * m
    sums.count = sums.of_e = sums.of_bend = 0.0


def step(
    observer: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: float,
    known_input: float,
) -> None:
    """Take one sample [rad], and the input since the last one."""
    y, period = state.y, design.period
    change = measurement - state.convention.last
    if period > 0.0 and not -0.5 * period <= change < 0.5 * period:
        change = wrap(change, period)
    if design.is_paper:
        e, psi = y - state.z[0], signals(state, design)
        before = [row[:] for row in (state.of_y, state.of_u, state.of_one, state.of_sine)]
        was = state.plant[:]
        euler_step(state, coefficients, design, known_input, e)
    filter_signals(state, coefficients, design, known_input, change)
    if not design.is_paper:
        state.z = transformed(coefficients.f, state.z)
        psi = signals(state, design)
        e = state.y - state.z[0] - dot(state.of_y, design.k)
    if design.known:
        if not design.is_paper:
            of_known = 0.0
            for i in design.known:
                of_known += design.fixed[i] * psi[i]
            e -= of_known
        psi = [psi[i] for i in design.free]
    explained = dot(psi, state.theta)
    if not design.is_paper:
        e -= explained
    if not -LARGEST < e < LARGEST:
        start(observer, state, design, measurement)  # the state has diverged: start again
        return
    state.age += coefficients.h
    state.tick += 1
    if state.phase == INIT and state.age >= design.settle:
        state.phase = judged(state, design, coefficients.h)
    if state.phase != INIT:
        learn(state, coefficients, design, psi, e, e + explained)
        if design.is_paper and state.plant != was:  # the last term of (13), which ends with the law
            change_of = [now - then for now, then in zip(state.plant, was)]
            follow_parameters(state, before, design, change_of)
    if state.tick >= CHECK_SAMPLES:
        state.tick = 0
        if state.phase != INIT:
            check(state, coefficients, design)
    follow_convention(state.convention, measurement, period)
    follow_scatter(state.scatter, measurement, coefficients.h, period)


def filter_signals(
    state: State, coefficients: Coefficients, design: Design, known_input: float, change: float
) -> None:
    """Filter angle, input, constant and sine over a sample in which the angle changes, (11)."""
    columns, g0, g1, y = coefficients.columns, coefficients.g0, coefficients.g1, state.y
    feed(state.of_y, columns, g0, g1, y, change)
    feed(state.of_u, columns, g0, g1, known_input, 0.0)
    if design.load:
        feed(state.of_one, columns, g0, g1, 1.0, 0.0)
    if design.gravity:
        sine = math.sin(y)
        feed(state.of_sine, columns, g0, g1, sine, math.sin(y + change) - sine)
    state.y = y + change


def learn(
    state: State,
    coefficients: Coefficients,
    design: Design,
    psi: list[float],
    e: float,
    target: float,
) -> None:
    """Learn from the innovation e [rad] of psi theta = target: excitation, parameters, powers."""
    h, low_pass = coefficients.h, coefficients.low_pass
    add_square(state.information, coefficients.keep, h, psi)
    state.slow_e += (e - state.slow_e) * low_pass
    bend = state.y + dot(state.of_y, design.a_k)
    state.slow_bend += (bend - state.slow_bend) * low_pass
    if state.phase == ADAPTING and design.adapt:
        if design.watched or design.moving_above > 0.0:
            pause(state, design, e, coefficients.weight)
        if state.paused > 0.0:
            state.paused -= h
        else:
            gather(state.sums, state, psi, target)
            adapt(state, design, psi, e, h, coefficients.forget)
            set_plant(state, design)
            state.adapted += h
    recent = coefficients.weight
    if state.age < design.young:  # while theta converges
        recent = START_SPEEDUP * recent if START_SPEEDUP * recent < 1.0 else 1.0
    state.power += (e * e - state.power) * recent
    state.slow_power += (state.slow_e * state.slow_e - state.slow_power) * recent


def pause(state: State, design: Design, e: float, weight: float) -> None:
    """Follow the usual square of the innovation; pause the adaptation where the plant differs.

    The plant's equation is not valid after a knock, and while dry friction may stop the joint.
    Adaptation pauses until the filters have forgotten that.
    """
    square, above, n = e * e, design.moving_above, design.order
    if above > 0.0 and -above < -design.a_k[n - 1] * state.of_y[n - 2] < above:
        state.paused = FILTER_SETTLING / design.slowest
    elif design.watched:
        if state.adapted > design.average:
            if square > design.knock * state.usual:
                state.paused = FILTER_SETTLING / design.slowest
            if square > SQUARE_CLIP * state.usual:
                square = SQUARE_CLIP * state.usual
        state.usual += (square - state.usual) * weight


def check(state: State, coefficients: Coefficients, design: Design) -> None:
    """Judge the excitation, and whether the estimate can be trusted."""
    h, low_pass, slow_power = coefficients.h, coefficients.low_pass, state.slow_power
    state.phase = judged(state, design, h)
    _, _, speed = states(state, design)
    state.speed_power += (speed * speed - state.speed_power) * coefficients.slow_weight
    most = SLOW_POWER_RATIO * expected(state, design, h) * low_pass / (2.0 - low_pass)
    close = MOTION_POWER_RATIO * state.speed_power / (design.pace * design.pace)
    if slow_power > 4.0 * most and slow_power > 4.0 * close:
        state.trusted = False
    elif (slow_power <= most or slow_power <= close) and (
        state.age > design.settle + design.average
    ):
        state.trusted = True


def estimate(
    observer: Any,
    out: Estimate,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: float,
    known_input: float,
) -> None:
    """Set the estimate; the velocity is C (A x + B u), (38) without b1 u."""
    x1, _, out.velocity = states(state, design)
    if design.full:
        out.velocity += state.plant[design.order] * known_input  # b1 u
    out.position = present(state.convention, x1, design.period, design.unwrap)
    out.acceleration = math.nan
    if state.phase == INIT:
        out.status = COASTING if state.trusted else INITIALISING
    elif state.phase == GATED and not design.has_theta and state.adapted == 0.0:
        out.status = NOT_OBSERVABLE
    else:
        out.status = TRACKING if state.trusted else INITIALISING


def deviation(
    observer: Any,
    out: Deviation,
    state: State,
    coefficients: Coefficients,
    design: Design,
    scale: float,
) -> None:
    """Set one standard deviation of position [rad] and velocity [rad/s]; `scale` is 1.

    They contain white noise through the filters, and the model error: a slow innovation e comes
    with a velocity error of (a1 - o1) e, where o1 and a1 are the first entries of A_c - K C and A.
    """
    h, low_pass, a = coefficients.h, coefficients.low_pass, design.a_k
    injected = list(map(add, design.k, state.plant))  # K + L
    first = design.a_c[0] + state.plant[0] - a[0]
    to_speed, last = injected[:], design.order - 1
    for i, own in enumerate(injected):
        of_next = a[i] * injected[0] + injected[i + 1] if i < last else a[i] * injected[0]
        to_speed[i] = of_next + first * own
    of_position = h * quadratic(design.w, injected)
    of_speed = h * quadratic(design.w, to_speed)
    noise = variance(state.scatter, design)
    seen = (state.power - state.slow_power) / (1.0 + of_position)  # seen in the innovation
    if seen > noise:
        noise = seen
    slow = state.slow_power - noise * (1.0 + of_position) * low_pass / (2.0 - low_pass)
    if slow < 0.0:
        slow = 0.0
    out.position = math.sqrt(of_position * noise + slow)
    out.velocity = math.sqrt(of_speed * noise + first * first * slow)


def restart(
    observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: float
) -> None:
    """Start again at rest; the parameters stay."""
    resume(observer, state, coefficients, design, measurement)
    state.of_u = [0.0] * design.order
    settle(state, design, 0.0)
    state.trusted = False


def resume(
    observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: float
) -> None:
    """Go on after a gap at the measurement, with the speed and the parameters."""
    state.y += wrap(measurement - state.convention.last, design.period)
    _, _, speed = states(state, design)
    settle(state, design, speed)
    follow_convention(state.convention, measurement, design.period)
    resume_scatter(state.scatter, measurement)
    state.age = state.slow_e = state.slow_bend = 0.0
    state.phase, state.tick = INIT, 0


def limits(design: Design, dt: float) -> str | None:
    """Return why these gains cannot work at this dt [s]."""
    if design.is_paper and design.fastest * dt >= 2.0:
        return (
            f"form 'paper' is unstable at a sample time of {dt:.3g} s: its fastest pole "
            f"needs less than {2.0 / design.fastest:.3g} s; set form to 'sampled', or use slower "
            'observer poles'
        )
    return None


def group_delay(design: Design, dt: float) -> float:
    """Return the delay of the velocity [s]: with the plant's parameters it has none."""
    return 0.0


OBSERVER = Observer(
    name='adaptive',
    summary='velocity of a servo with unknown parameters, which it identifies',
    gains=Gains,
    reference='Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; sampled form '
    'of our own',
    kind='angle_and_input',
)
