# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A single joint with its motor: inertia, friction, gravity, torque constant and gear ratio.

    J q'' = gear kt u - b q' - c sign(q') - g1 sin(q - q0) - bias

`u` is the effort in the topic: with the defaults the joint's torque [N m], with a torque constant
the motor's current [A]. Everything else is on the joint's side of the gear.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

from estimator_pkg.models.friction import STRIBECK, smooth_sign
from estimator_pkg.models.mechanics import TURN, Matrix, Mechanics, Model, Values, Vector
from estimator_pkg.models.mechanics import everywhere as admits  # noqa: F401
from estimator_pkg.parameters import structural


@dataclass(frozen=True)
class Parameters:
    """The parameters of a single joint."""

    inertia: float = structural(
        0.1,
        unit='kg m^2',
        range=(1e-9, 1e6),
        description='inertia about the axis, with motor and gear (for a slide: mass in kg)',
    )
    damping: float = structural(
        0.0, unit='N m s/rad', range=(0.0, 1e6), description='viscous friction'
    )
    coulomb: float = structural(0.0, unit='N m', range=(0.0, 1e6), description='Coulomb friction')
    coulomb_speed: float = structural(
        STRIBECK,
        unit='rad/s',
        range=(1e-9, 100.0),
        advanced=True,
        description='width of the smoothed sign of the Coulomb friction, tanh(v / width)',
    )
    gravity: float = structural(
        0.0,
        unit='N m',
        range=(-1e6, 1e6),
        description='largest torque of gravity: mass times g times lever arm; positive if the '
        'joint hangs at the angle `hanging`',
    )
    hanging: float = structural(
        0.0,
        unit='rad',
        range=(-10.0, 10.0),
        description='angle at which the joint hangs down and gravity exerts no torque',
    )
    bias: float = structural(
        0.0,
        unit='N m',
        range=(-1e6, 1e6),
        description='constant torque against the joint (offset of the torque sensor, a spring)',
    )
    torque_constant: float = structural(
        1.0,
        unit='N m/A',
        range=(-1e6, 1e6),
        description='torque of the motor per unit of the input; 1 if the input is the torque',
    )
    gear_ratio: float = structural(
        1.0,
        range=(-1e5, 1e5),
        description='turns of the motor per turn of the joint; 1 if the input is at the joint',
    )
    period: float = structural(
        TURN,
        unit='rad',
        range=(0.0, 1e6),
        description='period after which the reading repeats; 0 for a slide or a multi-turn encoder',
    )


JOINTS, INPUTS = 1, 1
# values: J, b, c, coulomb width, g1, hanging, bias, gear kt


def inertia(out: Matrix, values: Values, q: Vector) -> None:
    """Set M."""
    out[0][0] = values[0]


def factors(calm: Matrix, psi: Matrix, values: Values, q: Vector) -> None:
    """Set calM = 1/J and Psi = 1."""
    calm[0][0] = 1.0 / values[0]
    psi[0][0] = 1.0


def force(out: Vector, values: Values, q: Vector, v: Vector, u: Vector) -> None:
    """Set all torques except the viscous one [N m]."""
    out[0] = (
        values[7] * u[0]
        - values[4] * math.sin(q[0] - values[5])
        - values[6]
        - values[2] * smooth_sign(v[0], values[3])
    )


def coriolis(out: Vector, values: Values, q: Vector, v: Vector) -> None:
    """Set zero: a single joint has no Coriolis force."""
    out[0] = 0.0


def damping(out: Matrix, values: Values, q: Vector) -> None:
    """Set D."""
    out[0][0] = values[1]


def build(parameters: Parameters) -> Mechanics:
    """The joint with these numbers."""
    p = parameters
    return Mechanics(
        name='single_joint',
        joints=('joint',),
        periods=(p.period,),
        values=(
            p.inertia,
            p.damping,
            p.coulomb,
            p.coulomb_speed,
            p.gravity,
            p.hanging,
            p.bias,
            p.gear_ratio * p.torque_constant,
        ),
        actuated=(0,),
        model=sys.modules[__name__],
        damped=True,
        centre=(p.hanging,),
        reach=(math.pi,),
        speed_matters=p.coulomb > 0.0,
    )


MODEL = Model(
    name='single_joint',
    parameters=Parameters,
    build=build,
    summary='one joint with its motor: inertia, friction, gravity, torque constant, gear ratio',
    identified=('inertia', 'damping', 'coulomb', 'gravity', 'hanging', 'bias'),
)
