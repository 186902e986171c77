# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Filters with a companion matrix A.

A is a_i in its first column and 1 above its diagonal (observable canonical form, C = [1 0 .. 0]).
A matrix M that commutes with A, such as exp(A h) or the filtered regressor (11), follows from its
first row C M: row i + 1 is row_i A - a_i row_1. So this module filters n numbers where the paper
filters n x n, and a product with A costs n multiplications.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from estimator_pkg.observers.maths.vectors import dot

SERIES_TOLERANCE = 1e-18  # the series ends at terms smaller than this, relative to the first


def after(row: Sequence[float], a: Sequence[float]) -> list[float]:
    """Return row A."""
    return [dot(row, a), *row[:-1]]


def rows(row: list[float], a: Sequence[float]) -> list[list[float]]:
    """Return the whole matrix that commutes with A and has this first row."""
    if len(row) == 2:
        x, y = row
        return [row, [x * a[0] + y * a[1] - a[0] * x, x - a[0] * y]]
    found = [row]
    for a_i in a[:-1]:
        found.append([moved - a_i * own for moved, own in zip(after(found[-1], a), row)])
    return found


def left(row: list[float], matrix: list[list[float]]) -> list[float]:
    """Return row matrix."""
    return [dot(row, column) for column in zip(*matrix)]


def series(
    a: Sequence[float], size: float, h: float
) -> tuple[list[float], list[float], list[float]]:
    """Return the first rows of F = exp(A h), and of the responses to a constant and to a ramp.

    These are G0 = int_0^h exp(A s) ds and G1 = (1/h) int_0^h exp(A (h - s)) s ds. `size` is an
    upper bound of the magnitudes of A's eigenvalues [1/s].
    """
    f, g0, g1 = _series(tuple(a), size, h)
    return [*f], [*g0], [*g1]


@lru_cache(maxsize=16)
def _series(
    a: tuple[float, ...], size: float, h: float
) -> tuple[list[float], list[float], list[float]]:
    """Return `series`, computed once for all joints of a message."""
    doublings = 0
    while size * h > 0.5:
        h = 0.5 * h
        doublings += 1
    power = [1.0, *(0.0,) * (len(a) - 1)]  # first row of (A h)^j / j!
    f = power[:]
    g, q = [h * x for x in power], [0.5 * h * x for x in power]
    j, term = 1.0, 1.0
    while term > SERIES_TOLERANCE:
        t = h / j
        term *= size * t
        power = [t * x for x in after(power, a)]
        j += 1.0
        w = h / j
        s = w / (j + 1.0)
        for i, each in enumerate(power):
            f[i] += each
            g[i] += w * each
            q[i] += s * each
    for _ in range(doublings):
        m = rows(f, a)
        x, y = left(g, m), left(q, m)
        q = [0.5 * (q_i + g_i + y_i) for q_i, g_i, y_i in zip(q, g, y)]
        g = [g_i + x_i for g_i, x_i in zip(g, x)]
        f = left(f, m)
    return f, g, q


def euler(a: Sequence[float], h: float) -> tuple[list[float], list[float], list[float]]:
    """Return the same for the forward Euler step."""
    none = [0.0] * (len(a) - 1)
    f = [1.0 + h * a[0], *none]
    if none:
        f[1] = h
    return f, [h, *none], [0.0, *none]


def feed(
    row: list[float],
    columns: Sequence[Sequence[float]],
    g0: list[float],
    g1: list[float],
    held: float,
    rise: float,
) -> None:
    """Filter a signal that rises from `held` by `rise`: row F + held G0 + rise G1, in place.

    columns : of F.
    """
    if len(row) == 2:  # the usual order, in half the time
        x, y = row
        (f00, f10), (f01, f11) = columns
        row[0] = x * f00 + y * f10 + held * g0[0] + rise * g1[0]
        row[1] = x * f01 + y * f11 + held * g0[1] + rise * g1[1]
        return
    before = row[:]
    for i, column in enumerate(columns):
        total = 0.0
        for a, b in zip(before, column):
            total += a * b
        row[i] = total + held * g0[i] + rise * g1[i]
