# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The exact step of a linear system over one sample."""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg.models.mechanics import Array

SMALL_NORM = 0.25  # of a matrix whose exponential is a series
LARGEST_NORM = 1e12  # of a matrix that has an exponential
NEGLIGIBLE = 1e-17  # the series ends before terms smaller than this


def exponential(matrix: Array, powers: Array) -> Array:
    """Return exp(matrix), shape (n, n), by scaling, Taylor series and squaring; nan if too large.

    Parameters
    ----------
    powers : the part of the matrix whose norm sets the scaling: all but columns whose rows are 0.
    """
    norm = float(np.abs(powers).sum(axis=1).max())
    if not norm < LARGEST_NORM:
        return np.full_like(matrix, np.nan)
    times = max(0, math.ceil(math.log2(max(norm, NEGLIGIBLE) / SMALL_NORM)))
    part, one = matrix / 2.0**times, np.eye(len(matrix))
    terms, size = 2, norm / 2.0**times
    while size**terms > NEGLIGIBLE * math.factorial(terms):
        terms += 1
    total = one + part / terms
    for k in range(terms - 1, 0, -1):
        total = one + part @ total / k
    for _ in range(times):
        total = total @ total
    return total


def balance(A: Array, n: int) -> Array:
    """Return scales of (e, x, d), shape (m,), with which the parts of A are of similar size."""
    of = np.linalg.norm
    e, x, d = slice(0, n), slice(n, 2 * n), slice(2 * n, None)
    first = math.sqrt(of(A[x, e]) / of(A[e, x]))
    if len(A) == 2 * n:
        return np.repeat([first, 1.0], n)
    return np.repeat([first, 1.0, math.sqrt(first * of(A[x, d]) / of(A[d, e]))], n)


def flow(A: Array, c: Array, z: Array, dt: float, scales: Array) -> Array:
    """Return z, shape (n,), after dt [s] of z' = A z + c.

    It is z + phi1(A dt) (A z + c) dt with phi1(w) = (exp(w) - 1)/w, whose product with a vector is
    the last column of an exponential. `scales` is the `balance` of A.
    """
    n = len(A)
    whole = np.zeros((n + 1, n + 1))
    powers = whole[:n, :n]
    np.multiply(dt * A, scales[:, None] / scales, out=powers)
    whole[:n, n] = dt * scales * (A @ z + c)
    after: Array = z + exponential(whole, powers)[:n, n] / scales
    return after
