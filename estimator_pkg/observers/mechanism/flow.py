# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The exact step of a linear system over one sample."""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg.observers.maths.linear import Array, exponential


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
