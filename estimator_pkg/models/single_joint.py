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

from estimator_pkg.models.mechanics import (
    POSITIVE,
    TURN,
    Array,
    Model,
    number,
    sign_width,
    smooth_sign,
)
from estimator_pkg.parameters import structural


@dataclass(frozen=True)
class Parameters:
    """The parameters of a single joint."""

    inertia: float = number(
        0.1,
        'kg m^2',
        'inertia about the axis, with motor and gear (for a slide: mass in kg)',
        POSITIVE,
    )
    damping: float = number(0.0, 'N m s/rad', 'viscous friction')
    coulomb: float = number(0.0, 'N m', 'Coulomb friction')
    coulomb_speed: float = sign_width(0.02, 'rad/s')
    gravity: float = number(
        0.0,
        'N m',
        'largest torque of gravity: mass times g times lever arm; positive if the joint hangs at '
        'the angle `hanging`',
        -1e6,
    )
    hanging: float = structural(
        0.0,
        unit='rad',
        range=(-10.0, 10.0),
        description='angle at which the joint hangs down and gravity exerts no torque',
    )
    bias: float = number(
        0.0,
        'N m',
        'constant torque against the joint (offset of the torque sensor, a spring)',
        -1e6,
    )
    torque_constant: float = number(
        1.0,
        'N m/A',
        'torque of the motor per unit of the input; 1 if the input is the torque',
        -1e6,
    )
    gear_ratio: float = structural(
        1.0,
        range=(-1e5, 1e5),
        description='turns of the motor per turn of the joint; 1 if the input is at the joint',
    )
    period: float = number(
        TURN, 'rad', 'period after which the reading repeats; 0 for a slide or a multi-turn encoder'
    )


class SingleJoint:
    """The joint with these numbers. Arrays have shape (..., 1)."""

    joints = ('joint',)
    reach = (np.pi,)

    def __init__(self, parameters: Parameters) -> None:
        self.numbers = parameters
        self.periods, self.centre = (parameters.period,), (parameters.hanging,)

    def inertia(self, q: Array) -> Array:
        """Return M."""
        return np.array([[self.numbers.inertia]])

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return zero: a single joint has no Coriolis force."""
        return np.zeros(1)

    def gradient(self, q: Array) -> Array:
        """Return the torques of gravity and of the bias [N m]."""
        p = self.numbers
        return np.asarray(p.gravity * np.sin(q - p.hanging) + p.bias)

    def inputs(self, q: Array) -> Array:
        """Return G."""
        return np.array([[self.numbers.gear_ratio * self.numbers.torque_constant]])

    def damping(self, q: Array) -> Array:
        """Return D."""
        return np.array([[self.numbers.damping]])

    def friction(self, v: Array) -> Array:
        """Return F: Coulomb friction [N m]."""
        return np.asarray(self.numbers.coulomb * smooth_sign(v, self.numbers.coulomb_speed))

    def psi(self, q: Array) -> Array:
        """Return Psi = 1."""
        return np.ones((1, 1))


MODEL = Model(
    name='single_joint',
    parameters=Parameters,
    form=SingleJoint,
    summary='one joint with its motor: inertia, friction, gravity, torque constant, gear ratio',
    known=('coulomb_speed', 'torque_constant', 'gear_ratio', 'period'),
)
