# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Adaptive velocity observer: velocity of a linear servo whose parameters it identifies.

The plant x' = A x + B u, y = C x in observable canonical form is written (2)

    x' = A_c x + Phi theta,   theta = (L, B),   Phi = [y I, u I]

with A_c chosen, so that A = A_c + L C. From angle and input the observer learns theta and
estimates x; the velocity of the angle is C (A x + B u). Optional regressors in the last equation
are a constant load, and gravity with the sine of the angle. The filtered regressor (11) is

    Upsilon' = (A_c - K C) Upsilon + Phi

There are two forms. `paper` is (11) to (13) by forward Euler at the sample times. `sampled`
(default) uses that x - Upsilon theta is a filter of y only. The regressor Upsilon is filtered
exactly for an angle that changes linearly and an input that is constant over a sample. The law
uses the a posteriori innovation, so it is stable for every gain and sample time. Both forms fulfil
(31), xi+ = exp((A_c - K C) dt) xi, the second one exactly.

Measurement: the angle [rad], unwrapped here because a spring needs it over several turns. Input: u
over the interval that ends at the sample.

Files: `state` the records, `structure` the gains and the parameters theta, `law` the adaptation
law, `evidence` the standard deviations of the parameters, `report` the report for users.

Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; corrections in
docs/papers/adaptive.md.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np

from estimator_pkg.circle import LARGEST, Circle, wrap
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import (
    COASTING,
    INITIALISING,
    NOT_OBSERVABLE,
    TRACKING,
    Deviation,
    Estimate,
)
from estimator_pkg.observers.adaptive import state as records
from estimator_pkg.observers.adaptive.law import (
    FILTER_SETTLING,
    GATED,
    INIT,
    injected,
    judged,
    learn,
    set_plant,
    variance,
)
from estimator_pkg.observers.adaptive.state import Array, Coefficients, Design, State
from estimator_pkg.observers.adaptive.structure import GRADIENT, PUBLISHED_FORM, Gains, structure
from estimator_pkg.observers.angle.shared import variance_floor
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.least_squares import kept
from estimator_pkg.observers.maths.linear import companion, response
from estimator_pkg.sensor.convention import begin_convention, follow_convention, present
from estimator_pkg.sensor.scatter import begin_scatter, follow_scatter, resume_scatter

CHECK_SAMPLES = 20  # samples between two checks of excitation and trust
SLOW_POWER_RATIO = 9.0  # largest power of the slow innovation relative to that of the noise, ...
MOTION_POWER_RATIO = 2e-4  # ... or to that of the motion: then the velocity is right to 3 %
EXCITATION_MEMORY = 20.0  # time constant of the information matrix of the gate [s]
LEAST_AVERAGE = 0.5  # shortest time over which both are averaged [s]


def regressor(design: Design, y: float, u: float, one: float, sine: float) -> Array:
    """Return Phi = [y I, u I, load, gravity], shape (n, p): what multiplies theta in (2)."""
    found: Array = (np.array((y, u, one, sine)) @ design.units).reshape(design.order, -1)
    return found


def settle(state: State, design: Design, speed: float) -> None:
    """Set filters and x to steady state at the angle y, with this speed [rad/s]; u's stay."""
    n, y = design.order, state.y
    phi = regressor(design, -y, 0.0, -1.0, -math.sin(y))
    resting = np.array(np.linalg.solve(design.a_k, phi), float)
    resting[:, n : 2 * n] = state.upsilon[:, n : 2 * n]
    state.upsilon, state.z = resting, np.zeros(n)
    x = states(state, design)
    z = np.zeros(n)
    z[0] = y - x[0]
    if n > 1:
        z[1] = speed - (design.model[0] + state.plant[0]) * y - x[1]
    state.z = z


def states(state: State, design: Design) -> Array:
    """Return x, shape (n,)."""
    if design.is_paper:
        return state.z
    return state.z + state.upsilon @ (state.plant + design.injection)


def velocity(state: State, design: Design, x: Array) -> float:
    """Return C A x, the velocity without b1 u [rad/s]; x of shape (n,)."""
    return float((design.model[0] + state.plant[0]) * x[0] + x[1:2].sum())


