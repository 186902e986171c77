# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Finite difference with a one-pole low-pass: what most users have today.

    v += w ((y - y_before)/dt - v),   w = 1 - exp(-2 pi f dt)

This is the tracking loop with alpha = 1 and beta = w: the innovation is y - y_before - v dt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.circle import Circle
from estimator_pkg.observers.angle.loop import TrackingLoop
from estimator_pkg.observers.angle.shared import AngleGains, SharedDesign, set_shared
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


class FiniteDifference(TrackingLoop):
    """The loop whose position is the last measurement."""

    name = 'finite_difference'
    summary = 'wrapped finite difference with a one-pole low-pass'
    reference = 'textbook; the baseline that users have today'
    gains = Gains

    @record
    class Design:
        """What the gains imply whatever the sample time is."""

        shared: SharedDesign
        pole: float  # of the low-pass [rad/s]

    @staticmethod
    def design(gains: Gains, circle: Circle) -> FiniteDifference.Design:
        """Return what follows from the gains whatever the sample time is."""
        made = FiniteDifference.Design()
        made.pole = 2.0 * math.pi * gains.bandwidth_hz
        set_shared(made.shared, gains, circle, SETTLING / made.pole, RAMP_LAG)
        return made

    @staticmethod
    def prepare(coefficients: TrackingLoop.Coefficients, design: Design, dt: float) -> None:
        """Set what follows from dt [s]: alpha = 1, and beta the weight of the newest difference."""
        weight = -math.expm1(-design.pole * dt)
        coefficients.dt, coefficients.alpha, coefficients.rate = dt, 1.0, weight / dt
