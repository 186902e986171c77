# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Super-twisting differentiators of order 1, 2 and 3 (sliding-mode observers of an angle alone).

The continuous differentiator of order n bounds its error by L, the bound of derivative n + 1:

    z_j' = z_{j+1} + c_{j+1} L^{(j+1)/(n+1)} |e|^{(n-j)/(n+1)} sgn e,   e = y - z_0,  j = 0..n

What matters in practice is how it is sampled (`form`). Both forms are written here as a prediction
over the true dt and a correction by the wrapped innovation, so that the estimate belongs to the
newest sample. The published predictor forms (correction first, then the step) are the same
filters: their gain is A times ours.

Barbot, Djemai, Manamanni (2007), use order 1: equations (5) and (14).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from estimator_pkg.circle import Circle, wrap
from estimator_pkg.observers.angle.shared import (  # noqa: F401  (its functions too)
    DRIVEN,
    EDGES,
    LAG_3,
    OUTSIDE_PART,
    SINGLE_ANGLE,
    AngleGains,
    State,
    deviation,
    estimate,
    is_reading,
    restart,
    resume,
    set_shared,
    start,
    step,
)
from estimator_pkg.observers.angle.super_twisting.gains import (
    COEFFICIENTS,
    ZERO_INNOVATION,
    Design,
    matched,
    noise_gains_at,
    noise_table,
    roots_of,
)
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.contract import no_reason as why  # noqa: F401
from estimator_pkg.parameters import parameter, structural
from estimator_pkg.record import record

