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
from typing import NamedTuple

from estimator_pkg.observers.angle.core import LAG_2, AngleCore, AngleGains, around
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import Functions, Observer
from estimator_pkg.observers.maths.tracking import matched, natural_frequency, noise_of_two
from estimator_pkg.parameters import parameter

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


class Design(NamedTuple):
    """What the gains imply whatever the sample time is: poles at -decay +- sqrt(discriminant)."""

    decay: float  # zeta w0 [1/s]
    discriminant: float  # (zeta^2 - 1) w0^2 [1/s^2]
    period: float  # wrap period [rad]; 0: none


def prepare(design: Design, dt: float) -> tuple:
    """Return (alpha, beta/dt [1/s], dt [s], wrap period [rad])."""
    alpha, beta = matched(design.decay, design.discriminant, dt)
    return (alpha, beta / dt, dt, design.period)


def init(measurement: float, design: Design) -> tuple:
    """Return (position [rad], velocity [rad/s])."""
    return (measurement, 0.0)


def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple[tuple, float]:
    """Return the state one sample further, and the innovation [rad]."""
    position, velocity = state
    alpha, rate, dt, period = coefficients
    innovation = measurement - position - velocity * dt
    if innovation + innovation >= period or innovation + innovation < -period:
        innovation = wrap(innovation, period)
    # prediction + alpha e, but written from the measurement: so it stays on the measurement's turn
    return (measurement - (1.0 - alpha) * innovation, velocity + rate * innovation), innovation


def estimate(state: tuple) -> tuple[float, float, float]:
    """Return position [rad], velocity [rad/s], no acceleration."""
    position, velocity = state
    return position, velocity, math.nan


def resume(state: tuple, measurement: float) -> tuple:
    """Return the state after a gap: at the measurement [rad], with the speed as it was."""
    _, velocity = state
    return (measurement, velocity)


def noise_gains(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Return variances of position, velocity [1/s^2] and innovation per unit variance of noise."""
    alpha, rate, dt, period = coefficients
    return noise_of_two(alpha, rate * dt, dt)


def build(gains: Gains, circle: Circle) -> Functions:
    """Return the functions of the loop at these gains."""
    natural = natural_frequency(gains.bandwidth_hz, gains.damping)
    decay = gains.damping * natural
    discriminant = (gains.damping * gains.damping - 1.0) * natural * natural
    slow = decay - math.sqrt(discriminant) if discriminant > 0.0 else decay

    def design() -> Design:
        return Design(decay, discriminant, float(circle.period))

    def group_delay(dt: float) -> float:
        alpha, beta = matched(decay, discriminant, dt)
        return dt * (alpha / beta - 0.5)

    return around(
        AngleCore(
            design=design,
            settle=SETTLING / slow,
            prepare=prepare,
            init=init,
            correct=correct,
            estimate=estimate,
            resume=resume,
            noise_gains=noise_gains,
            limits=lambda dt: None,
            group_delay=group_delay,
            turns=True,
            lag=LAG_2,
        ),
        gains,
        circle,
    )


OBSERVER = Observer(
    name='pll',
    summary='phase-locked loop of motor drives, second order',
    gains=Gains,
    build=build,
    reference='textbook; Harnefors and Nee, IEEE Trans. Ind. Electron. 47(1), 2000',
)
