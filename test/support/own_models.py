# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Models of mechanisms as a user writes them, outside the package: right ones and wrong ones."""

import numpy as np


class CartPendulum:
    """The normalised cart-pendulum with b = 0.5, in numpy; no Psi, no Coriolis forces."""

    joints = ('pendulum', 'cart')
    periods = (2.0 * np.pi, 0.0)
    reach = (np.pi, 1.0)
    actuated = (1,)
    b = 0.5

    def inertia(self, q):
        coupling = self.b * np.cos(q[0])
        return np.array([[1.0, coupling], [coupling, 1.0]])

    def gradient(self, q):
        return np.array([-np.sin(q[0]), 0.0])

    def inputs(self, q):
        return np.array([[0.0], [1.0]])


class TwoLinks:
    """A planar arm of two links: curved, so that there is no Psi."""

    joints = ('shoulder', 'elbow')
    reach = (np.pi, np.pi)

    def inertia(self, q):
        c = np.cos(q[1])
        return np.array([[3.0 + 2.0 * c, 1.0 + c], [1.0 + c, 1.0]])

    def gradient(self, q):
        return np.zeros(2)

    def inputs(self, q):
        return np.eye(2)


def varied(base=CartPendulum, **wrong):
    """A model that differs from another in these attributes."""
    return type('Varied', (base,), wrong)


def cholesky(model, q):
    """A Psi that linearises the cart-pendulum."""
    return np.linalg.cholesky(np.linalg.inv(model.inertia(q)))


def out_of_the_table(model, q):
    """M(q), which is checked near the upright pendulum alone."""
    if abs(q[0]) > 1.5:
        raise ValueError('out of the table')
    return CartPendulum.inertia(model, q)


class Incomplete:
    """Gives no mass matrix."""

    joints = ('a',)


WrongPsi = varied(TwoLinks, psi=cholesky)
WrongCoriolis = varied(
    coriolis=lambda model, q, v: np.array([0.0, model.b * np.sin(q[0]) * v[0] ** 2])
)
Singular = varied(b=1.3)  # where the pendulum is upright
Lopsided = varied(inertia=lambda model, q: np.array([[1.0, 0.2], [0.0, 1.0]]))
WrongSize = varied(inputs=lambda model, q: np.eye(3))
FailsLater = varied(reach=(1.0, 1.0), inertia=out_of_the_table)
Driving = varied(damping=lambda model, q: np.diag([0.1, -0.2]))
NoReach = varied(reach=(1.0, 0.0))
OneName = varied(joints='pendulum')


class SixJoints:
    """Six joints that do not turn each other."""

    joints = ('a', 'b', 'c', 'd', 'e', 'f')

    def inertia(self, q):
        return np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])

    def gradient(self, q):
        return np.zeros(6)

    def inputs(self, q):
        return np.eye(6)