TURNS = False  # its position is wrapped
ERROR_DECAY = 0.55  # of (L/|e|)^(1/(n+1)): its slowest error decays so fast
REFRESH = 8  # samples after which the noise gains are computed again
POWER_WEIGHT = 0.15  # weight of the mean square of the newest REFRESH samples: 50 samples in all
TRANSIENT_RATIO = 16.0  # times less than the mean square: a transient is over, ...
TRANSIENT_DECAY = 0.5  # ... and is forgotten by this factor every REFRESH samples


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `super_twisting`."""

    order: int = structural(
        2,
        range=(1, 3),
        description='1: velocity, from a bound of acceleration; 2: and acceleration, from a bound '
        'of jerk; 3: from a bound of snap',
    )
    bound: float = parameter(
        5000.0,
        unit='rad/s^(order+1)',
        range=(1e-6, 1e15),
        search=(1.0, 1e7),
        description='largest acceleration (order 1), jerk (2) or snap (3) of the motion; too small '
        'fails hard, too large costs about its square root in noise',
        equation='L in lambda_j = c_j L^(j/(n+1))',
    )
    form: str = structural(
        'matching',
        choices=('matching', 'explicit'),
        description='sampling: matching (eigenvalues matched to dt), explicit (Euler; chatters by '
        'dt times the gain, kept to show why not)',
    )


@record
class Coefficients:
    """What follows from the sample time; the gains depend on the innovation, too."""

    dt: float  # [s]
    rate: float  # 1/dt
    rate_2: float  # 1/dt^2
    rate_3: float  # 1/dt^3


@record
class Derivatives:
    """Position and its derivatives."""

    x: float  # [rad]
    v: float  # [rad/s]
    a: float  # [rad/s^2]
    j: float  # [rad/s^3]


@record
class Core:
    """The differentiator, and what noise makes of its gains."""

    position: float  # as in the chain [rad]
    velocity: float  # [rad/s]
    acceleration: float  # [rad/s^2]; order 1: nan
    chain: Derivatives
    ticks: int  # samples since the noise gains were computed; 0: only one sample has come
    total: float  # sum of the squared innovations of these samples [rad^2]
    power: float  # mean square innovation [rad^2]
    of_position: float  # the noise gains
    of_velocity: float
    of_innovation: float


def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
    """Set what follows from dt [s]."""
    rate = 1.0 / dt
    coefficients.dt, coefficients.rate = dt, rate
    coefficients.rate_2, coefficients.rate_3 = rate * rate, rate * rate * rate


def begin(core: Core, design: Design, measurement: float) -> None:
    """Begin at a measurement [rad], without a speed."""
    core.chain.v = core.power = core.total = 0.0
    core.ticks = 0
    core.of_position = core.of_velocity = core.of_innovation = 1.0
    resume_core(core, design, measurement)


def resume_core(core: Core, design: Design, measurement: float) -> None:
    """Go on after a gap: the speed is kept, higher derivatives are not."""
    core.chain.x, core.chain.a, core.chain.j = measurement, 0.0, 0.0
    show_chain(core, design)


def show_chain(core: Core, design: Design) -> None:
    """Set what is published of the chain; order 1 gives no acceleration."""
    core.position, core.velocity = core.chain.x, core.chain.v
    core.acceleration = core.chain.a if design.order > 1 else math.nan


def correct(core: Core, coefficients: Coefficients, design: Design, measurement: float) -> float:
    """Take a measurement [rad]; return the innovation [rad]."""
    chain, dt, period = core.chain, coefficients.dt, design.shared.period
    if core.ticks == 0:  # the second sample gives the speed: right below half a turn per sample
        chain.v = wrap(measurement - chain.x, period) / dt
        chain.x, chain.a, chain.j = measurement, 0.0, 0.0
        restart_noise(core, 0.0, dt, design)
        show_chain(core, design)
        return 0.0
    if design.explicit:
        innovation = step_explicit(chain, dt, design, measurement)
    else:
        innovation = match(chain, coefficients, design, measurement)
    if not -period <= chain.x + chain.x < period:
        chain.x = wrap(chain.x, period)
    show_chain(core, design)
    core.total += innovation * innovation
    core.ticks += 1
    if core.ticks > REFRESH:
        restart_noise(core, averaged(core.power, core.total), dt, design)
    return innovation


def restart_noise(core: Core, power: float, dt: float, design: Design) -> None:
    """Compute the noise gains at this mean square innovation [rad^2], and average anew."""
    core.power, core.total, core.ticks = power, 0.0, 1
    core.of_position, core.of_velocity, core.of_innovation = noise_gains_at(power, dt, design)


def averaged(power: float, total: float) -> float:
    """Return the mean square innovation, after REFRESH samples whose squares make this `total`.

    What noise makes of the gains follows from it, so a transient must not stay in it for long.
    """
    mean = total / REFRESH
    if TRANSIENT_RATIO * mean < power:
        return TRANSIENT_DECAY * power
    return power + POWER_WEIGHT * (mean - power)


def match(
    chain: Derivatives, coefficients: Coefficients, design: Design, measurement: float
) -> float:
    """Take a measurement with eigenvalues exp(dt (L/|e|)^(1/(n+1)) p_i) of the error; see `gains`.

    Returns
    -------
    The innovation [rad].
    """
    advance(chain, coefficients.dt)
    period, innovation = design.shared.period, measurement - chain.x
    if not -period <= innovation + innovation < period:
        innovation = wrap(innovation, period)
    size = abs(innovation)
    if size > ZERO_INNOVATION:
        s = coefficients.dt * design.scale / math.pow(size, 1.0 / (design.order + 1.0))
        k0, k1, k2, k3 = matched(design.order, s, design.roots)
        chain.x += k0 * innovation
        chain.v += k1 * innovation * coefficients.rate
        chain.a += k2 * innovation * coefficients.rate_2
        chain.j += k3 * innovation * coefficients.rate_3
    return innovation


def advance(chain: Derivatives, dt: float) -> None:
    """Move the chain on by dt [s], the highest derivative constant."""
    v, a, j = chain.v, chain.a, chain.j
    chain.x += dt * (v + dt * (0.5 * a + dt * j / 6.0))
    chain.v += dt * (a + 0.5 * dt * j)
    chain.a += dt * j


def step_explicit(chain: Derivatives, dt: float, design: Design, measurement: float) -> float:
    """Take a measurement by forward Euler, as printed in textbooks.

    The corrections come after the step of the published predictor form; before it they are
    A^-1 of them.

    Returns
    -------
    The innovation [rad].
    """
    v, a, j = chain.v, chain.a, chain.j
    chain.x += dt * v
    chain.v += dt * a
    chain.a += dt * j
    innovation = wrap(measurement - chain.x, design.shared.period)
    size = abs(innovation)
    if size < ZERO_INNOVATION:
        return innovation
    signed = dt * size if innovation > 0.0 else -dt * size
    pace = design.scale / math.pow(size, 1.0 / (design.order + 1.0))  # (L/|e|)^(1/(n+1)) [1/s]
    fast = pace * signed
    k0, k1 = design.c1 * fast, design.c2 * pace * fast
    k2, k3 = design.c3 * pace * pace * fast, design.c4 * pace * pace * pace * fast
    k2 -= dt * k3
    k1 -= dt * k2
    k0 -= dt * k1
    chain.x += k0
    chain.v += k1
    chain.a += k2
    chain.j += k3
    return innovation


def noise_gains(
    core: Core, coefficients: Coefficients, design: Design
) -> tuple[float, float, float]:
    """Return the noise gains as they were computed, REFRESH samples ago at most."""
    return core.of_position, core.of_velocity, core.of_innovation


def pace(observer: Any, core: Core, coefficients: Coefficients, design: Design, dt: float) -> float:
    """Return how fast errors decay [1/s]: the slower, the larger the innovation is."""
    power = core.total if core.total > core.power else core.power  # of a transient, from its begin
    if power < ZERO_INNOVATION:
        power = ZERO_INNOVATION
    # one neper per sample: dead beat is no faster
    return min(ERROR_DECAY * design.scale / math.pow(power, 0.5 / (design.order + 1.0)), 1.0 / dt)


def design(gains: Gains, circle: Circle) -> Design:
    """Return what follows from the gains whatever the sample time is."""
    order, made = gains.order, Design()
    made.explicit, made.order = gains.form == 'explicit', order
    made.scale = gains.bound ** (1.0 / (order + 1))
    made.c1, made.c2, made.c3, made.c4 = COEFFICIENTS[order] + (0.0,) * (3 - order)
    made.roots = roots_of(order)
    if order == 3:
        made.table = [list(row) for row in noise_table(made.roots)]
    widest = OUTSIDE_PART * circle.period if circle.period > 0.0 and made.explicit else math.inf
    made.longest_dt = (widest / gains.bound) ** (1.0 / (order + 1))
    # Convergence from an error that one sample can hide: about the time that the bound needs to
    # make a speed of its own scale.
    settle = 3.0 * (0.01 / gains.bound) ** (1.0 / (order + 1))
    set_shared(made.shared, gains, circle, settle, LAG_3)
    return made


def limits(design: Design, dt: float) -> str | None:
    """Return why the form cannot work at this dt [s]; None: it can."""
    if dt <= design.longest_dt:
        return None
    return (
        f"form 'explicit' chatters over more than an eighth of a turn at a sample time "
        f'of {dt:.3g} s: it needs less than {design.longest_dt:.3g} s, or a lower bound; '
        "'matching' does not chatter"
    )


def group_delay(design: Design, dt: float) -> float:
    """Return 0 [s]."""
    return 0.0


OBSERVER = Observer(
    name='super_twisting',
    summary='super-twisting differentiators of order 1 to 3',
    gains=Gains,
    reference='Barbot, Djemai, Manamanni (2007); Levant (2003); matching discretisation',
    gives_acceleration=lambda gains: gains.order > 1,
)
