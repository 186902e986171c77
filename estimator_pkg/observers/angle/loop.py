# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A tracking loop of second order: what an alpha-beta filter, or a phase-locked loop, inherits.

    x = prediction + alpha e,   v += beta/dt e,   e = wrap(y - prediction)

A loop defines its gains, `Design` with at least `shared`, `design`, and in `prepare` alpha and
beta. Its second sample gives the speed.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.circle import wrap
from estimator_pkg.observers.angle.shared import LinearObserver
from estimator_pkg.observers.maths.tracking import noise_of_two
from estimator_pkg.record import record


class TrackingLoop(LinearObserver):
    """An observer that is a loop with the gains alpha and beta."""

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
        started: bool  # after the second sample

    @staticmethod
    def begin(core: Core, design: Any, measurement: float) -> None:
        """Begin at a measurement [rad], without a speed."""
        core.position, core.velocity, core.acceleration = measurement, 0.0, math.nan
        core.started = False

    @staticmethod
    def correct(core: Core, coefficients: Coefficients, design: Any, measurement: float) -> float:
        """Take a measurement [rad]; return the innovation [rad]."""
        period = design.shared.period
        innovation = measurement - core.position - core.velocity * coefficients.dt
        if innovation + innovation >= period or innovation + innovation < -period:
            innovation = wrap(innovation, period)
        if not core.started:
            core.position, core.started = measurement, True
            core.velocity += innovation / coefficients.dt
            return 0.0  # the speed was not known: no innovation
        # prediction + alpha e, but written from the measurement: it stays on the measurement's turn
        core.position = measurement - (1.0 - coefficients.alpha) * innovation
        core.velocity += coefficients.rate * innovation
        return innovation

    @staticmethod
    def noise_gains(
        core: Core, coefficients: Coefficients, design: Any
    ) -> tuple[float, float, float]:
        """Return variances of position, velocity [1/s^2], innovation per unit variance of noise."""
        dt = coefficients.dt
        return noise_of_two(coefficients.alpha, coefficients.rate * dt, dt)

    @classmethod
    def group_delay(cls, design: Any, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s]: dt (alpha/beta - 1/2)."""
        of_dt = cls.Coefficients()
        cls.prepare(of_dt, design, dt)
        return of_dt.alpha / of_dt.rate - 0.5 * dt
