# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The illustrative example of Barbot, Djemai, Manamanni (2007), with its misprints corrected."""

from __future__ import annotations

import math
from collections.abc import Sequence

from estimator_pkg.models.switched import SwitchedModel, Vector

A_D = ((0.5, 0.0, 1.0), (-0.2, 0.1, 0.0), (-0.2, 0.0, -0.1))


def dynamics(x: Vector, z: Vector, u: Vector) -> Sequence[float]:
    """F as printed."""
    return (
        x[1] + z[0],
        -10.0 * x[1] - 5.0 * math.sin(0.5 * x[2]) - x[0] * x[0] * z[0],
        x[3] + z[0],
        -x[2] * x[2] + 5.0 * x[0] + x[0] * z[1],
    )


def phi(x: Vector, z: Vector) -> Sequence[float]:
    """Return zeta: the outputs x1, x3 and their derivatives."""
    return (x[0], x[1] + z[0], x[2], x[3] + z[0])


def phi_inverse(zeta: Vector, z: Vector) -> Sequence[float]:
    """Return the state from zeta."""
    return (zeta[0], zeta[1] - z[0], zeta[2], zeta[3] - z[0])


def gamma(zeta: Vector, u: Vector) -> Sequence[float]:
    """Return the part without Z; the printed -z1 in the second row contradicts F."""
    return (-10.0 * zeta[1] - 5.0 * math.sin(0.5 * zeta[2]), -zeta[2] * zeta[2] + 5.0 * zeta[0])


def lam(zeta: Vector, u: Vector) -> Sequence[Vector]:
    """Return Lambda, the factor of Z."""
    return ((10.0 - zeta[0] * zeta[0], 0.0, 0.0), (0.0, zeta[0], 0.0))


MODEL = SwitchedModel(
    indices=(2, 2),
    size=3,
    gamma=gamma,
    lam=lam,
    transition=lambda mode: A_D,
    offset=lambda mode, v, y: (y[0], 0.0, y[1]),
    dynamics=dynamics,
    phi=phi,
    phi_inverse=phi_inverse,
    start=((1.0, 0.5, 0.5, 0.0), (0.5, 0.5, 0.2)),
    probe=lambda t: (),
    period=0.5,
    bounds=((120.0, 400.0), (60.0, 150.0)),
    names=('z1', 'z2', 'z3'),
    units=('', '', ''),
    joints=('y1', 'y2'),
)
