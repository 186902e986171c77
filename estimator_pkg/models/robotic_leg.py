# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The robotic leg of section 5.2; q = (r [m], th [rad], phi [rad]), u = (force, torque).

    M = diag(m1, m1 r^2, m2),  V = 0,  G = [[1, 0], [0, -1], [0, 1]]

Psi and calM are the paper's own. They are singular at sin th = 0 (and r = 0), so the model must not
be used there. The first two momenta are kappa times the angular momentum plus p_y, and p_y: both
are conserved without input.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator_pkg.models.mechanics import TURN, Array, Model, matrix, vector
from estimator_pkg.parameters import structural


@dataclass(frozen=True)
class Parameters:
    """The leg; the defaults are the paper's. Arrays have shape (..., 3)."""

    joints = ('r', 'th', 'phi')
    periods = (0.0, TURN, TURN)
    actuated = (0, 2)
    centre = (2.2, 1.8, 0.4)
    reach = (1.0, 1.0, np.pi)

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

    def inertia(self, q: Array) -> Array:
        """Return M."""
        turning = self.foot_mass * q[..., 0] * q[..., 0]
        return matrix(
            (self.foot_mass, 0.0, 0.0), (0.0, turning, 0.0), (0.0, 0.0, self.body_inertia)
        )

    def factors(self, q: Array) -> tuple[Array, Array]:
        """Return calM and Psi."""
        r, s, c = q[..., 0], np.sin(q[..., 1]), np.cos(q[..., 1])
        kappa, km = self.kappa, self.kappa * self.foot_mass
        turning = 1.0 / (km * r * r)
        calm = matrix(
            (-c / (s * km * r), (c + kappa * r) / (km * s * r), 0.0),
            (turning, -turning, 0.0),
            (0.0, 0.0, 1.0 / self.body_inertia),
        )
        return calm, matrix((s, s, 0.0), (c / r + kappa, c / r, 0.0), (0.0, 0.0, 1.0))

    def force(self, q: Array, v: Array, u: Array) -> Array:
        """Return G u."""
        return vector(u[..., 0], -u[..., 1], u[..., 1])

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return C v."""
        moment, turning = self.foot_mass * q[..., 0], v[..., 1]
        return vector(-moment * turning * turning, 2.0 * moment * v[..., 0] * turning, 0.0)

    def admits(self, q: Array) -> bool:
        """Return False near sin th = 0 and r = 0."""
        far = np.minimum(np.abs(np.sin(q[..., 1])), q[..., 0]) > self.margin
        return bool(np.all(far))


MODEL = Model(
    name='robotic_leg',
    parameters=Parameters,
    summary="the paper's robotic leg: radius, angle of the leg, angle of the body",
    reference='Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), section 5.2',
    identified=('foot_mass', 'body_inertia'),
)
