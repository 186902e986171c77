# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The robotic leg of section 5.2; q = (r [m], th [rad], phi [rad]), u = (force, torque).

    M = diag(m1, m1 r^2, m2),  V = 0,  G = [[1, 0], [0, -1], [0, 1]]

Psi is the paper's own. It is singular at sin th = 0 (and r = 0), so the model must not be used
there. The first two momenta are kappa times the angular momentum plus p_y, and p_y: both
are conserved without input.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator_pkg.models.mechanics import POSITIVE, TURN, Array, Model, matrix, number, vector
from estimator_pkg.parameters import structural


@dataclass(frozen=True)
class Parameters:
    """The leg; the defaults are the paper's. Arrays have shape (..., 3)."""

    joints = ('r', 'th', 'phi')
    periods = (0.0, TURN, TURN)
    actuated = (0, 2)
    centre = (2.2, 1.8, 0.4)
    reach = (1.0, 1.0, np.pi)

    foot_mass: float = number(4.5, 'kg', 'mass at the end of the leg', POSITIVE, equation='m1')
    body_inertia: float = number(1.7, 'kg m^2', 'inertia of the body', POSITIVE, equation='m2')
    kappa: float = number(
        5.0, '1/m', 'constant of the paper in Psi; any value above 0 is admissible', POSITIVE
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

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return C v."""
        moment, turning = self.foot_mass * q[..., 0], v[..., 1]
        return vector(-moment * turning * turning, 2.0 * moment * v[..., 0] * turning, 0.0)

    def gradient(self, q: Array) -> Array:
        """Return dV/dq."""
        return np.zeros(3)

    def inputs(self, q: Array) -> Array:
        """Return G."""
        return np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])

    def psi(self, q: Array) -> Array:
        """Return Psi."""
        r, s, c = q[..., 0], np.sin(q[..., 1]), np.cos(q[..., 1])
        return matrix((s, s, 0.0), (c / r + self.kappa, c / r, 0.0), (0.0, 0.0, 1.0))

    def admits(self, q: Array) -> bool:
        """Return False near sin th = 0 and r = 0."""
        far = np.minimum(np.abs(np.sin(q[..., 1])), q[..., 0]) > self.margin
        return bool(np.all(far))


MODEL = Model(
    name='robotic_leg',
    parameters=Parameters,
    summary="the paper's robotic leg: radius, angle of the leg, angle of the body",
    reference='Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), section 5.2',
    known=('kappa', 'margin'),
)
