# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Integrate a model's equations by Runge-Kutta, for simulators and identification.

It uses the same `Mechanics` as the observers. Everything compiles if the model does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.maths.unroll import written_out
from estimator_pkg.observers.mechanism.algebra import mechanical_algebra
from estimator_pkg.observers.mechanism.velocity import make_acceleration


def make_plant(mechanics: Mechanics) -> Callable[..., tuple]:
    """Return plant(values, q, v, u, dt, parts) -> (q, v): `parts` steps of RK4, constant input.

    u is the tuple of inputs [SI]; `values` are the model's parameters, so one compiled plant
    serves all values.
    """
    towards = mechanical_algebra(mechanics.degrees).towards
    acceleration = make_acceleration(mechanics)

    def plant(values: tuple, q: tuple, v: tuple, u: tuple, dt: float, parts: int) -> tuple:
        h = dt / parts
        for _ in range(parts):
            a1 = acceleration(values, q, v, u)
            v2 = towards(v, 0.5 * h, a1)
            a2 = acceleration(values, towards(q, 0.5 * h, v), v2, u)
            v3 = towards(v, 0.5 * h, a2)
            a3 = acceleration(values, towards(q, 0.5 * h, v2), v3, u)
            v4 = towards(v, h, a3)
            a4 = acceleration(values, towards(q, h, v3), v4, u)
            q = towards(
                towards(towards(towards(q, h / 6.0, v), h / 3.0, v2), h / 3.0, v3), h / 6.0, v4
            )
            v = towards(
                towards(towards(towards(v, h / 6.0, a1), h / 3.0, a2), h / 3.0, a3), h / 6.0, a4
            )
        return q, v

    return plant


def make_course(mechanics: Mechanics) -> Callable[..., None]:
    """Return course(values, q, v, inputs, steps, longest, positions): positions at uneven times.

    Row k of `inputs`, shape (N, m), acts over `steps[k]` [s], the time from sample k to k + 1; row
    k of `positions`, shape (N + 1, n), is at sample k. The integration step is at most
    `longest` [s].
    """
    plant = make_plant(mechanics)
    vector, out = row_of(max(1, mechanics.inputs)), put_row(mechanics.degrees)

    def course(
        values: tuple, q: tuple, v: tuple, inputs: Any, steps: Any, longest: float, positions: Any
    ) -> None:
        out(positions, 0, q)
        for k in range(len(steps)):
            dt = steps[k]
            q, v = plant(values, q, v, vector(inputs, k), dt, int(dt / longest) + 1)
            out(positions, k + 1, q)

    return course


def row_of(size: int) -> Callable[..., tuple]:
    """Return row(array, k) -> row k of an array as a tuple of `size` floats."""
    entries = ''.join(f'array[k, {i}], ' for i in range(size))
    return written_out([f'def row(array, k): return ({entries})'], f'row of {size}')['row']


def put_row(size: int) -> Callable[..., None]:
    """Return put(array, k, row), which writes a tuple of `size` floats into row k of an array."""
    lines = [f'    array[k, {i}] = row[{i}]' for i in range(size)]
    return written_out(['def put(array, k, row):', *lines], f'put row of {size}')['put']
