# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Ripple of the speed at the electrical frequency and at twice that: errors of the current sensors.

An offset of a phase current is constant in the stator frame and turns backwards in the frame of the
rotor: the speed ripples at the electrical frequency. Unequal gains of the phases give twice that
frequency. Neither is white, so that the innovation variance does not contain them. What the
low-pass on the speed removes contains them too, and not the motion.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.pmsm.noise import power_of

RIPPLE_MEMORY = 0.05  # s, least time constant of the averages
NARROW = 100.0  # their corner is this much below that of the low-pass: they leave out white noise
MOST = 3.0  # largest factor from removed to remaining ripple: at low speed little is removed
NO_RIPPLES = (complex(0.0, 0.0), complex(0.0, 0.0))


def follow_ripples(
    ripples: tuple[complex, complex], weight: float, removed: float, y: complex
) -> tuple[complex, complex]:
    """Return half the complex amplitudes [rad/s] of `removed` at one and two times the frequency.

    Parameters
    ----------
    weight : of the newest sample.
    removed : speed of the frame minus the output of the low-pass [rad/s].
    y : back-EMF in the stator frame [V], which has the phase of the rotor.
    """
    once, twice = ripples
    size = abs(y)
    if size > 0.0:
        phase = y / size
        once += weight * (removed * phase - once)
        twice += weight * (removed * phase * phase - twice)
    return once, twice


def ripple_variances(
    ripples: tuple[complex, complex], omega: float, natural: float, damping: float
) -> tuple[float, float]:
    """Return the variances of angle [rad^2] and speed [rad^2/s^2], electrical.

    The low-pass F = natural^2/(s^2 + 2 damping natural s + natural^2) leaves F/(1 - F) =
    natural^2/(s (s + 2 damping natural)) times what it removes.

    Parameters
    ----------
    omega : electrical speed [rad/s], not negative.
    natural, damping : of the low-pass on the speed; natural 0: no low-pass, and no ripple known.
    """
    of_angle = of_speed = 0.0
    if natural > 0.0 and omega > 0.0:
        once, twice = ripples
        for at, amplitude in ((omega, once), (2.0 * omega, twice)):
            left = natural * natural / (at * math.hypot(at, 2.0 * damping * natural))
            square = 2.0 * power_of(amplitude) * min(left, MOST) ** 2
            of_speed += square
            of_angle += square / (at * at)
    return of_angle, of_speed
