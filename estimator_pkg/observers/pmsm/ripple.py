# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Ripple of the speed at the electrical frequency and at twice that: errors of the current sensors.

An offset of a phase current is constant in the stator frame and turns backwards in the frame of the
rotor: the speed ripples at the electrical frequency. Unequal gains of the phases give twice that
frequency. Neither is white, so that the innovation variance does not contain them. What the
low-pass on the speed removes contains them too, and not the motion.
"""

from __future__ import annotations

from estimator_pkg.observers.pmsm.noise import DAMPING
from estimator_pkg.observers.pmsm.state import Ripples

RIPPLE_MEMORY = 0.05  # s, least time constant of the averages
NARROW = 100.0  # their corner is this much below that of the low-pass: they leave out white noise
MOST = 3.0  # largest factor from removed to remaining ripple: at low speed little is removed


def follow_ripples(
    ripples: Ripples, weight: float, removed: float, y_alpha: float, y_beta: float
) -> None:
    """Average the ripples of `removed` at one and two times the frequency.

    Parameters
    ----------
    weight : of the newest sample.
    removed : speed of the frame minus the output of the low-pass [rad/s].
    y_alpha, y_beta : back-EMF in the stator frame [V], which has the phase of the rotor.
    """
    size = abs(complex(y_alpha, y_beta))
    if size > 0.0:
        phase1, phase2 = y_alpha / size, y_beta / size
        once1, once2 = removed * phase1, removed * phase2
        ripples.once1 += weight * (once1 - ripples.once1)
        ripples.once2 += weight * (once2 - ripples.once2)
        ripples.twice1 += weight * (once1 * phase1 - once2 * phase2 - ripples.twice1)
        ripples.twice2 += weight * (once1 * phase2 + once2 * phase1 - ripples.twice2)


def ripple_variances(ripples: Ripples, omega: float, natural: float) -> tuple[float, float]:
    """Return the variances of angle [rad^2] and speed [rad^2/s^2], electrical.

    Parameters
    ----------
    omega : electrical speed [rad/s], not negative.
    natural : natural frequency of the low-pass on the speed; 0: none, and no ripple known.
    """
    if natural <= 0.0 or omega <= 0.0:
        return 0.0, 0.0
    once = remaining(ripples.once1, ripples.once2, omega, natural)
    twice = remaining(ripples.twice1, ripples.twice2, 2.0 * omega, natural)
    return once / (omega * omega) + twice / (2.0 * omega * (2.0 * omega)), once + twice


def remaining(removed1: float, removed2: float, omega: float, natural: float) -> float:
    """Return the variance of the ripple that is left at the frequency `omega` [rad/s].

    The low-pass F = natural^2/(s^2 + 2 damping natural s + natural^2) leaves F/(1 - F) =
    natural^2/(s (s + 2 damping natural)) times what it removes.
    """
    left = natural * natural / (omega * abs(complex(omega, 2.0 * DAMPING * natural)))
    left = min(left, MOST)
    return 2.0 * (removed1 * removed1 + removed2 * removed2) * (left * left)
