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
from estimator_pkg.models.mechanics import (
    POSITIVE,
    Array,
    Model,
    matrix,
    number,
    sign_width,
    smooth_sign,
    vector,
)


@dataclass(frozen=True)
class Parameters:
    """Two links; the defaults are about those of 0.2 m each. Arrays have shape (..., 2)."""

    joints = ('shoulder', 'elbow')
    reach = (np.pi, np.pi)

    shoulder_inertia: float = number(
        0.15,
        'kg m^2',
        'inertia of the upper link about the shoulder, with the mass of the lower one at the elbow',
        POSITIVE,
        equation='a = I1 + m2 l1^2',
    )
    elbow_inertia: float = number(
        0.04, 'kg m^2', 'inertia of the lower link about the elbow', POSITIVE, equation='b = I2'
    )
    coupling: float = number(
        0.04,
        'kg m^2',
        'mass of the lower link times the length of the upper one and the distance of its own '
        'centre from the elbow',
        equation='k = m2 l1 r2',
    )
    shoulder_gravity: float = number(
        2.5,
        'N m',
        'largest torque of gravity on the shoulder by the upper link and the mass at its end',
        equation='ga = g (m1 r1 + m2 l1)',
    )
    elbow_gravity: float = number(
        1.0, 'N m', 'largest torque of gravity on the elbow', equation='gb = g m2 r2'
    )
    shoulder_damping: float = number(0.01, 'N m s/rad', 'viscous friction')
    elbow_damping: float = number(0.01, 'N m s/rad', 'viscous friction')
    shoulder_coulomb: float = number(0.05, 'N m', 'Coulomb friction')
    elbow_coulomb: float = number(0.05, 'N m', 'Coulomb friction')
    coulomb_speed: float = sign_width(0.02, 'rad/s')

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

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return C v."""
        h, first, second = self.coupling * np.sin(q[..., 1]), v[..., 0], v[..., 1]
        return vector(-h * second * (2.0 * first + second), h * first * first)

    def gradient(self, q: Array) -> Array:
        """Return dV/dq [N m]."""
        lower = self.elbow_gravity * np.sin(q[..., 0] + q[..., 1])
        return vector(self.shoulder_gravity * np.sin(q[..., 0]) + lower, lower)

    def inputs(self, q: Array) -> Array:
        """Return G."""
        return np.eye(2)

    def damping(self, q: Array) -> Array:
        """Return D."""
        return np.diag((self.shoulder_damping, self.elbow_damping))

    def friction(self, v: Array) -> Array:
        """Return F: Coulomb friction [N m]."""
        levels = np.array((self.shoulder_coulomb, self.elbow_coulomb))
        return np.asarray(levels * smooth_sign(v, self.coulomb_speed))


MODEL = Model(
    name='two_links',
    parameters=Parameters,
    summary='two links in a vertical plane with a motor in each joint, for hgo, ehgo and smo',
    known=('coulomb_speed',),
)
