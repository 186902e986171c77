# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer of Bosso, Azzollini and Tilli (2020) in continuous time: flow and jump.

A two-vector (a, b) is the complex number a + j b; J v is j v, C[z] v is z v. All signals except z
and y are in the estimated frame z (zeta_hat_chi in the paper). Once converged, the frame turns with
the rotor:

    i, h   estimates of current [A] and back-EMF [V];  converged: h = -j chi, chi = |omega| phi
    z      unit number;                                converged: sgn(omega) exp(j theta)
    x      xi_hat [1/Wb];                              converged: sgn(omega) / phi

Equation numbers are the paper's. docs/papers/pmsm.md lists its misprints.
"""

from __future__ import annotations

import math

HALF_ROOT_3 = 0.5 * math.sqrt(3.0)


def frame_speed(h: complex, x: float, k_eta: float) -> float:
    """Return omega_hat_chi [rad/s], the speed of the estimated frame, below (4)."""
    return abs(h) * x + k_eta * h.real


def emf(h: complex, z: complex) -> complex:
    """Return y = C[z] J h [V], an estimate of chi zeta_chi in the static frame, above (14)."""
    return z * (1j * h)


def flow(
    i: complex,
    h: complex,
    z: complex,
    x: float,
    current: complex,
    voltage: complex,
    resistance: float,
    inductance: float,
    k_p: float,
    k_i: float,
    k_eta: float,
    gamma: float,
) -> tuple[complex, complex, complex, float]:
    """Return the time derivatives of (i, h, z, x): the flow of (5) and (16).

    Parameters
    ----------
    current, voltage : measured stator current [A] and voltage [V] in the static frame.
    """
    back = z.conjugate()
    i_frame = back * current
    error = i_frame - i
    turning = complex(0.0, frame_speed(h, x, k_eta))
    # the rotation acts on the measured current, so that the fast error system is linear
    d_i = (
        (h + back * voltage - resistance * i) * (1.0 / inductance) - turning * i_frame + k_p * error
    )
    return d_i, k_i * error, turning * z, gamma * h.real


def reflect(i: complex, h: complex, z: complex) -> tuple[complex, complex, complex]:
    """Return (i, h, z) after a clock tick: the jump (14), (16), which maps eta to -F eta.

    The frame is reset if the back-EMF shows that it points away from the rotor (h2 >= 0). G_f is
    the rotation (conj(h)/|h|)^2. It maps h to its mirror image; current and back-EMF keep their
    values in the static frame. (With the printed second row, G_f i, they would not.)
    """
    size = abs(h)
    if h.imag < 0.0 or size == 0.0:
        return i, h, z
    root = h.conjugate() * (1.0 / size)
    turn = root * root
    return turn * i, h.conjugate(), turn.conjugate() * z


def aligned(i: complex, h: complex, z: complex, seen: complex) -> tuple[complex, complex, complex]:
    """Return (i, h, z) in the frame in which a converged observer has the back-EMF `seen` [V]."""
    size = abs(seen)
    if size == 0.0:
        return i, h, z
    turn = complex(-seen.imag, seen.real) * (1.0 / size)
    back = turn.conjugate()
    return i * back, h * back, z * turn


def wants_reflection(h: complex) -> bool:
    """Return True if a clock tick resets the frame: eta1 <= 0."""
    return h.imag >= 0.0


def rotor_angle(z: complex, x: float) -> float:
    """Return theta_hat = arg(z sgn(x)) [rad, electrical, in (-pi, pi]]."""
    if x < 0.0:
        return math.atan2(-z.imag, -z.real)
    return math.atan2(z.imag, z.real)


def flux_linkage(x: float, lowest: float, highest: float) -> float:
    """Return phi_hat = sat(1/|xi|) [Wb]."""
    size = abs(x)
    if size * highest <= 1.0:
        return highest
    if size * lowest >= 1.0:
        return lowest
    return 1.0 / size


def phase_signs(current: complex) -> complex:
    """Return the vector of the signs of the three phase currents.

    Dead time reduces the voltage in this direction.
    """
    half = HALF_ROOT_3 * current.imag
    a = 1.0 if current.real > 0.0 else -1.0
    b = 1.0 if half > 0.5 * current.real else -1.0
    c = 1.0 if -half > 0.5 * current.real else -1.0
    return complex((2.0 * a - b - c) / 3.0, (b - c) / (2.0 * HALF_ROOT_3))
