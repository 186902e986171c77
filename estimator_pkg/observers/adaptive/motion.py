# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""From the filtered regressor and the parameters to the states x and the velocity.

The adaptation of the parameters is in `law`.
"""

from __future__ import annotations

import math
from operator import add

import numpy as np

from estimator_pkg.observers.adaptive.filter import rows
from estimator_pkg.observers.adaptive.state import Coefficients, Design, State
from estimator_pkg.observers.maths.vectors import transformed


def set_plant(state: State, design: Design) -> None:
    """Set all of theta from the free parameters.

    The free parameters of least squares are clamped to their bounds here alone: P assumes that
    theta moves, so the recursion would diverge at a bound.
    """
    plant = state.plant
    if design.bounded and not design.is_gradient:
        for i, value, low, high in zip(design.free, state.theta, design.low, design.high):
            plant[i] = min(max(value, low), high)
    elif design.known:
        for i, value in zip(design.free, state.theta):
            plant[i] = value
    else:
        plant[:] = state.theta


def signals(state: State, design: Design) -> list[float]:
    """Return C Upsilon: what multiplies each parameter in theta."""
    found = state.of_y + state.of_u
    if design.load:
        found.append(state.of_one[-1])
    if design.gravity:
        found.append(state.of_sine[-1])
    return found


def states(state: State, design: Design) -> tuple[float, float, float]:
    """Return x1 [rad], x2 [rad/s] and the velocity without b1 u [rad/s]."""
    n, plant, z = design.order, state.plant, state.z
    first = design.a_c[0] + plant[0]  # of A_c + L C
    if design.is_paper:
        x1 = z[0]
        x2 = z[1] if n > 1 else 0.0
        return x1, x2, x2 + first * x1
    # x = z + Upsilon theta, where Upsilon has the rows of_y and of_y (A - a1), ...
    a, a_1, k = design.a_k, -design.a_k[0], design.k
    y1 = y2 = u1 = u2 = 0.0
    injected, given = k[0] + plant[0], plant[n]  # K + L; B
    for i in range(n):
        row_y, row_u, a_i = state.of_y[i], state.of_u[i], a[i]
        y1 += row_y * injected
        u1 += row_u * given
        if i == 0:
            injected_1, given_1 = injected, given
        if i + 1 < n:
            next_injected, next_given = k[i + 1] + plant[i + 1], plant[n + i + 1]
            y2 += row_y * (a_i * injected_1 + next_injected + a_1 * injected)
            u2 += row_u * (a_i * given_1 + next_given + a_1 * given)
            injected, given = next_injected, next_given
        else:
            y2 += row_y * (a_i * injected_1 + a_1 * injected)
            u2 += row_u * (a_i * given_1 + a_1 * given)
    x1 = z[0] + y1 + u1
    x2 = z[1] + y2 + u2 if n > 1 else 0.0
    if design.load:
        one, load = state.of_one, plant[2 * n]
        x1 += load * one[n - 1]
        if n > 1:
            x2 += load * (one[n - 2] + a_1 * one[n - 1])
    if design.gravity:
        sine, gravity = state.of_sine, plant[-1]
        x1 += gravity * sine[n - 1]
        if n > 1:
            x2 += gravity * (sine[n - 2] + a_1 * sine[n - 1])
    return x1, x2, x2 + first * x1


def settle(state: State, design: Design, speed: float) -> None:
    """Set filters and z to steady state at the angle y, with this speed [rad/s]."""
    n, y = design.order, state.y
    none = [0.0] * (n - 1)
    rest = -1.0 / design.a_k[n - 1]
    state.of_y, state.of_one = [*none, y * rest], [*none, rest]
    state.of_sine = [*none, math.sin(y) * rest]
    state.z = [0.0, *none]
    first = design.a_c[0] + state.plant[0]
    x1, x2 = 0.0, 0.0
    if not design.is_paper:
        x1, x2, _ = states(state, design)
    state.z[0] = y - x1
    if n > 1:
        state.z[1] = speed - first * y - x2


def euler_step(
    state: State, coefficients: Coefficients, design: Design, known_input: float, e: float
) -> None:
    """Set z of the paper form to x after a sample, without the last term of (13)."""
    n, y, z, plant = design.order, state.y, state.z, state.plant
    x1, h = z[0], coefficients.h
    for i in range(n):
        slope = design.a_c[i] * x1 + z[i + 1] if i + 1 < n else design.a_c[i] * x1
        slope = slope + y * plant[i] + known_input * plant[n + i] + e * design.k[i]
        if i == n - 1:
            if design.load:
                slope += plant[2 * n]
            if design.gravity:
                slope += plant[-1] * math.sin(y)
        z[i] += h * slope


def follow_parameters(
    state: State, before: list[list[float]], design: Design, change: list[float]
) -> None:
    """Add the last term of (13), Upsilon times the change of theta, to x of the paper form.

    before : the regressor's rows before this sample, for y, u, 1 and sin y.
    change : of all parameters.
    """
    n, a = design.order, design.a_k
    of_y, of_u, of_one, of_sine = before
    by_l, by_b = change[:n], change[n : 2 * n]
    by_y, by_u = transformed(rows(of_y, a), by_l), transformed(rows(of_u, a), by_b)
    shift = list(map(add, by_y, by_u))
    for known, row, moved in (
        (design.load, of_one, change[2 * n] if design.load else 0.0),
        (design.gravity, of_sine, change[-1]),
    ):
        if known:
            shift = [x + moved * own[n - 1] for x, own in zip(shift, rows(row, a))]
    state.z = list(map(add, state.z, shift))


def gramian(column: tuple[float, ...]) -> list[list[float]]:
    """Return W = int exp(A's)' C'C exp(A s) ds, shape (n, n), for the noise of filter outputs."""
    n = len(column)
    a = np.diag(np.ones(n - 1), 1)
    a[:, 0] = column
    both = np.kron(a.T, np.eye(n)) + np.kron(np.eye(n), a.T)
    c = np.zeros(n)
    c[0] = 1.0
    w = np.linalg.solve(both, -np.outer(c, c).ravel()).reshape(n, n)
    found: list[list[float]] = (0.5 * (w + w.T)).tolist()
    return found
