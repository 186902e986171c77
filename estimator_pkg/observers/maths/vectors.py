# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Small linear algebra on lists, for sizes that are the user's.

A vector is a list of floats, a matrix a list of rows. A symmetric matrix may be its lower triangle,
whose row i has i + 1 entries. Sums run from the first entry to the last, with no more digits than a
float has (`sum` of Python 3.12 has more).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Vector = Sequence[float]
Matrix = Sequence[Sequence[float]]


def dot(x: Vector, y: Vector) -> float:
    """Return x . y."""
    if len(x) == 2:  # the usual order, in a third of the time
        return x[0] * y[0] + x[1] * y[1]
    total = 0.0
    for a, b in zip(x, y):
        total += a * b
    return total


def transformed(matrix: Matrix, x: Vector) -> list[float]:
    """Return M x."""
    if len(x) == 2:
        a, b = x
        (m00, m01), (m10, m11) = matrix
        return [m00 * a + m01 * b, m10 * a + m11 * b]
    return [dot(row, x) for row in matrix]


def multiply(matrix: Matrix, x: Vector) -> tuple[list[float], float]:
    """Return M x and x' M x."""
    found, total = [], 0.0
    for a, row in zip(x, matrix):
        along = 0.0
        for b, c in zip(row, x):
            along += b * c
        found.append(along)
        total += a * along
    return found, total


def quadratic(matrix: Matrix, x: Vector) -> float:
    """Return x' M x."""
    if len(x) == 2:
        return dot(x, transformed(matrix, x))
    total = 0.0
    for a, row in zip(x, matrix):
        total += a * dot(row, x)
    return total


def add_square(matrix: list[list[float]], keep: float, scale: float, x: Vector) -> None:
    """Set M to keep M + scale x x' in place."""
    size = range(len(x))
    for i in size:
        row, part = matrix[i], scale * x[i]
        for j in size:
            row[j] = keep * row[j] + part * x[j]


def exceeds(lower: Matrix, keep: float, scale: float, floor: Matrix) -> bool:
    """Return True if M - scale floor is positive definite, M's diagonal multiplied by `keep`.

    M is a lower triangle. It is true where the factors of Cholesky exist.
    """
    factors: list[list[float]] = []
    for i, (row, least) in enumerate(zip(lower, floor)):
        own: list[float] = []
        for j in range(i + 1):
            left = (keep * row[j] if i == j else row[j]) - scale * least[j]
            for a, b in zip(own, own if i == j else factors[j]):
                left -= a * b
            if i > j:
                left /= factors[j][j]
            elif left > 0.0:
                left = math.sqrt(left)
            else:
                return False
            own.append(left)
        factors.append(own)
    return True


def empty(size: int) -> list[list[float]]:
    """Return the lower triangle of zeros."""
    return [[0.0] * (i + 1) for i in range(size)]


def whole(lower: Matrix) -> NDArray[np.float64]:
    """Return the symmetric matrix of a lower triangle, shape (n, n)."""
    size = range(len(lower))
    return np.array([[lower[max(i, j)][min(i, j)] for j in size] for i in size])
