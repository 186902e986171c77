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
        """M(q)."""
        coupling = self.b * np.cos(q[0])
        return np.array([[1.0, coupling], [coupling, 1.0]])

    def gradient(self, q):
        """dV/dq."""
        return np.array([-np.sin(q[0]), 0.0])

    def inputs(self, q):
        """G(q)."""
        return np.array([[0.0], [1.0]])


class TwoLinks:
    """A planar arm of two links: curved, so that there is no Psi."""

    joints = ('shoulder', 'elbow')
    reach = (np.pi, np.pi)

    def inertia(self, q):
        """M(q)."""
        c = np.cos(q[1])
        return np.array([[3.0 + 2.0 * c, 1.0 + c], [1.0 + c, 1.0]])

    def gradient(self, q):
        """dV/dq."""
        return np.zeros(2)

    def inputs(self, q):
        """G(q)."""
        return np.eye(2)


class WrongPsi(TwoLinks):
    """Claims a Psi that does not linearise."""

    def psi(self, q):
        """Psi(q)."""
        return np.linalg.cholesky(np.linalg.inv(self.inertia(q)))


class WrongCoriolis(CartPendulum):
    """Coriolis forces of the wrong sign."""

    def coriolis(self, q, v):
        """C v, wrong."""
        return np.array([0.0, self.b * np.sin(q[0]) * v[0] ** 2])


class Singular(CartPendulum):
    """M is singular where the pendulum is upright."""

    b = 1.3


class Lopsided(CartPendulum):
    """M is not symmetric."""

    def inertia(self, q):
        """M(q), wrong."""
        return np.array([[1.0, 0.2], [0.0, 1.0]])


class WrongSize(CartPendulum):
    """G of the wrong size."""

    def inputs(self, q):
        """G(q), wrong."""
        return np.eye(3)


class Incomplete:
    """Gives no mass matrix."""

    joints = ('a',)


class FailsLater(CartPendulum):
    """Raises where the pendulum is far from upright, beyond the region in which it is checked."""

    reach = (1.0, 1.0)

    def inertia(self, q):
        """M(q)."""
        if abs(q[0]) > 1.5:
            raise ValueError('out of the table')
        return super().inertia(q)


class Driving(CartPendulum):
    """Friction that drives."""

    def damping(self, q):
        """D(q), wrong."""
        return np.diag([0.1, -0.2])


class NoReach(CartPendulum):
    """No region to be checked in."""

    reach = (1.0, 0.0)


class OneName(CartPendulum):
    """A text for a list of names."""

    joints = 'pendulum'


class SixJoints:
    """Six joints that do not turn each other."""

    joints = ('a', 'b', 'c', 'd', 'e', 'f')

    def inertia(self, q):
        """M(q)."""
        return np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])

    def gradient(self, q):
        """dV/dq."""
        return np.zeros(6)

    def inputs(self, q):
        """G(q)."""
        return np.eye(6)
