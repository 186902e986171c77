"""What white measurement noise does to an observer of a mechanism, about one configuration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def exponential(matrix: Array) -> Array:
    """exp(matrix) by scaling, Taylor and squaring (small matrices)."""
    size = float(np.max(np.sum(np.abs(matrix), axis=1)))
    times = max(0, int(np.ceil(np.log2(max(size, 1e-300)))) + 2)
    part = matrix / 2.0 ** times
    term = total = np.eye(len(matrix))
    for k in range(1, 20):
        term = term @ part / k
        total = total + term
    for _ in range(times):
        total = total @ total
    return total


def discrete(matrix: Array, n: int, dt: float, *, euler: bool, linear_hold: bool
             ) -> tuple[Array, Array]:
    """(Phi, W) of the error over one sample: z+ = Phi z + W (y_k - y_{k-1}).

    Parameters
    ----------
    matrix : A of (e, x, d)' = A (e, x, d), with e' containing -rate of the measurement.
    """
    size = len(matrix)
    arrival = np.zeros((size, n))
    arrival[:n] = -np.eye(n)
    if euler:
        return np.eye(size) + dt * matrix, arrival
    if not linear_hold:
        return exponential(matrix * dt), arrival
    block = np.zeros((size + n, size + n))
    block[:size, :size] = matrix
    block[:size, size:] = arrival / dt
    whole = exponential(block * dt)
    return whole[:size, :size], whole[:size, size:]


def noise_gains(matrix: Array, shown: Array, n: int, dt: float, *, euler: bool, linear_hold: bool
                ) -> tuple[Array, Array, Array]:
    """Variances per variance of the noise of each position, in steady state.

    Returns
    -------
    of the estimated position, of the velocity, of e = estimate minus measurement; each (n, n):
    row what, column whose noise. Infinite where the observer is unstable.
    """
    step, arrival = discrete(matrix, n, dt, euler=euler, linear_hold=linear_hold)
    size = len(matrix)
    # the noise of the sample before is a state: z+ = Phi z + W (n_k - n_{k-1})
    transition = np.zeros((size + n, size + n))
    transition[:size, :size], transition[:size, size:] = step, -arrival
    entering = np.vstack([arrival, np.eye(n)])
    gains = np.full((3, n, n), np.inf)
    # e and the measurement's own level drift together where the mechanism is at rest; the error of
    # the estimate is e + n_k, so what matters is bounded when Phi is
    if max(abs(np.linalg.eigvals(step))) >= 1.0:
        return gains[0], gains[1], gains[2]
    inward = np.hstack([np.eye(n), np.zeros((n, size - n)), np.eye(n)])
    velocity = np.hstack([np.zeros((n, n)), shown, np.zeros((n, size - n - shown.shape[1])),
                          np.zeros((n, n))])
    offset = np.hstack([np.eye(n), np.zeros((n, size))])
    for joint in range(n):
        column = entering[:, joint:joint + 1]
        covariance, power = column @ column.T, transition
        for _ in range(60):
            added = power @ covariance @ power.T
            covariance = covariance + added
            if np.max(np.abs(added)) <= 1e-14 * np.max(np.abs(covariance)):
                break
            power = power @ power
        for kind, rows in enumerate((inward, velocity, offset)):
            gains[kind, :, joint] = np.einsum('ij,jk,ik->i', rows, covariance, rows)
    return gains[0], gains[1], gains[2]
