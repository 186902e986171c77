# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A pendulum on a cart; q = (angle [rad], 0 upright; cart [m]), the input acts on the cart.

    M = [[J, B cos q1], [B cos q1, m]],  V = Gv cos q1,  G = [0, 1],  C v = [0, -B sin(q1) v1^2]

Section 5.1 of the paper uses it normalised (J = m = 1), section 6 with the parameters of a
laboratory set-up (equation (24); its potential is printed without g). Psi = calM is the lower
Cholesky factor of M^-1.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from estimator_pkg.models.friction import asymmetric
from estimator_pkg.models.mechanics import TURN, Matrix, Mechanics, Model, Values, Vector
from estimator_pkg.models.mechanics import everywhere as admits  # noqa: F401
from estimator_pkg.parameters import structural

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Parameters:
    """The parameters of a cart-pendulum; the defaults are those of section 6."""

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
    friction_forward: float = structural(
        0.0,
        unit='N',
        range=(0.0, 1e6),
        description='Coulomb friction of the cart moving forward (3.98 N in section 6)',
    )
    friction_backward: float = structural(
        0.0,
        unit='N',
        range=(0.0, 1e6),
        description='Coulomb friction of the cart moving backward (2.87 N in section 6)',
    )
    friction_speed: float = structural(
        0.0,
        unit='m/s',
        range=(0.0, 100.0),
        advanced=True,
        description='width of the smoothed sign of the friction, tanh(v / width); 0: a plain sign',
    )
    pendulum_damping: float = structural(
        0.0, unit='N m s/rad', range=(0.0, 1e6), description='viscous friction in the pivot'
    )
    cart_damping: float = structural(
        0.0, unit='N s/m', range=(0.0, 1e6), description='viscous friction of the cart'
    )

    def __post_init__(self) -> None:
        """Check that M is positive definite at every angle; raise UsageError."""
        if self.pendulum_inertia * self.moving_mass <= self.pendulum_moment**2:
            raise UsageError(
                "model 'cart_pendulum': pendulum_inertia * moving_mass must be above "
                f'pendulum_moment^2, but {self.pendulum_inertia * self.moving_mass:g} <= '
                f'{self.pendulum_moment**2:g}: the mass matrix is not positive definite'
            )


JOINTS, INPUTS = 2, 1
# values: J, B, m, Gv, force constant, friction forward and backward, its width, damping of both


def inertia(out: Matrix, values: Values, q: Vector) -> None:
    """Set M."""
    coupling = values[1] * math.cos(q[0])
    out[0][0] = values[0]
    out[0][1] = out[1][0] = coupling
    out[1][1] = values[2]


def factors(calm: Matrix, psi: Matrix, values: Values, q: Vector) -> None:
    """Set calM and Psi, which are the same here."""
    mass = values[2]
    coupling = values[1] * math.cos(q[0])
    rest = math.sqrt(mass / (values[0] * mass - coupling * coupling))
    calm[0][0] = psi[0][0] = rest
    calm[0][1] = psi[0][1] = 0.0
    calm[1][0] = psi[1][0] = -coupling * rest / mass
    calm[1][1] = psi[1][1] = math.sqrt(1.0 / mass)


def force(out: Vector, values: Values, q: Vector, v: Vector, u: Vector) -> None:
    """Set gravity on the pendulum [N m]; motor and Coulomb friction on the cart [N]."""
    on_cart = values[4] * u[0]
    if values[5] != 0.0 or values[6] != 0.0:
        on_cart -= asymmetric(v[1], values[5], values[6], values[7])
    out[0] = values[3] * math.sin(q[0])
    out[1] = on_cart


def coriolis(out: Vector, values: Values, q: Vector, v: Vector) -> None:
    """Set C v."""
    out[0] = 0.0
    out[1] = -values[1] * math.sin(q[0]) * v[0] * v[0]


def damping(out: Matrix, values: Values, q: Vector) -> None:
    """Set D."""
    out[0][0], out[1][1] = values[8], values[9]
    out[0][1] = out[1][0] = 0.0


def build(parameters: Parameters) -> Mechanics:
    """The cart-pendulum with these numbers."""
    p = parameters
    gravity = GRAVITY * p.pendulum_moment if p.gravity is None else p.gravity
    return Mechanics(
        name='cart_pendulum',
        joints=('pendulum', 'cart'),
        periods=(TURN, 0.0),
        values=(
            p.pendulum_inertia,
            p.pendulum_moment,
            p.moving_mass,
            gravity,
            p.force_constant,
            p.friction_forward,
            p.friction_backward,
            p.friction_speed,
            p.pendulum_damping,
            p.cart_damping,
        ),
        actuated=(1,),
        model=sys.modules[__name__],
        damped=p.pendulum_damping > 0.0 or p.cart_damping > 0.0,
        centre=(0.0, 0.0),
        reach=(math.pi, 1.0),
        speed_matters=p.friction_forward > 0.0 or p.friction_backward > 0.0,
    )


MODEL = Model(
    name='cart_pendulum',
    parameters=Parameters,
    build=build,
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
