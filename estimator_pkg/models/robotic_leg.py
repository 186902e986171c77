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
from dataclasses import dataclass

from estimator_pkg.models.mechanics import TURN, Matrix, Mechanics, Model, Vector
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


# values: m1, m2, kappa, margin


def inertia(values: Vector, q: Vector) -> Matrix:
    """M."""
    return ((values[0], 0.0, 0.0), (0.0, values[0] * q[0] * q[0], 0.0), (0.0, 0.0, values[1]))


def factors(values: Vector, q: Vector) -> tuple[Matrix, Matrix]:
    """calM and Psi."""
    r = q[0]
    s, c = math.sin(q[1]), math.cos(q[1])
    kappa = values[2]
    km = kappa * values[0]
    turning = 1.0 / (km * r * r)
    return (
        (
            (-c / (s * km * r), (c + kappa * r) / (km * s * r), 0.0),
            (turning, -turning, 0.0),
            (0.0, 0.0, 1.0 / values[1]),
        ),
        ((s, s, 0.0), (c / r + kappa, c / r, 0.0), (0.0, 0.0, 1.0)),
    )


def force(values: Vector, q: Vector, v: Vector, u: Vector) -> Vector:
    """G u."""
    return (u[0], -u[1], u[1])


def coriolis(values: Vector, q: Vector, v: Vector) -> Vector:
    """C v."""
    m1r = values[0] * q[0]
    return (-m1r * v[1] * v[1], 2.0 * m1r * v[0] * v[1], 0.0)


def admits(values: Vector, q: Vector) -> bool:
    """False near sin th = 0 and r = 0."""
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
        inertia=inertia,
        factors=factors,
        force=force,
        coriolis=coriolis,
        damping=None,
        admits=admits,
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
