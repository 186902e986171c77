# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""From the filtered regressor and the parameters to the states x and the velocity.

The adaptation of the parameters is in `law`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.observers.adaptive.filter import companion
from estimator_pkg.observers.adaptive.gains import GRADIENT, PAPER, Gains, Structure
from estimator_pkg.observers.adaptive.theta import unrolled_theta
from estimator_pkg.observers.maths.unroll import algebra


class Motion(NamedTuple):
    """Functions of one structure; `inner` is (psi_y, psi_u, psi_1, psi_s).

    parts : (theta, design) -> (L, B, load, gravity), within the bounds.
    states : (inner, z, theta, design) -> (x1, x2, velocity without b1 u) [rad, rad/s, rad/s].
    started : (u, theta, design, y, speed) -> (inner, z) in steady state at y [rad], with this
        speed [rad/s].
    paper_start : (theta, design, y, speed) -> x of the paper form, at y [rad] and speed [rad/s].
    moved_by : (inner, L, B, load, gravity, design) -> Upsilon times this change of theta.
    """

    parts: Callable[..., tuple]
    states: Callable[..., tuple[float, float, float]]
    started: Callable[..., tuple]
    paper_start: Callable[..., tuple]
    moved_by: Callable[..., tuple]


def motion(gains: Gains, made: Structure) -> Motion:
    """Return the functions of this structure."""
    n, m = gains.order, len(made.free)
    is_paper, second = gains.form == PAPER, gains.order > 1
    has_load, has_gravity = gains.load, gains.gravity
    clipped = gains.law != GRADIENT and any(
        math.isfinite(bound) for bound in (*made.low, *made.high)
    )
    filters, vectors = companion(n), algebra(n)
    rows, after, times = filters.rows, filters.after, filters.times
    dot, add, apply, clip = vectors.dot, vectors.add, vectors.apply, algebra(m).clip
    all_parts = unrolled_theta(n, has_load, has_gravity, made.free).parts
    zeros = (0.0,) * n
    unit, last = (1.0, *zeros[1:]), (*zeros[1:], 1.0)
    next_unit = (0.0, 1.0, *zeros[2:]) if second else zeros

    def parts(theta: tuple, design: Any) -> tuple:
        """Return (L, B, load, gravity), clamped to the bounds.

        The theta of least squares is not clamped: P assumes that theta moves, so the recursion
        would diverge at a bound.
        """
        if clipped:
            theta = clip(theta, design.low, design.high)
        return all_parts(theta, design.fixed)

    def states(inner: tuple, z: tuple, theta: tuple, design: Any) -> tuple[float, float, float]:
        of_y, of_u, load, gravity = parts(theta, design)
        first = design.a_c[0] + of_y[0]  # of A_c + L C
        if is_paper:
            x1 = z[0]
            x2 = z[1] if second else 0.0
            return x1, x2, x2 + first * x1
        y, u, one, sine = inner
        a = design.a_k
        injected = add(design.k, 1.0, of_y)  # K + L
        x1 = z[0] + dot(y, injected) + dot(u, of_u)
        x2 = 0.0
        if second:
            x2 = (
                z[1]
                + dot(y, add(times(a, injected), -a[0], injected))
                + dot(u, add(times(a, of_u), -a[0], of_u))
            )
        if has_load:
            x1 += load * one[n - 1]
            if second:
                x2 += load * (after(one, a)[n - 1] - a[0] * one[n - 1])
        if has_gravity:
            x1 += gravity * sine[n - 1]
            if second:
                x2 += gravity * (after(sine, a)[n - 1] - a[0] * sine[n - 1])
        return x1, x2, x2 + first * x1

    def started(u: tuple, theta: tuple, design: Any, y: float, speed: float) -> tuple:
        rest = add(zeros, -1.0 / design.a_k[n - 1], last)
        inner = (add(zeros, y, rest), u, rest, add(zeros, math.sin(y), rest))
        of_y, of_u, load, gravity = parts(theta, design)
        first = design.a_c[0] + of_y[0]
        x1, x2, w = states(inner, zeros, theta, design)
        z = add(zeros, y - x1, unit)
        return inner, add(z, speed - first * y - x2, next_unit) if second else z

    def paper_start(theta: tuple, design: Any, y: float, speed: float) -> tuple:
        x = add(zeros, y, unit)
        if second:
            of_y, of_u, load, gravity = parts(theta, design)
            first = design.a_c[0] + of_y[0]
            x = add(x, speed - first * y, next_unit)
        return x

    def moved_by(
        inner: tuple, of_y: tuple, of_u: tuple, load: float, gravity: float, design: Any
    ) -> tuple:
        y, u, one, sine = inner
        shift = add(apply(rows(y, design.a_k), of_y), 1.0, apply(rows(u, design.a_k), of_u))
        if has_load:
            shift = add(shift, load, apply(rows(one, design.a_k), last))
        if has_gravity:
            shift = add(shift, gravity, apply(rows(sine, design.a_k), last))
        return shift

    return Motion(parts, states, started, paper_start, moved_by)


def gramian(column: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    """Return W = int exp(A's)' C'C exp(A s) ds, shape (n, n), for the noise of filter outputs."""
    n = len(column)
    a = np.diag(np.ones(n - 1), 1)
    a[:, 0] = column
    both = np.kron(a.T, np.eye(n)) + np.kron(np.eye(n), a.T)
    c = np.zeros(n)
    c[0] = 1.0
    w = np.linalg.solve(both, -np.outer(c, c).ravel()).reshape(n, n)
    return as_rows(0.5 * (w + w.T))


def as_rows(matrix: Any) -> tuple[tuple[float, ...], ...]:
    """Return a matrix as a tuple of rows."""
    return tuple(tuple(float(x) for x in row) for row in matrix)
