# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The controller of section 6.3: it balances the pendulum while the cart follows a triangle.

The paper prints the law with the wrong overall sign (as printed, a pole lies at +30.8 1/s).
"""

from __future__ import annotations

import math

AMPLITUDE, PERIOD = 0.2, 10.0  # m, s: of the cart's reference
SOFT = 0.02  # width of the smoothed sign function in the friction compensation [m/s]


def triangle(time: float) -> tuple[float, float]:
    """Return the cart's reference [m] and its rate [m/s]: a triangle from 0, rising first."""
    phase = time / PERIOD + 0.25
    phase -= math.floor(phase)
    slope = 4.0 * AMPLITUDE / PERIOD
    if phase < 0.5:
        return AMPLITUDE * (4.0 * phase - 1.0), slope
    return AMPLITUDE * (3.0 - 4.0 * phase), -slope


def balancing_force(
    y: tuple[float, float],
    v: tuple[float, float],
    reference: float,
    rate: float,
    forward: float,
    backward: float,
) -> float:
    """Return the force on the cart [N], with compensation of the Coulomb friction.

    Parameters
    ----------
    y, v : measured positions and estimated velocities (pendulum [rad], cart [m]).
    forward, backward : levels of the cart's friction [N].
    """
    force = 104.0 * y[0] + 20.0 * v[0] + 21.0 * (y[1] - reference) + 23.0 * (v[1] - rate)
    return force + (forward if v[1] >= 0.0 else backward) * math.tanh(v[1] / SOFT)
