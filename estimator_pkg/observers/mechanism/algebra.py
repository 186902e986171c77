# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Algebra of small vectors and matrices, for observers of mechanisms.

The functions set their first argument. Without an engine a loop over one or two numbers costs more
than their arithmetic, so what each step needs is written out for one position.
"""

from __future__ import annotations

import math

from estimator_pkg.circle import LARGEST
from estimator_pkg.models.mechanics import Matrix, Vector


def apply(out: Vector, n: int, a: Matrix, x: Vector) -> None:
    """Set A x."""
    for i in range(n):
        row = a[i]
        total = row[0] * x[0]
        for k in range(1, n):
            total += row[k] * x[k]
        out[i] = total


def turn(out: Vector, n: int, a: Matrix, x: Vector) -> None:
    """Set A^T x."""
    for i in range(n):
        total = a[0][i] * x[0]
        for k in range(1, n):
            total += a[k][i] * x[k]
        out[i] = total


def multiply(out: Matrix, n: int, a: Matrix, b: Matrix) -> None:
    """Set A B."""
    for i in range(n):
        for j in range(n):
            total = a[i][0] * b[0][j]
            for k in range(1, n):
                total += a[i][k] * b[k][j]
            out[i][j] = total


def multiply_turned(out: Matrix, n: int, a: Matrix, b: Matrix) -> None:
    """Set A B^T."""
    for i in range(n):
        for j in range(n):
            total = a[i][0] * b[j][0]
            for k in range(1, n):
                total += a[i][k] * b[j][k]
            out[i][j] = total


def turned_multiply(out: Matrix, n: int, a: Matrix, b: Matrix) -> None:
    """Set A^T B."""
    for i in range(n):
        for j in range(n):
            total = a[0][i] * b[0][j]
            for k in range(1, n):
                total += a[k][i] * b[k][j]
            out[i][j] = total


def is_finite(n: int, x: Vector) -> bool:
    """Return True if all |x_i| are below `LARGEST`."""
    for i in range(n):  # noqa: SIM110  (the engine has no `all`)
        if not -LARGEST < x[i] < LARGEST:
            return False
    return True


def is_beyond(n: int, x: Vector, bounds: Vector) -> bool:
    """Return True if any |x_i| is above its bound."""
    for i in range(n):  # noqa: SIM110
        if not -bounds[i] <= x[i] <= bounds[i]:
            return True
    return False


def factor(lower: Matrix, upper: Matrix, n: int, m: Matrix) -> bool:
    """Set m = L U, L with a diagonal of ones; return False unless x'mx > 0 for all x.

    There is no pivoting: the pivots of such a matrix are positive.
    """
    for i in range(n):
        for j in range(i, n):
            left = m[i][j]
            for k in range(i):
                left -= lower[i][k] * upper[k][j]
            upper[i][j] = left
        if not upper[i][i] > 0.0:
            return False
        for j in range(i + 1, n):
            left = m[j][i]
            for k in range(i):
                left -= lower[j][k] * upper[k][i]
            lower[j][i] = left / upper[i][i]
    return True


def substitute(x: Vector, n: int, lower: Matrix, upper: Matrix) -> None:
    """Replace x by (L U)^-1 x."""
    for i in range(1, n):
        left = x[i]
        for k in range(i):
            left -= lower[i][k] * x[k]
        x[i] = left
    for i in range(n - 1, -1, -1):
        left = x[i]
        for k in range(i + 1, n):
            left -= upper[i][k] * x[k]
        x[i] = left / upper[i][i]


def solve(x: Vector, lower: Matrix, upper: Matrix, n: int, m: Matrix) -> None:
    """Replace x by m^-1 x, nan unless x'mx > 0 for all x; `lower` and `upper` are overwritten."""
    if n == 1:
        x[0] = x[0] / m[0][0] if m[0][0] > 0.0 else math.nan
    elif n == 2:
        solve_two(x, m)
    elif factor(lower, upper, n, m):
        substitute(x, n, lower, upper)
    else:
        for i in range(n):
            x[i] = math.nan


def solve_two(x: Vector, m: Matrix) -> None:
    """Replace x by m^-1 x for two positions."""
    u00, u01 = m[0][0], m[0][1]
    x0, x1 = math.nan, math.nan
    if u00 > 0.0:
        l10 = m[1][0] / u00
        u11 = m[1][1] - l10 * u01
        if u11 > 0.0:
            x1 = (x[1] - l10 * x[0]) / u11
            x0 = (x[0] - u01 * x1) / u00
    x[0], x[1] = x0, x1


def divide(
    out: Matrix, column: Vector, lower: Matrix, upper: Matrix, n: int, m: Matrix, b: Matrix
) -> None:
    """Set m^-1 B on the same condition; `column`, `lower` and `upper` are overwritten."""
    for j in range(n):
        for i in range(n):
            column[i] = b[i][j]
        solve(column, lower, upper, n, m)
        for i in range(n):
            out[i][j] = column[i]
