# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""SMO: sliding-mode observers of a mechanism.

super_twisting (Davila, Fridman, Levant; (22) of the paper), with e = y - x1h:
    x1h' = x2h + 1.5 sqrt(mu |e|) sgn e,   x2h' = model + 1.1 mu sgn e
uniform (Cruz-Zavala, Moreno, Fridman; the robotic leg's of section 5.2):
    x1h' = x2h + k1 (m1 |e|^(1/2) + m2 |e|^(3/2)) sgn e
    x2h' = model + k2 (m1^2/2 sgn e + 2 m1 m2 e + 3/2 m2^2 |e|^2 sgn e)

They are exact after a finite time while the error of the model's acceleration is less than 1.1 mu
(k2 m1^2/2 for uniform), and fail beyond it. There is no matrix exponential for
injections with a sign, so the default form makes an implicit step, which does not chatter. It has a
closed form for super_twisting; for uniform Newton's method converges monotonically.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.models.mechanics import Vector
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.describing import Describing, describing
from estimator_pkg.observers.maths.steady_noise import steady_covariance
from estimator_pkg.observers.maths.twisting import implicit_step, injections
from estimator_pkg.observers.mechanism.core import (  # noqa: F401  (its functions too)
    DRIVEN,
    EDGES,
    SINGLE_ANGLE,
    TURNS,
    MechanismEstimate,
    Plan,
    estimate,
    group_delay,
    is_reading,
    limits,
    made_plan,
    place,
    prepare,
    restart,
    resume,
    start,
    step,
)
from estimator_pkg.observers.mechanism.core import keep_velocities as propagate  # noqa: F401
from estimator_pkg.observers.mechanism.noise import NoiseGains, per_noise, variances
from estimator_pkg.observers.mechanism.parameters import (
    LINEAR,
    PAPER_FORM,
    MechanicalGains,
    model_of,
    per_joint,
)
from estimator_pkg.observers.mechanism.state import Coefficients, Core, Design, State, Work  # noqa: F401
from estimator_pkg.observers.mechanism.velocity import accelerate, brake, linear_matrix
from estimator_pkg.parameters import parameter, structural

SLIDING = True  # d is the innovation
NEWTON = 60  # most steps of Newton's method; from above it converges monotonically


def uniform(e: float, first: float, second: float, m1: float, m2: float) -> tuple[float, float]:
    """Return the two injections of uniform at e [rad or m]."""
    if e == 0.0:
        return 0.0, 0.0
    size = abs(e)
    root = math.sqrt(size)
    one = first * (m1 * root + m2 * root * size)
    two = second * (0.5 * m1 * m1 + 2.0 * m1 * m2 * size + 1.5 * m2 * m2 * size * size)
    if e > 0.0:
        return one, two
    return -one, -two


def implicit_uniform(
    free: float, h: float, first: float, second: float, m1: float, m2: float
) -> tuple[float, float]:
    """Return the same as `implicit_step` for `uniform`, a quartic in sqrt|e|, by Newton."""
    size = abs(free)
    sliding = h * h * second * 0.5 * m1 * m1
    if size <= sliding:
        return 0.0, free / (h * h)
    over = size - sliding
    a1, a3 = h * first * m1, h * first * m2
    a2 = 1.0 + h * h * second * 2.0 * m1 * m2
    a4 = h * h * second * 1.5 * m2 * m2
    root = math.sqrt(over)
    for _ in range(NEWTON):
        value = root * (a1 + root * (a2 + root * (a3 + root * a4))) - over
        slope = a1 + root * (2.0 * a2 + root * (3.0 * a3 + root * 4.0 * a4))
        change = value / slope
        root -= change
        if change <= 1e-16 * root:
            break
    e = root * root
    two = second * (0.5 * m1 * m1 + 2.0 * m1 * m2 * e + 1.5 * m2 * m2 * e * e)
    if free > 0.0:
        return e, two
    return -e, -two


Array = NDArray[np.float64]


def noise_variances(
    pairs: Sequence[Describing], damping: Array, dt: float, *, implicit: bool, linear_hold: bool
) -> NoiseGains:
    """Return variances of estimate and innovation, per noise variance and from the remnants.

    Parameters
    ----------
    pairs : describing functions, one pair per position.
    damping : -M^-1 D, shape (n, n) [1/s].
    dt : sample time [s].
    implicit, linear_hold : the kind of step.
    """
    n = len(pairs)
    eye, zeros = np.eye(n), np.zeros((n, n))
    # transition of the velocity over a sample by damping
    glide = np.linalg.inv(eye - dt * damping) if implicit else eye + dt * damping
    position = np.diag([pair.position for pair in pairs])
    velocity = np.diag([pair.velocity for pair in pairs])
    # the state is (offset e, velocity, noise of the previous sample); `seen` is the innovation
    if implicit:
        ahead = dt * glide
        seen = np.hstack([eye, ahead, eye if linear_hold else zeros])
        of_noise = -eye if linear_hold else zeros
        offset = position @ seen
        entering = position @ of_noise
        if not linear_hold:
            offset = offset + np.hstack([zeros, zeros, eye])
            entering = entering - eye
        speed = np.hstack([zeros, glide, zeros]) - dt * velocity @ seen
        of_speed = -dt * velocity @ of_noise
    else:
        seen, of_noise = np.hstack([eye, zeros, zeros]), zeros
        offset = np.hstack([eye - dt * position, dt * eye, eye])
        entering = -eye
        speed = np.hstack([-dt * velocity, glide, zeros])
        of_speed = zeros
    transition = np.vstack([offset, speed, np.zeros((n, 3 * n))])
    arrival = np.vstack([entering, of_speed, eye])
    remnant = np.zeros((3 * n, 3 * n))
    turn = np.diag([1.0, -dt]) if implicit else np.diag([-dt, -dt])
    for index, pair in enumerate(pairs):
        rows = np.ix_((index, n + index), (index, n + index))
        remnant[rows] = turn @ pair.remnant @ turn
    shown = np.hstack([eye, zeros, eye])  # error of the estimate: offset plus noise of y
    speeds = np.hstack([zeros, eye, zeros])
    outputs = shown, speeds, seen
    of_position, of_velocity, of_innovation = per_noise(transition, arrival, outputs)
    chatter = steady_covariance(transition, remnant)
    own = (variances(rows, chatter) for rows in outputs)
    return NoiseGains(of_position, of_velocity, of_innovation + of_noise**2, *own)


SUPER_TWISTING, UNIFORM = 'super_twisting', 'uniform'
POSITION_GAIN, VELOCITY_GAIN = 1.5, 1.1  # of (22)
LEAST_POWER = 1e-18  # smallest mean squared innovation for the describing functions [rad^2 or m^2]


@dataclass(frozen=True)
class Gains(MechanicalGains):
    """Parameters of `smo`."""

    variant: str = structural(
        SUPER_TWISTING,
        choices=(SUPER_TWISTING, UNIFORM),
        description='injections of the sliding mode: those of super_twisting, or uniform ones',
    )
    mu: tuple[float, ...] = parameter(
        (10.0,),
        unit='rad/s^2 or m/s^2',
        kind=list,
        range=(1e-9, 1e9),
        search=(0.1, 1e4),
        description='super_twisting: about the largest acceleration that the model does not '
        'predict; one number for all positions, or one each',
    )
    k1: tuple[float, ...] = parameter(
        (1.0,), kind=list, range=(1e-9, 1e9), description='uniform: gain of the position'
    )
    k2: tuple[float, ...] = parameter(
        (1.0,), kind=list, range=(1e-9, 1e9), description='uniform: gain of the velocity'
    )
    mu1: float = parameter(
        1.86, range=(1e-9, 1e6), description='uniform: gain of the root and of the sign'
    )
    mu2: float = parameter(
        0.303, range=(0.0, 1e6), description='uniform: gain of the powers 3/2 and 2'
    )


def advance(
    model: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: Vector,
    known_input: Vector,
) -> bool:
    """Set `work.after`, the state after one sample; return False where the model is not valid."""
    core, work, dt = state.core, state.work, coefficients.dt
    after, moved = work.after, work.moved
    place(model, state, design)
    if not model.admits(design.values, work.at):
        return False
    if design.paper:
        accelerate(model, work, design.values, design.damped, work.at, core.x, known_input)
    else:
        brake(model, work, design, core.x, known_input, dt)
    for i in range(model.JOINTS):
        e, v, f = core.e[i], core.x[i], work.f[i]
        if design.paper:
            a, b = inject(e, design, design.first[i], design.second[i])
            after.e[i] = e + dt * (v - a) - moved[i]
            after.d[i] = after.e[i]
        else:
            free = e + dt * (v + dt * f)
            if design.linear_hold:
                free -= moved[i]
            after.d[i] = free
            e, b = step_implicitly(free, dt, design, design.first[i], design.second[i])
            after.e[i] = e if design.linear_hold else e - moved[i]
        after.x[i] = v + dt * (f - b)
        after.v[i] = after.x[i]
    return True


def inject(e: float, design: Design, first: float, second: float) -> tuple[float, float]:
    """Return the two injections at e [rad or m]."""
    if design.uniform:
        return uniform(e, first, second, design.m1, design.m2)
    return injections(e, first, second)


def step_implicitly(
    free: float, h: float, design: Design, first: float, second: float
) -> tuple[float, float]:
    """Return (e, second injection) after an implicit step of h [s]."""
    if design.uniform:
        return implicit_uniform(free, h, first, second, design.m1, design.m2)
    return implicit_step(free, h, first, second)


def plan(gains: Gains, circle: Any) -> Plan:
    """Return what these gains imply; raises UserError, UsageError."""
    mechanics = model_of(gains)
    n = mechanics.degrees
    design = Design()
    design.m1, design.m2 = float(gains.mu1), float(gains.mu2)
    design.uniform = gains.variant == UNIFORM
    if not design.uniform:
        mu = np.array(per_joint('mu', gains.mu, n))
        first, second = POSITION_GAIN * np.sqrt(mu), VELOCITY_GAIN * mu
        acceleration_limit = second
    else:
        first = np.array(per_joint('k1', gains.k1, n))
        second = np.array(per_joint('k2', gains.k2, n))
        acceleration_limit = second * 0.5 * gains.mu1**2
    paper = gains.form == PAPER_FORM
    linear_hold = gains.hold == LINEAR and not paper

    def described(power: Array, dt: float) -> list[Describing]:
        """Return a pair per position: of an implicit step of dt [s]; 0: of the injections."""
        pairs = []
        for a, b, square in zip(first.tolist(), second.tolist(), power.tolist()):
            of_one = partial(inject, design=design, first=a, second=b)
            if dt > 0.0:
                of_one = partial(step_implicitly, h=dt, design=design, first=a, second=b)
            pairs.append(describing(of_one, math.sqrt(max(square, LEAST_POWER))))
        return pairs

    def noise(at: Array, power: Array, dt: float) -> NoiseGains:
        damped = linear_matrix(mechanics, np.eye(n), np.eye(n), None, at)[n:, n:]
        pairs = described(power, 0.0 if paper else dt)
        return noise_variances(pairs, damped, dt, implicit=not paper, linear_hold=linear_hold)

    def linear(at: Array, power: Array) -> tuple[Array, Array]:
        """Return (A, V) with the describing functions at this innovation, in continuous time."""
        pairs = described(power, 0.0)
        L, K = (np.diag(column) for column in list(zip(*pairs))[:2])
        return linear_matrix(mechanics, L, K, None, at), np.eye(n)

    def describe(dt: float) -> dict[str, Any]:
        return {
            'acceleration_limit': acceleration_limit.tolist(),
            'chattering': (dt * acceleration_limit).tolist(),
        }

    return made_plan(
        sys.modules[__name__],
        gains,
        mechanics,
        circle,
        fields={
            'first': first,
            'second': second,
            'm1': design.m1,
            'm2': design.m2,
            'uniform': design.uniform,
        },
        slowest=4.0 * float(np.min(acceleration_limit)),
        linear=linear,
        describe=describe,
        noise=noise,
    )


OBSERVER = Observer(
    name='smo',
    summary='sliding-mode observer of any mechanism with known model and input',
    gains=Gains,
    kind='mechanical',
    reference='Davila, Fridman, Levant (2005) and Cruz-Zavala, Moreno, Fridman (2010); (22) of '
    'Aranovskiy et al. (IJC 2019)',
)
