# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Two links in a vertical plane, a motor in each joint; q = (shoulder, elbow) [rad].

    M = [[a + b + 2 k cos q2, b + k cos q2], [b + k cos q2, b]]
    V = -ga cos q1 - gb cos(q1 + q2),   G = 1

The shoulder's angle is 0 when the upper link hangs, the elbow's when the arm is stretched. The
elbow's angle is relative to the upper link. The mechanism has no Psi (it is curved), so `geso`
cannot use it; `hgo`, `ehgo` and `smo` can.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from estimator_pkg.models.friction import STRIBECK, smooth_sign
from estimator_pkg.models.mechanics import TURN, Matrix, Mechanics, Model, Values, Vector
from estimator_pkg.models.mechanics import everywhere as admits  # noqa: F401
from estimator_pkg.models.mechanics import no_factors as factors  # noqa: F401
from estimator_pkg.parameters import structural


@dataclass(frozen=True)
class Parameters:
    """The parameters of two links; the defaults are about those of an arm of two 0.2 m links."""

    shoulder_inertia: float = structural(
        0.15,
        unit='kg m^2',
        range=(1e-9, 1e6),
        equation='a = I1 + m2 l1^2',
        description='inertia of the upper link about the shoulder, with the mass of the lower one '
        'at the elbow',
    )
    elbow_inertia: float = structural(
        0.04,
        unit='kg m^2',
        range=(1e-9, 1e6),
        equation='b = I2',
        description='inertia of the lower link about the elbow',
    )
    coupling: float = structural(
        0.04,
        unit='kg m^2',
        range=(0.0, 1e6),
        equation='k = m2 l1 r2',
        description='mass of the lower link times the length of the upper one and the distance of '
        'its own centre from the elbow',
    )
    shoulder_gravity: float = structural(
        2.5,
        unit='N m',
        range=(0.0, 1e6),
        equation='ga = g (m1 r1 + m2 l1)',
        description='largest torque of gravity on the shoulder by the upper link and the mass at '
        'its end',
    )
    elbow_gravity: float = structural(
        1.0,
        unit='N m',
        range=(0.0, 1e6),
        equation='gb = g m2 r2',
        description='largest torque of gravity on the elbow',
    )
    shoulder_damping: float = structural(
        0.01, unit='N m s/rad', range=(0.0, 1e6), description='viscous friction'
    )
    elbow_damping: float = structural(
        0.01, unit='N m s/rad', range=(0.0, 1e6), description='viscous friction'
    )
    shoulder_coulomb: float = structural(
        0.05, unit='N m', range=(0.0, 1e6), description='Coulomb friction'
    )
    elbow_coulomb: float = structural(
        0.05, unit='N m', range=(0.0, 1e6), description='Coulomb friction'
    )
    coulomb_speed: float = structural(
        STRIBECK,
        unit='rad/s',
        range=(1e-9, 100.0),
        advanced=True,
        description='width of the smoothed sign of the Coulomb friction, tanh(v / width)',
    )

    def __post_init__(self) -> None:
        """Check that M is positive definite at every angle; raise UsageError."""
        if self.shoulder_inertia * self.elbow_inertia <= self.coupling**2:
            raise UsageError(
                "model 'two_links': shoulder_inertia * elbow_inertia must be above coupling^2, but "
                f'{self.shoulder_inertia * self.elbow_inertia:g} <= {self.coupling**2:g}: the '
                'mass matrix is not positive definite'
            )


JOINTS, INPUTS = 2, 2
# values: a, b, k, ga, gb, damping of both, Coulomb friction of both, its width


def inertia(out: Matrix, values: Values, q: Vector) -> None:
    """Set M."""
    coupling = values[2] * math.cos(q[1])
    other = values[1] + coupling
    out[0][0] = values[0] + values[1] + 2.0 * coupling
    out[0][1] = out[1][0] = other
    out[1][1] = values[1]


def force(out: Vector, values: Values, q: Vector, v: Vector, u: Vector) -> None:
    """Set motors, gravity and Coulomb friction [N m]."""
    lower = values[4] * math.sin(q[0] + q[1])
    upper = values[3] * math.sin(q[0])
    out[0] = u[0] - upper - lower - values[7] * smooth_sign(v[0], values[9])
    out[1] = u[1] - lower - values[8] * smooth_sign(v[1], values[9])


def coriolis(out: Vector, values: Values, q: Vector, v: Vector) -> None:
    """Set C v."""
    h = values[2] * math.sin(q[1])
    out[0] = -h * v[1] * (2.0 * v[0] + v[1])
    out[1] = h * v[0] * v[0]


def damping(out: Matrix, values: Values, q: Vector) -> None:
    """Set D."""
    out[0][0], out[1][1] = values[5], values[6]
    out[0][1] = out[1][0] = 0.0


def build(parameters: Parameters) -> Mechanics:
    """The links with these numbers."""
    p = parameters
    return Mechanics(
        name='two_links',
        joints=('shoulder', 'elbow'),
        periods=(TURN, TURN),
        values=(
            p.shoulder_inertia,
            p.elbow_inertia,
            p.coupling,
            p.shoulder_gravity,
            p.elbow_gravity,
            p.shoulder_damping,
            p.elbow_damping,
            p.shoulder_coulomb,
            p.elbow_coulomb,
            p.coulomb_speed,
        ),
        actuated=(0, 1),
        model=sys.modules[__name__],
        linearisable=False,
        damped=True,
        centre=(0.0, 0.0),
        reach=(math.pi, math.pi),
        speed_matters=True,
    )


MODEL = Model(
    name='two_links',
    parameters=Parameters,
    build=build,
    summary='two links in a vertical plane with a motor in each joint, for hgo, ehgo and smo',
    identified=(
        'shoulder_inertia',
        'elbow_inertia',
        'coupling',
        'shoulder_gravity',
        'elbow_gravity',
        'shoulder_damping',
        'elbow_damping',
        'shoulder_coulomb',
        'elbow_coulomb',
    ),
)
