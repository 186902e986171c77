"""The controller of section 6.3: the pendulum is kept upright while the cart follows a triangle.

The law is printed with the wrong overall sign (the poles of the printed one reach +30.8 1/s).
"""

from __future__ import annotations

import math

AMPLITUDE, PERIOD = 0.2, 10.0  # m, s: of the cart's reference
SOFT = 0.02  # m/s: width of the compensated friction's change of sign


def triangle(time: float) -> tuple[float, float]:
    """The cart's reference [m] and its rate [m/s]: a triangle that starts at 0, rising."""
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
    """The force on the cart [N], with the Coulomb friction compensated.

    Parameters
    ----------
    y, v : measured positions and estimated velocities (pendulum [rad], cart [m]).
    forward, backward : levels of the cart's friction [N].
    """
    force = 104.0 * y[0] + 20.0 * v[0] + 21.0 * (y[1] - reference) + 23.0 * (v[1] - rate)
    return force + (forward if v[1] >= 0.0 else backward) * math.tanh(v[1] / SOFT)
