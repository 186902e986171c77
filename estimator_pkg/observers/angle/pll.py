# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The phase-locked loop of motor drives: a PI loop on the wrapped error, with true sample times.

    x' = v + 2 zeta w0 e,   v' = w0^2 e,   e = wrap(y - x)

so that v follows the true velocity through w0^2/(s^2 + 2 zeta w0 s + w0^2). The loop is sampled
with matched poles: there is no sample time at which it is unstable. It starts at v = 0, as such
loops do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.circle import Circle, wrap
from estimator_pkg.observers.angle.shared import (  # noqa: F401  (its functions too)
    DRIVEN,
    EDGES,
    LAG_2,
    SINGLE_ANGLE,
    TURNS,
    AngleGains,
    SharedDesign,
    State,
    deviation,
    estimate,
    is_reading,
    pace,
    restart,
    resume,
    set_shared,
    start,
    step,
)
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.contract import no_limit as limits  # noqa: F401
from estimator_pkg.observers.contract import no_reason as why  # noqa: F401
from estimator_pkg.observers.maths.tracking import matched, natural_frequency, noise_of_two
from estimator_pkg.parameters import parameter
from estimator_pkg.record import record

SETTLING = 7.0  # time constants of the slower pole until a start from v = 0 is right to 1 %


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `pll`."""

    bandwidth_hz: float = parameter(
        50.0,
        unit='Hz',
        range=(0.001, 1e5),
        search=(0.5, 500.0),
        description='-3 dB frequency from true to estimated velocity',
        equation='w0 = 2 pi f / sqrt(1 - 2 zeta^2 + sqrt((1 - 2 zeta^2)^2 + 1))',
    )
    damping: float = parameter(
        1.0,
        range=(0.2, 10.0),
        advanced=True,
        description='zeta of the loop; 1: two equal poles, 0.707: flattest response',
        equation='s^2 + 2 zeta w0 s + w0^2',
    )


@record
class Design:
    """What the gains imply whatever the sample time is: poles at -decay +- sqrt(discriminant)."""

    shared: SharedDesign
    decay: float  # zeta w0 [1/s]
    discriminant: float  # (zeta^2 - 1) w0^2 [1/s^2]


@record
class Coefficients:
    """What follows from the sample time."""

    dt: float  # [s]
    alpha: float
    rate: float  # beta/dt [1/s]


@record
class Core:
    """The loop."""

    position: float  # x [rad]
    velocity: float  # v [rad/s]
    acceleration: float  # nan


def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
    """Set what follows from dt [s]."""
    alpha, beta = matched(design.decay, design.discriminant, dt)
    coefficients.dt, coefficients.alpha, coefficients.rate = dt, alpha, beta / dt


def begin(core: Core, design: Design, measurement: float) -> None:
    """Begin at a measurement [rad] and v = 0."""
    core.position, core.velocity, core.acceleration = measurement, 0.0, math.nan


def resume_core(core: Core, design: Design, measurement: float) -> None:
    """Go on after a gap: at the measurement [rad], with the speed as it was."""
    core.position = measurement


def correct(core: Core, coefficients: Coefficients, design: Design, measurement: float) -> float:
    """Take a measurement [rad]; return the innovation [rad]."""
    period = design.shared.period
    innovation = measurement - core.position - core.velocity * coefficients.dt
    if innovation + innovation >= period or innovation + innovation < -period:
        innovation = wrap(innovation, period)
    # prediction + alpha e, but written from the measurement: so it stays on the measurement's turn
    core.position = measurement - (1.0 - coefficients.alpha) * innovation
    core.velocity += coefficients.rate * innovation
    return innovation


def noise_gains(
    core: Core, coefficients: Coefficients, design: Design
) -> tuple[float, float, float]:
    """Return variances of position, velocity [1/s^2] and innovation per unit variance of noise."""
    dt = coefficients.dt
    return noise_of_two(coefficients.alpha, coefficients.rate * dt, dt)


def design(gains: Gains, circle: Circle) -> Design:
    """Return what follows from the gains whatever the sample time is."""
    made = Design()
    natural = natural_frequency(gains.bandwidth_hz, gains.damping)
    made.decay = gains.damping * natural
    made.discriminant = (gains.damping * gains.damping - 1.0) * natural * natural
    slow = made.decay
    if made.discriminant > 0.0:
        slow -= math.sqrt(made.discriminant)
    set_shared(made.shared, gains, circle, SETTLING / slow, LAG_2)
    return made


def group_delay(design: Design, dt: float) -> float:
    """Return the delay of the velocity at low frequency [s]."""
    alpha, beta = matched(design.decay, design.discriminant, dt)
    return dt * (alpha / beta - 0.5)


OBSERVER = Observer(
    name='pll',
    summary='phase-locked loop of motor drives, second order',
    gains=Gains,
    reference='textbook; Harnefors and Nee, IEEE Trans. Ind. Electron. 47(1), 2000',
)
