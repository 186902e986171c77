# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Finite difference with a one-pole low-pass: what most users have today."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from estimator_pkg.observers.angle.core import AngleCore, AngleGains, around
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import Functions, Observer
from estimator_pkg.parameters import parameter

LAG = 0.4  # see `AngleCore.lag`: (1 + w dt/2)/w of a ramp
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


class Design(NamedTuple):
    """What the gains imply whatever the sample time is."""

    pole: float  # of the low-pass [rad/s]
    period: float  # wrap period [rad]; 0: none


def prepare(design: Design, dt: float) -> tuple:
    """Return (1/dt, weight of the newest difference, dt, wrap period); the pole matched to dt."""
    return (1.0 / dt, -math.expm1(-design.pole * dt), dt, design.period)


def init(measurement: float, design: Design) -> tuple:
    """Return (last measurement [rad], velocity [rad/s], 1 after the second sample)."""
    return (measurement, 0.0, 0.0)


def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple:
    """Return the state one sample further, and the innovation [rad].

    The prediction is the last measurement moved on by the speed.
    """
    last, velocity, started = state
    rate, weight, dt, period = coefficients
    change = wrap(measurement - last, period)
    if started == 0.0:
        return (measurement, change * rate, 1.0), 0.0  # the speed was not known: no innovation
    return (
        (measurement, velocity + weight * (change * rate - velocity), 1.0),
        change - velocity * dt,
    )


def estimate(state: tuple) -> tuple[float, float, float]:
    """Return position [rad] (the measurement itself), velocity [rad/s], no acceleration."""
    last, velocity, _ = state
    return last, velocity, math.nan


def resume(state: tuple, measurement: float) -> tuple:
    """Return the state after a gap: at the measurement [rad], with the speed as it was."""
    _, velocity, started = state
    return (measurement, velocity, started)


def noise_gains(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Return variances of position, velocity [1/s^2] and innovation per unit variance of noise.

    v is a first-order low-pass (pole z = 1 - w) of (y_k - y_{k-1})/dt: the autocovariance 2, -1 of
    the difference gives 2 w^2/dt^2 (1 - z)/(1 - z^2) = 2 w^2/((1 + z) dt^2).
    """
    rate, weight, dt, period = coefficients
    pole = 1.0 - weight
    of_velocity = 2.0 * weight * weight * rate * rate / (1.0 + pole)
    # innovation = change - dt v_before; cov(change, v_before) = -weight/dt
    return 1.0, of_velocity, 2.0 + dt * dt * of_velocity + 2.0 * weight


def build(gains: Gains, circle: Circle) -> Functions:
    """Return the functions of the finite difference at these gains."""
    pole = 2.0 * math.pi * gains.bandwidth_hz

    def design() -> Design:
        return Design(pole, float(circle.period))

    def group_delay(dt: float) -> float:
        # of the low-pass, z/(1 - z) samples, and half a sample of the difference
        return dt * (0.5 - math.exp(-pole * dt) / math.expm1(-pole * dt))

    return around(
        AngleCore(
            design=design,
            settle=SETTLING / pole,
            prepare=prepare,
            init=init,
            correct=correct,
            estimate=estimate,
            resume=resume,
            noise_gains=noise_gains,
            limits=lambda dt: None,
            group_delay=group_delay,
            turns=True,
            lag=LAG,
        ),
        gains,
        circle,
    )


OBSERVER = Observer(
    name='finite_difference',
    summary='wrapped finite difference with a one-pole low-pass',
    gains=Gains,
    build=build,
    reference='textbook; the baseline that users have today',
)
