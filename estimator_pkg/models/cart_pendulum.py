# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A pendulum on a cart; q = (angle [rad], 0 upright; cart [m]), the input acts on the cart.

    M = [[J, B cos q1], [B cos q1, m]],  V = Gv cos q1,  G = [0, 1],  C v = [0, -B sin(q1) v1^2]

Section 5.1 of the paper uses it normalised (J = m = 1), section 6 with the parameters of a
laboratory set-up (equation (24); its potential is printed without g). Psi is the lower Cholesky
factor of M^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.models.mechanics import (
    POSITIVE,
    TURN,
    Array,
    Model,
    matrix,
    number,
    sign_width,
    smooth_sign,
    vector,
)

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Parameters:
    """A cart-pendulum; the defaults are those of section 6. Arrays have shape (..., 2)."""

    joints = ('pendulum', 'cart')
    periods = (TURN, 0.0)
    actuated = (1,)
    reach = (np.pi, 1.0)

    pendulum_inertia: float = number(
        0.0484, 'kg m^2', 'inertia of the pendulum about its pivot', POSITIVE, equation='J = J_f'
    )
    pendulum_moment: float = number(
        0.105,
        'kg m',
        'mass of the pendulum times the distance of its centre from the pivot',
        equation='B = l_m m_p',
    )
    moving_mass: float = number(
        1.15, 'kg', 'mass of cart and pendulum', POSITIVE, equation='m = M_c + m_p'
    )
    gravity: float | None = number(
        None,
        'N m',
        'largest torque of gravity on the pendulum; automatic: 9.81 m/s^2 times the moment',
        equation='Gv = g l_m m_p',
    )
    force_constant: float = number(
        1.0,
        'N/A',
        'force on the cart per unit of the input (9.27 N/A in section 6); 1 if the input is the '
        'force',
        -1e6,
    )
    friction_forward: float = number(
        0.0, 'N', 'Coulomb friction of the cart moving forward (3.98 N in section 6)'
    )
    friction_backward: float = number(
        0.0, 'N', 'Coulomb friction of the cart moving backward (2.87 N in section 6)'
    )
    friction_speed: float = sign_width(0.0, 'm/s')
    pendulum_damping: float = number(0.0, 'N m s/rad', 'viscous friction in the pivot')
    cart_damping: float = number(0.0, 'N s/m', 'viscous friction of the cart')

    def __post_init__(self) -> None:
        """Check that M is positive definite at every angle; raise UsageError."""
        if self.pendulum_inertia * self.moving_mass <= self.pendulum_moment**2:
            raise UsageError(
                "model 'cart_pendulum': pendulum_inertia * moving_mass must be above "
                f'pendulum_moment^2, but {self.pendulum_inertia * self.moving_mass:g} <= '
                f'{self.pendulum_moment**2:g}: the mass matrix is not positive definite'
            )

    def inertia(self, q: Array) -> Array:
        """Return M."""
        coupling = self.pendulum_moment * np.cos(q[..., 0])
        return matrix((self.pendulum_inertia, coupling), (coupling, self.moving_mass))

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return C v."""
        return vector(0.0, -self.pendulum_moment * np.sin(q[..., 0]) * v[..., 0] ** 2)

    def gradient(self, q: Array) -> Array:
        """Return dV/dq [N m, N]."""
        largest = GRAVITY * self.pendulum_moment if self.gravity is None else self.gravity
        return vector(-largest * np.sin(q[..., 0]), 0.0)

    def inputs(self, q: Array) -> Array:
        """Return G."""
        return np.array([[0.0], [self.force_constant]])

    def damping(self, q: Array) -> Array:
        """Return D."""
        return np.diag((self.pendulum_damping, self.cart_damping))

    def friction(self, v: Array) -> Array:
        """Return F: Coulomb friction of the cart, with a level per direction [N]."""
        speed = v[..., 1]
        level = np.where(speed >= 0.0, self.friction_forward, self.friction_backward)
        return vector(0.0, level * smooth_sign(speed, self.friction_speed))


MODEL = Model(
    name='cart_pendulum',
    parameters=Parameters,
    summary='a pendulum on a driven cart, with asymmetric friction',
    reference='Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), sections 5.1 and 6, equation (24)',
    known=('gravity', 'force_constant', 'friction_speed'),
)
