# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Algorithm 1 of Brentari et al. (2018), as printed (with the absolute-value bars it lost)."""

from __future__ import annotations

import math

from estimator_pkg.circle import wrap
from estimator_pkg.observers.angle.hybrid.design import Coefficients, Core, Design
from estimator_pkg.observers.angle.hybrid.injections import inject
from estimator_pkg.observers.maths.tracking import noise_of_two

UNSTABLE = 1e300  # a noise gain that nothing bounds; unlike inf, it may be multiplied by 0


def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
    """Set the pace of the slowest pole, a root of z^2 - (2 - a - b) z + 1 - a.

    a = T l1 and b = T^2 l2.
    """
    alpha, beta = dt * design.l1, dt * dt * design.l2
    middle = 1.0 - 0.5 * (alpha + beta)
    square = middle * middle - (1.0 - alpha)
    slowest = abs(middle) + math.sqrt(square) if square > 0.0 else math.sqrt(1.0 - alpha)
    coefficients.dt = dt
    coefficients.pace = -math.log(slowest) / dt if slowest > 0.0 else math.inf


def place(core: Core, design: Design, measurement: float) -> None:
    """Set the position to a measurement [rad], wrapped."""
    core.position = wrap(measurement, design.shared.period)
    core.acceleration = math.nan


def correct(core: Core, coefficients: Coefficients, design: Design, measurement: float) -> float:
    """Take a measurement [rad] of any convention by Algorithm 1; return the innovation [rad]."""
    period, dt = design.shared.period, coefficients.dt
    half, measurement = 0.5 * period, wrap(measurement, period)
    predicted = core.position + dt * core.velocity  # line 3
    innovation = measurement - predicted
    injected = inject(innovation, design)
    position = predicted + dt * design.l1 * injected
    core.velocity += dt * design.l2 * injected
    if abs(abs(measurement - position) - half) <= design.margin:  # line 4: in J2
        position = measurement
    if abs(position) >= half + design.margin:  # line 7: in J1
        position -= math.copysign(period, position)
    core.position = position
    return wrap(innovation, period)


def noise_gains(coefficients: Coefficients, design: Design) -> tuple[float, float, float]:
    """Return what `tracking.noise_of_two` gives for alpha = T l1 and beta = T^2 l2.

    As good as infinite where this one sample time is beyond the stability limit.
    """
    dt = coefficients.dt
    alpha, beta = dt * design.l1, dt * dt * design.l2
    if 2.0 * alpha + beta >= 4.0:
        return UNSTABLE, UNSTABLE, 1.0
    return noise_of_two(alpha, beta, dt)
