# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The robotic leg of section 5.2; q = (r [m], th [rad], phi [rad]), u = (force, torque).

    M = diag(m1, m1 r^2, m2),  V = 0,  G = [[1, 0], [0, -1], [0, 1]]

Psi and calM are the paper's own. They are singular at sin th = 0 (and r = 0), so the model must not
be used there. The first two momenta are kappa times the angular momentum plus p_y, and p_y: both
are conserved without input.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

from estimator_pkg.models.mechanics import TURN, Matrix, Mechanics, Model, Values, Vector
from estimator_pkg.models.mechanics import no_damping as damping  # noqa: F401
from estimator_pkg.parameters import structural


@dataclass(frozen=True)
class Parameters:
    """The parameters of the leg; the defaults are the paper's."""

    foot_mass: float = structural(
        4.5, unit='kg', range=(1e-9, 1e6), equation='m1', description='mass at the end of the leg'
    )
    body_inertia: float = structural(
        1.7, unit='kg m^2', range=(1e-9, 1e6), equation='m2', description='inertia of the body'
    )
    kappa: float = structural(
        5.0,
        unit='1/m',
        range=(1e-6, 1e6),
        description='constant of the paper in Psi; any value above 0 is admissible',
    )
    margin: float = structural(
        0.02, range=(1e-9, 0.5), description='the model is not used where |sin th| is below this'
    )


JOINTS, INPUTS = 3, 2
# values: m1, m2, kappa, margin


def inertia(out: Matrix, values: Values, q: Vector) -> None:
    """Set M."""
    out[0][0] = values[0]
    out[1][1] = values[0] * q[0] * q[0]
    out[2][2] = values[1]
    out[0][1] = out[1][0] = out[0][2] = out[2][0] = out[1][2] = out[2][1] = 0.0


def factors(calm: Matrix, psi: Matrix, values: Values, q: Vector) -> None:
    """Set calM and Psi."""
    r = q[0]
    s, c = math.sin(q[1]), math.cos(q[1])
    kappa = values[2]
    km = kappa * values[0]
    turning = 1.0 / (km * r * r)
    calm[0][0], calm[0][1] = -c / (s * km * r), (c + kappa * r) / (km * s * r)
    calm[1][0], calm[1][1] = turning, -turning
    calm[2][2] = 1.0 / values[1]
    psi[0][0] = psi[0][1] = s
    psi[1][0], psi[1][1] = c / r + kappa, c / r
    psi[2][2] = 1.0
    for k in range(2):
        calm[k][2] = calm[2][k] = psi[k][2] = psi[2][k] = 0.0


def force(out: Vector, values: Values, q: Vector, v: Vector, u: Vector) -> None:
    """Set G u."""
    out[0], out[1], out[2] = u[0], -u[1], u[1]


def coriolis(out: Vector, values: Values, q: Vector, v: Vector) -> None:
    """Set C v."""
    m1r = values[0] * q[0]
    out[0], out[1], out[2] = -m1r * v[1] * v[1], 2.0 * m1r * v[0] * v[1], 0.0


def admits(values: Values, q: Vector) -> bool:
    """Return False near sin th = 0 and r = 0."""
    return abs(math.sin(q[1])) > values[3] and q[0] > values[3]


def build(parameters: Parameters) -> Mechanics:
    """The leg with these numbers."""
    p = parameters
    return Mechanics(
        name='robotic_leg',
        joints=('r', 'th', 'phi'),
        periods=(0.0, TURN, TURN),
        values=(p.foot_mass, p.body_inertia, p.kappa, p.margin),
        actuated=(0, 2),
        model=sys.modules[__name__],
        centre=(2.2, 1.8, 0.4),
        reach=(1.0, 1.0, math.pi),
    )


MODEL = Model(
    name='robotic_leg',
    parameters=Parameters,
    build=build,
    summary="the paper's robotic leg: radius, angle of the leg, angle of the body",
    reference='Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), section 5.2',
    identified=('foot_mass', 'body_inertia'),
)