def check(state: State, coefficients: Coefficients, design: Design) -> None:
    """Judge the excitation, and whether the estimate can be trusted."""
    h, low_pass, slow_power = coefficients.h, coefficients.low_pass, state.slow_power
    state.phase = judged(state, design, h)
    speed = velocity(state, design, states(state, design))
    state.speed_power += (speed * speed - state.speed_power) * coefficients.slow_weight
    to_x = injected(state, design)
    expected = variance(state, design) * (1.0 + h * float(to_x @ design.w @ to_x))
    most = SLOW_POWER_RATIO * expected * low_pass / (2.0 - low_pass)
    close = MOTION_POWER_RATIO * state.speed_power / (design.pace * design.pace)
    if slow_power > 4.0 * most and slow_power > 4.0 * close:
        state.trusted = False
    elif (slow_power <= most or slow_power <= close) and (
        state.age > design.settle + design.average
    ):
        state.trusted = True


class Adaptive(Observer):
    """The adaptive observer of a servo."""

    name = 'adaptive'
    summary = 'velocity of a servo with unknown parameters, which it identifies'
    reference = (
        'Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers; sampled form of our '
        'own'
    )
    kind = 'angle_and_input'
    gains = Gains
    Design: TypeAlias = records.Design
    Coefficients: TypeAlias = records.Coefficients
    State: TypeAlias = records.State

    @staticmethod
    def design(gains: Gains, circle: Circle) -> Design:
        """Return what follows from the gains.

        Raises
        ------
        UsageError : gains that contradict each other.
        """
        made, n = structure(gains), gains.order
        made.is_paper, made.is_gradient = gains.form == PUBLISHED_FORM, gains.law == GRADIENT
        if made.is_paper and not made.is_gradient:
            raise UsageError(
                f"form 'paper' does not have the law '{gains.law}': set law to 'gradient', or "
                "form to 'sampled'"
            )
        if gains.moving_above > 0.0 and n < 2:
            raise UsageError(
                f"parameter 'moving_above' = {gains.moving_above:g} rad/s needs order 2 or more, "
                f"not {n}: set it to 0 or raise 'order'"
            )
        made.full, made.gated = gains.velocity == 'full', gains.gate == 'noise'
        noise = np.zeros((len(made.fixed), len(made.fixed)))
        noise[:n, :n] = EXCITATION_MEMORY * made.w
        made.noise_floor = noise[np.ix_(made.free, made.free)]
        made.average = max(LEAST_AVERAGE, FILTER_SETTLING / made.slowest)
        made.settle = (
            FILTER_SETTLING / made.slowest if gains.settle is None else float(gains.settle)
        )
        made.memory = float(gains.memory)
        made.knock, made.moving_above = float(gains.knock * gains.knock), float(gains.moving_above)
        made.adapt, made.has_theta = bool(gains.adapt), gains.theta is not None
        made.period, made.unwrap = float(circle.period), bool(circle.unwrap)
        made.finest = variance_floor(gains.quantum)
        made.noise = gains.noise * gains.noise + made.finest if gains.noise is not None else 0.0
        return made

    @staticmethod
    def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
        """Set what follows from dt [s]."""
        if design.is_paper:
            one = np.eye(design.order)
            found = one + dt * design.a_k, dt * one, 0.0 * one
        else:
            found = response(tuple(design.observer), design.pace, dt)
        coefficients.F, coefficients.G0, coefficients.G1 = found
        coefficients.h = dt
        coefficients.weight = -math.expm1(-dt / design.average)
        coefficients.slow_weight = -math.expm1(-CHECK_SAMPLES * dt / design.average)
        coefficients.keep = math.exp(-dt / EXCITATION_MEMORY)
        coefficients.forget = kept(dt, design.memory)
        coefficients.low_pass = -math.expm1(-dt * design.slowest)

    @staticmethod
    def start(observer: Any, state: State, design: Design, measurement: float) -> None:
        """Start at rest at the first angle [rad]."""
        m = len(design.free)
        state.theta = design.start
        set_plant(state, design)
        state.y, state.upsilon = measurement, np.zeros((design.order, len(design.fixed)))
        settle(state, design, 0.0)
        state.information, state.p = np.zeros((m, m)), np.diag(design.variance)
        begin_convention(state.convention, measurement)
        begin_scatter(state.scatter, measurement)
        state.age = state.power = state.speed_power = state.adapted = state.paused = state.usual = (
            0.0
        )
        state.slow_e = state.slow_bend = state.slow_power = 0.0
        state.phase, state.trusted, state.tick = INIT, False, 0
        sums = state.sums
        sums.matrix, sums.vector = np.zeros((m, m)), np.zeros(m)
        sums.count = sums.of_e = sums.of_bend = 0.0

    @staticmethod
    @np.errstate(all='ignore')  # a state that has diverged starts again
    def step(
        observer: Any,
        state: State,
        coefficients: Coefficients,
        design: Design,
        measurement: float,
        known_input: float,
    ) -> None:
        """Take one sample [rad], and the input since the last one."""
        y, before, was, h = state.y, state.upsilon, state.plant, coefficients.h
        change = wrap(measurement - state.convention.last, design.period)
        sine = math.sin(y)
        phi = regressor(design, y, known_input, 1.0, sine)
        rising = regressor(design, change, 0.0, 0.0, math.sin(y + change) - sine)
        state.upsilon = coefficients.F @ before + coefficients.G0 @ phi + coefficients.G1 @ rising
        state.y = y + change
        if design.is_paper:  # (13) without its last term, by forward Euler
            psi, x = before[0], state.z
            e = y - float(x[0])
            state.z = x + h * (
                companion(design.model) @ x + phi @ was + e * design.injection[: design.order]
            )
            explained = float(psi[design.free] @ state.theta)
        else:
            psi, state.z = state.upsilon[0], coefficients.F @ state.z
            explained = float(psi[design.free] @ state.theta)
            e = state.y - float(state.z[0] + psi @ (design.injection + design.fixed)) - explained
        if not -LARGEST < e < LARGEST:
            observer.start(
                observer, state, design, measurement
            )  # the state has diverged: start again
            return
        state.age += h
        state.tick += 1
        if state.phase == INIT and state.age >= design.settle:
            state.phase = judged(state, design, h)
        if state.phase != INIT:
            learn(state, coefficients, design, psi[design.free], e, e + explained)
            if design.is_paper:  # the last term of (13), which ends with the law
                state.z = state.z + before @ (state.plant - was)
        if state.tick >= CHECK_SAMPLES:
            state.tick = 0
            if state.phase != INIT:
                check(state, coefficients, design)
        follow_convention(state.convention, measurement, design.period)
        follow_scatter(state.scatter, measurement, h, design.period)

    @staticmethod
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
        x = states(state, design)
        out.velocity = velocity(state, design, x)
        if design.full:
            out.velocity += float(state.plant[design.order]) * known_input  # b1 u
        out.position = present(state.convention, float(x[0]), design.period, design.unwrap)
        out.acceleration = math.nan
        if state.phase == INIT:
            out.status = COASTING if state.trusted else INITIALISING
        elif state.phase == GATED and not design.has_theta and state.adapted == 0.0:
            out.status = NOT_OBSERVABLE
        else:
            out.status = TRACKING if state.trusted else INITIALISING

    @staticmethod
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
        with a velocity error of (a1 - o1) e, where o1 and a1 are the first entries of A_c - K C and
        of A.
        """
        h, low_pass, to_x = coefficients.h, coefficients.low_pass, injected(state, design)
        first = float(to_x[0])
        to_speed = design.a_k @ to_x + first * to_x
        of_position = h * float(to_x @ design.w @ to_x)
        of_speed = h * float(to_speed @ design.w @ to_speed)
        seen = (state.power - state.slow_power) / (1.0 + of_position)  # seen in the innovation
        noise = max(variance(state, design), seen)
        slow = state.slow_power - noise * (1.0 + of_position) * low_pass / (2.0 - low_pass)
        slow = max(slow, 0.0)
        out.position = math.sqrt(of_position * noise + slow)
        out.velocity = math.sqrt(of_speed * noise + first * first * slow)

    @staticmethod
    def resume(
        observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: float
    ) -> None:
        """Go on after a gap at the measurement, with the speed and the parameters."""
        state.y += wrap(measurement - state.convention.last, design.period)
        settle(state, design, velocity(state, design, states(state, design)))
        follow_convention(state.convention, measurement, design.period)
        resume_scatter(state.scatter, measurement)
        state.age = state.slow_e = state.slow_bend = 0.0
        state.phase, state.tick = INIT, 0

    @staticmethod
    def restart(
        observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: float
    ) -> None:
        """Start again at rest; the parameters stay."""
        observer.resume(observer, state, coefficients, design, measurement)
        state.upsilon = np.zeros_like(state.upsilon)
        settle(state, design, 0.0)
        state.trusted = False

    @staticmethod
    def limits(design: Design, dt: float) -> str | None:
        """Return why these gains cannot work at this dt [s]."""
        if design.is_paper and design.fastest * dt >= 2.0:
            return (
                f"form 'paper' is unstable at a sample time of {dt:.3g} s: its fastest pole "
                f"needs less than {2.0 / design.fastest:.3g} s; set form to 'sampled', or use "
                'slower observer poles'
            )
        return None

    @staticmethod
    def group_delay(design: Design, dt: float) -> float:
        """Return the delay of the velocity [s]: with the plant's parameters it has none."""
        return 0.0
