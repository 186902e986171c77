# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Finite difference with a one-pole low-pass: what most users have today."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.circle import Circle, wrap
from estimator_pkg.observers.angle.shared import (  # noqa: F401  (its functions too)
    DRIVEN,
    EDGES,
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
from estimator_pkg.parameters import parameter
from estimator_pkg.record import record

RAMP_LAG = 0.4  # see `starts.start_deviation`: (1 + w dt/2)/w of a ramp
SETTLING = 3.0  # time constants until a start counts as settled


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `finite_difference`."""

    bandwidth_hz: float = parameter(
        50.0,
        unit='Hz',
        range=(0.001, 1e6),
        search=(0.5, 500.0),
        description='-3 dB frequency from true to estimated velocity (the pole of the low-pass)',
        equation='v += (1 - exp(-2 pi f dt)) (dy/dt - v)',
    )


@record
class Design:
    """What the gains imply whatever the sample time is."""

    shared: SharedDesign
    pole: float  # of the low-pass [rad/s]


@record
class Coefficients:
    """What follows from the sample time; the pole is matched to it."""

    dt: float  # [s]
    rate: float  # 1/dt [1/s]
    weight: float  # of the newest difference


@record
class Core:
    """The low-pass, and the last measurement."""

    position: float  # the last measurement [rad]
    velocity: float  # [rad/s]
    acceleration: float  # nan
    started: bool  # after the second sample


def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
    """Set what follows from dt [s]."""
    coefficients.dt, coefficients.rate = dt, 1.0 / dt
    coefficients.weight = -math.expm1(-design.pole * dt)


def begin(core: Core, design: Design, measurement: float) -> None:
    """Begin at a measurement [rad], without a speed."""
    core.position, core.velocity, core.acceleration = measurement, 0.0, math.nan
    core.started = False


def resume_core(core: Core, design: Design, measurement: float) -> None:
    """Go on after a gap: at the measurement [rad], with the speed as it was."""
    core.position = measurement


def correct(core: Core, coefficients: Coefficients, design: Design, measurement: float) -> float:
    """Take a measurement [rad]; return the innovation [rad].

    The prediction is the last measurement moved on by the speed.
    """
    change = wrap(measurement - core.position, design.shared.period)
    core.position = measurement
    if not core.started:
        core.velocity, core.started = change * coefficients.rate, True
        return 0.0  # the speed was not known: no innovation
    innovation = change - core.velocity * coefficients.dt
    core.velocity += coefficients.weight * (change * coefficients.rate - core.velocity)
    return innovation


def noise_gains(
    core: Core, coefficients: Coefficients, design: Design
) -> tuple[float, float, float]:
    """Return variances of position, velocity [1/s^2] and innovation per unit variance of noise.

    v is a first-order low-pass (pole z = 1 - w) of (y_k - y_{k-1})/dt: the autocovariance 2, -1 of
    the difference gives 2 w^2/dt^2 (1 - z)/(1 - z^2) = 2 w^2/((1 + z) dt^2).
    """
    dt, rate, weight = coefficients.dt, coefficients.rate, coefficients.weight
    pole = 1.0 - weight
    of_velocity = 2.0 * weight * weight * rate * rate / (1.0 + pole)
    # innovation = change - dt v_before; cov(change, v_before) = -weight/dt
    return 1.0, of_velocity, 2.0 + dt * dt * of_velocity + 2.0 * weight


def design(gains: Gains, circle: Circle) -> Design:
    """Return what follows from the gains whatever the sample time is."""
    made = Design()
    made.pole = 2.0 * math.pi * gains.bandwidth_hz
    set_shared(made.shared, gains, circle, SETTLING / made.pole, RAMP_LAG)
    return made


def group_delay(design: Design, dt: float) -> float:
    """Return the delay of the velocity at low frequency [s].

    That of the low-pass, z/(1 - z) samples, and half a sample of the difference.
    """
    pole = design.pole
    return dt * (0.5 - math.exp(-pole * dt) / math.expm1(-pole * dt))


OBSERVER = Observer(
    name='finite_difference',
    summary='wrapped finite difference with a one-pole low-pass',
    gains=Gains,
    reference='textbook; the baseline that users have today',
)
