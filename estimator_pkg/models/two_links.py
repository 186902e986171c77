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

from dataclasses import dataclass

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.models.friction import coulomb, sign_width, smooth_sign, viscous
from estimator_pkg.models.mechanics import Array, Model, matrix, vector
from estimator_pkg.parameters import structural


@dataclass(frozen=True)
class Parameters:
    """Two links; the defaults are about those of 0.2 m each. Arrays have shape (..., 2)."""

    joints = ('shoulder', 'elbow')
    reach = (np.pi, np.pi)
    dry = True

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
    shoulder_damping: float = viscous(0.01)
    elbow_damping: float = viscous(0.01)
    shoulder_coulomb: float = coulomb(0.05)
    elbow_coulomb: float = coulomb(0.05)
    coulomb_speed: float = sign_width()

    def __post_init__(self) -> None:
        """Check that M is positive definite at every angle; raise UsageError."""
        if self.shoulder_inertia * self.elbow_inertia <= self.coupling**2:
            raise UsageError(
                "model 'two_links': shoulder_inertia * elbow_inertia must be above coupling^2, but "
                f'{self.shoulder_inertia * self.elbow_inertia:g} <= {self.coupling**2:g}: the '
                'mass matrix is not positive definite'
            )

    def inertia(self, q: Array) -> Array:
        """Return M."""
        coupling = self.coupling * np.cos(q[..., 1])
        other = self.elbow_inertia + coupling
        whole = self.shoulder_inertia + self.elbow_inertia + 2.0 * coupling
        return matrix((whole, other), (other, self.elbow_inertia))

    def force(self, q: Array, v: Array, u: Array) -> Array:
        """Return motors, gravity and Coulomb friction [N m]."""
        lower = self.elbow_gravity * np.sin(q[..., 0] + q[..., 1])
        upper = self.shoulder_gravity * np.sin(q[..., 0])
        signs = smooth_sign(v, self.coulomb_speed)
        return vector(
            u[..., 0] - upper - lower - self.shoulder_coulomb * signs[..., 0],
            u[..., 1] - lower - self.elbow_coulomb * signs[..., 1],
        )

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return C v."""
        h, first, second = self.coupling * np.sin(q[..., 1]), v[..., 0], v[..., 1]
        return vector(-h * second * (2.0 * first + second), h * first * first)

    def damping(self, q: Array) -> Array:
        """Return D."""
        return np.diag((self.shoulder_damping, self.elbow_damping))


MODEL = Model(
    name='two_links',
    parameters=Parameters,
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
