# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Exact steps of linear systems over one sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

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


def companion(column: Sequence[float]) -> Array:
    """Return A with this first column and ones above the diagonal, shape (n, n).

    It is the observable canonical form, with C = [1 0 .. 0].
    """
    matrix = np.diag(np.ones(len(column) - 1), 1)
    matrix[:, 0] = column
    return matrix


@lru_cache(maxsize=16)  # all joints of a message have the same
def response(column: tuple[float, ...], pole: float, dt: float) -> tuple[Array, Array, Array]:
    """Return F = exp(A dt) and the responses of A's integral to a constant and to a ramp.

    These are G0 = int_0^dt exp(A s) ds and G1 = (1/dt) int_0^dt exp(A (dt - s)) s ds. So a filter
    x' = A x + w whose input goes from w to w + d in a sample takes the exact step
    F x + G0 w + G1 d. All have shape (n, n).

    Parameters
    ----------
    column : A is its `companion`. pole : size of A's eigenvalues [1/s].
    """
    n = len(column)
    scales = pole ** np.arange(n)  # with them A's entries are of similar size
    step = dt * companion(column) * scales / scales[:, None]
    whole = np.zeros((3 * n, 3 * n))
    whole[:n, :n] = step
    whole[:n, n : 2 * n], whole[n : 2 * n, 2 * n :] = dt * np.eye(n), np.eye(n)
    found = exponential(whole, step)[:n].reshape(n, 3, n).swapaxes(0, 1)
    F, G0, G1 = found * scales[:, None] / scales
    for each in (F, G0, G1):
        each.setflags(write=False)
    return F, G0, G1
