# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What follows from gains and models alone (rows A)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.models import cart_pendulum
from estimator_pkg.observers.mechanism import gains as mechanical_gains
from sim_pkg.reproduce.contract import Values

Array = NDArray[np.float64]

RATE = 224.0  # Hz, of the laboratory
UPRIGHT, HANGING = np.zeros(2), np.array([math.pi, 0.0])
LQR = (104.0, 21.0, 20.0, 23.0)  # N per rad, m, rad/s, m/s
L5 = np.array([[-0.5, 2.0], [-2.0, 1.0]])  # counterexample to Remark 5 as printed
CALM5 = np.diag([10.0, 1.0])


def radius(matrix: Array, dt: float) -> float:
    """Return the spectral radius of forward Euler, at dt [s], of x' = matrix x, shape (n, n)."""
    return float(max(abs(np.linalg.eigvals(np.eye(len(matrix)) + dt * matrix))))


def of_channel(*gains: float) -> Array:
    """Return A of the error of one channel: e' = x - g1 e, x' = s - g2 e, ...; shape (n, n).

    The n gains are in 1/s, 1/s^2, ...
    """
    size = len(gains)
    matrix = np.zeros((size, size))
    matrix[:, 0] = [-gain for gain in gains]
    matrix[range(size - 1), range(1, size)] = 1.0
    return matrix


def with_lqr(sign: float) -> Array:
    """Return A of the upright cart-pendulum under u = sign * (104 q1 + 21 q2 + 20 v1 + 23 v2) [N].

    Its shape is (4, 4): (q1, q2, v1, v2)' = A (q1, q2, v1, v2), in rad and m.
    """
    mechanics = cart_pendulum.build(cart_pendulum.Parameters())
    step = 1e-6

    def force(q: Array) -> Array:
        return mechanics.force(q, (0.0, 0.0), (0.0,))

    stiffness = np.array(
        [(force(step * row) - force(-step * row)) / (2.0 * step) for row in np.eye(2)]
    ).T
    back = np.linalg.inv(mechanics.inertia(UPRIGHT))
    matrix = np.zeros((4, 4))
    matrix[:2, 2:] = np.eye(2)
    matrix[2:, :2] = back @ stiffness
    matrix[2:] += sign * np.outer(back[:, 1], LQR)
    return matrix


def remark_5(weight: Array) -> float:
    """Return the largest real part of the error's poles with the injection Gamma calM^T weight e.

    `weight` has shape (2, 2); Gamma is 1, the result in 1/s.
    """
    matrix = np.block([[-L5, CALM5], [-CALM5.T @ weight, np.zeros((2, 2))]])
    return -mechanical_gains.slowest_pole(matrix)


def values() -> Values:
    """Rows A."""
    lab = cart_pendulum.build(cart_pendulum.Parameters())
    k1 = 400.0 * lab.factors(HANGING)[1][0, 0] ** 2
    yield 'A6', k1
    yield 'A7', radius(of_channel(50.0, k1), 1.0 / RATE)
    yield 'A8', radius(of_channel(50.0, k1), 2.0 / RATE)
    yield 'A12', -mechanical_gains.slowest_pole(with_lqr(-1.0))
    yield 'A13', -mechanical_gains.slowest_pole(with_lqr(1.0))
    yield 'A14', remark_5(np.eye(2))
    yield 'A15', remark_5(mechanical_gains.lyapunov_weight(L5))
