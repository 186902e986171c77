# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A single joint with its motor: inertia, friction, gravity, torque constant and gear ratio.

    J q'' = gear kt u - b q' - c sign(q') - g1 sin(q - q0) - bias

`u` is the effort in the topic: with the defaults the joint's torque [N m], with a torque constant
the motor's current [A]. Everything else is on the joint's side of the gear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator_pkg.models.friction import coulomb, sign_width, smooth_sign, viscous
from estimator_pkg.models.mechanics import TURN, Array, Model, matrix
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
    damping: float = viscous()
    coulomb: float = coulomb()
    coulomb_speed: float = sign_width()
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


class SingleJoint:
    """The joint with these numbers. Arrays have shape (..., 1)."""

    joints = ('joint',)
    reach = (np.pi,)

    def __init__(self, parameters: Parameters) -> None:
        self.numbers = parameters
        self.periods, self.centre = (parameters.period,), (parameters.hanging,)
        self.dry = parameters.coulomb > 0.0

    def inertia(self, q: Array) -> Array:
        """Return M."""
        return np.array([[self.numbers.inertia]])

    def factors(self, q: Array) -> tuple[Array, Array]:
        """Return calM = 1/J and Psi = 1."""
        one = matrix((np.ones(q.shape[:-1]),))
        return one / self.numbers.inertia, one

    def force(self, q: Array, v: Array, u: Array) -> Array:
        """Return all torques except the viscous one [N m]."""
        p = self.numbers
        return (
            p.gear_ratio * p.torque_constant * u
            - p.gravity * np.sin(q - p.hanging)
            - p.bias
            - p.coulomb * smooth_sign(v, p.coulomb_speed)
        )

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return zero: a single joint has no Coriolis force."""
        return np.zeros(1)

    def damping(self, q: Array) -> Array:
        """Return D."""
        return np.array([[self.numbers.damping]])


MODEL = Model(
    name='single_joint',
    parameters=Parameters,
    form=SingleJoint,
    summary='one joint with its motor: inertia, friction, gravity, torque constant, gear ratio',
    identified=('inertia', 'damping', 'coulomb', 'gravity', 'hanging', 'bias'),
)
