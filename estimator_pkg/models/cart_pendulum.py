# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A pendulum on a cart; q = (angle [rad], 0 upright; cart [m]), the input acts on the cart.

    M = [[J, B cos q1], [B cos q1, m]],  V = Gv cos q1,  G = [0, 1],  C v = [0, -B sin(q1) v1^2]

Section 5.1 of the paper uses it normalised (J = m = 1), section 6 with the parameters of a
laboratory set-up (equation (24); its potential is printed without g). Psi = calM is the lower
Cholesky factor of M^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.models.friction import asymmetric, coulomb, viscous
from estimator_pkg.models.mechanics import TURN, Array, Model, matrix, vector
from estimator_pkg.parameters import structural

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Parameters:
    """A cart-pendulum; the defaults are those of section 6. Arrays have shape (..., 2)."""

    joints = ('pendulum', 'cart')
    periods = (TURN, 0.0)
    actuated = (1,)
    reach = (np.pi, 1.0)

    pendulum_inertia: float = structural(
        0.0484,
        unit='kg m^2',
        range=(1e-9, 1e6),
        equation='J = J_f',
        description='inertia of the pendulum about its pivot',
    )
    pendulum_moment: float = structural(
        0.105,
        unit='kg m',
        range=(0.0, 1e6),
        equation='B = l_m m_p',
        description='mass of the pendulum times the distance of its centre from the pivot',
    )
    moving_mass: float = structural(
        1.15,
        unit='kg',
        range=(1e-9, 1e6),
        equation='m = M_c + m_p',
        description='mass of cart and pendulum',
    )
    gravity: float | None = structural(
        None,
        unit='N m',
        range=(0.0, 1e7),
        equation='Gv = g l_m m_p',
        description='largest torque of gravity on the pendulum; automatic: 9.81 m/s^2 times '
        'the moment',
    )
    force_constant: float = structural(
        1.0,
        unit='N/A',
        range=(-1e6, 1e6),
        description='force on the cart per unit of the input (9.27 N/A in section 6); 1 if the '
        'input is the force',
    )
    friction_forward: float = coulomb(
        of='Coulomb friction of the cart moving forward (3.98 N in section 6)', unit='N'
    )
    friction_backward: float = coulomb(
        of='Coulomb friction of the cart moving backward (2.87 N in section 6)', unit='N'
    )
    friction_speed: float = structural(
        0.0,
        unit='m/s',
        range=(0.0, 100.0),
        advanced=True,
        description='width of the smoothed sign of the friction, tanh(v / width); 0: a plain sign',
    )
    pendulum_damping: float = viscous(of=' in the pivot')
    cart_damping: float = viscous(of=' of the cart', unit='N s/m')

    def __post_init__(self) -> None:
        """Check that M is positive definite at every angle; raise UsageError."""
        if self.pendulum_inertia * self.moving_mass <= self.pendulum_moment**2:
            raise UsageError(
                "model 'cart_pendulum': pendulum_inertia * moving_mass must be above "
                f'pendulum_moment^2, but {self.pendulum_inertia * self.moving_mass:g} <= '
                f'{self.pendulum_moment**2:g}: the mass matrix is not positive definite'
            )

    @property
    def damped(self) -> bool:
        """True if D is not zero."""
        return self.pendulum_damping > 0.0 or self.cart_damping > 0.0

    @property
    def dry(self) -> bool:
        """True if the cart has Coulomb friction."""
        return self.friction_forward > 0.0 or self.friction_backward > 0.0

    def inertia(self, q: Array) -> Array:
        """Return M."""
        coupling = self.pendulum_moment * np.cos(q[..., 0])
        return matrix((self.pendulum_inertia, coupling), (coupling, self.moving_mass))

    def factors(self, q: Array) -> tuple[Array, Array]:
        """Return calM and Psi, which are the same here."""
        mass, coupling = self.moving_mass, self.pendulum_moment * np.cos(q[..., 0])
        rest = np.sqrt(mass / (self.pendulum_inertia * mass - coupling * coupling))
        psi = matrix((rest, 0.0), (-coupling * rest / mass, np.sqrt(1.0 / mass)))
        return psi, psi

    def force(self, q: Array, v: Array, u: Array) -> Array:
        """Return gravity on the pendulum [N m]; motor and Coulomb friction on the cart [N]."""
        largest = GRAVITY * self.pendulum_moment if self.gravity is None else self.gravity
        on_cart = self.force_constant * u[..., 0]
        if self.dry:
            levels = self.friction_forward, self.friction_backward
            on_cart = on_cart - asymmetric(v[..., 1], *levels, self.friction_speed)
        return vector(largest * np.sin(q[..., 0]), on_cart)

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return C v."""
        turning = v[..., 0]
        return vector(0.0, -self.pendulum_moment * np.sin(q[..., 0]) * turning * turning)

    def damping(self, q: Array) -> Array:
        """Return D."""
        return np.diag((self.pendulum_damping, self.cart_damping))


MODEL = Model(
    name='cart_pendulum',
    parameters=Parameters,
    summary='a pendulum on a driven cart, with asymmetric friction',
    reference='Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), sections 5.1 and 6, equation (24)',
    identified=(
        'pendulum_inertia',
        'pendulum_moment',
        'moving_mass',
        'friction_forward',
        'friction_backward',
        'pendulum_damping',
        'cart_damping',
    ),
)
