# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The motion as the first filter estimates it."""

from __future__ import annotations

from estimator_pkg.record import record


@record
class Motion:
    """Angle, speed and acceleration."""

    angle: float  # x [rad], on the turn of the newest reading
    velocity: float  # v [rad/s]
    acceleration: float  # a [rad/s^2]
    idle: float  # time since the last informative reading [s]
