# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The estimated frame of the observer of Bosso, Azzollini and Tilli (2020): jump and outputs.

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

from estimator_pkg.observers.pmsm.state import Core

HALF_ROOT_3 = 0.5 * math.sqrt(3.0)


def emf(core: Core) -> tuple[float, float]:
    """Return y = C[z] J h [V], an estimate of chi zeta_chi in the static frame, above (14)."""
    # without -0.0, of which atan2 makes half a turn while the back-EMF is zero
    alpha = 0.0 - core.z1 * core.h2 - core.z2 * core.h1
    return alpha, core.z1 * core.h1 - core.z2 * core.h2


def reflect(core: Core) -> bool:
    """Reset the frame if a clock tick does: the jump (14), (16), which maps eta to -F eta.

    It does if the back-EMF shows that the frame points away from the rotor (h2 >= 0: eta1 <= 0).
    G_f is the rotation (conj(h)/|h|)^2. It maps h to its mirror image; current and back-EMF keep
    their values in the static frame. (With the printed second row, G_f i, they would not.)
    """
    if not core.h2 >= 0.0:
        return False
    size = abs(complex(core.h1, core.h2))
    if size != 0.0:
        root1, root2 = core.h1 * (1.0 / size), -core.h2 * (1.0 / size)
        g1, g2 = root1 * root1 - root2 * root2, root1 * root2 + root2 * root1
        core.i1, core.i2 = g1 * core.i1 - g2 * core.i2, g1 * core.i2 + g2 * core.i1
        core.z1, core.z2 = g1 * core.z1 + g2 * core.z2, g1 * core.z2 - g2 * core.z1
        core.h2 = -core.h2
    return True


def align(core: Core, seen1: float, seen2: float) -> None:
    """Turn the frame to that in which a converged observer has the back-EMF `seen` [V]."""
    size = abs(complex(seen1, seen2))
    if size != 0.0:
        t1, t2 = -seen2 * (1.0 / size), seen1 * (1.0 / size)
        core.i1, core.i2 = core.i1 * t1 + core.i2 * t2, core.i2 * t1 - core.i1 * t2
        core.h1, core.h2 = core.h1 * t1 + core.h2 * t2, core.h2 * t1 - core.h1 * t2
        core.z1, core.z2 = core.z1 * t1 - core.z2 * t2, core.z1 * t2 + core.z2 * t1


def rotor_angle(core: Core) -> float:
    """Return theta_hat = arg(z sgn(x)) [rad, electrical, in (-pi, pi]]."""
    if core.x < 0.0:
        return math.atan2(-core.z2, -core.z1)
    return math.atan2(core.z2, core.z1)


def flux_linkage(x: float, lowest: float, highest: float) -> float:
    """Return phi_hat = sat(1/|xi|) [Wb]."""
    size = abs(x)
    if size * highest <= 1.0:
        return highest
    if size * lowest >= 1.0:
        return lowest
    return 1.0 / size


def phase_signs(i_alpha: float, i_beta: float) -> tuple[float, float]:
    """Return the vector of the signs of the three phase currents.

    Dead time reduces the voltage in this direction.
    """
    half = HALF_ROOT_3 * i_beta
    a = 1.0 if i_alpha > 0.0 else -1.0
    b = 1.0 if half > 0.5 * i_alpha else -1.0
    c = 1.0 if -half > 0.5 * i_alpha else -1.0
    return (2.0 * a - b - c) / 3.0, (b - c) / (2.0 * HALF_ROOT_3)
