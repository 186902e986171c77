"""A mechanism as a plant: its model stepped by Runge-Kutta, with what observers do not know.

The same `Mechanics` that drives the observers moves the plant. Everything compiles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.mechanical_algebra import mechanical_algebra
from estimator_pkg.observers.mechanical_velocity import make_acceleration


def make_plant(mechanics: Mechanics) -> Callable[..., tuple]:
    """plant(values, q, v, u, dt, parts) -> (q, v): `parts` steps of RK4, the input held.

    u is the tuple of inputs [SI]; `values` are the model's numbers, so that one compiled plant
    serves every set of them.
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
            q = towards(towards(towards(towards(q, h / 6.0, v), h / 3.0, v2), h / 3.0, v3),
                        h / 6.0, v4)
            v = towards(towards(towards(towards(v, h / 6.0, a1), h / 3.0, a2), h / 3.0, a3),
                        h / 6.0, a4)
        return q, v

    return plant


def make_motion(mechanics: Mechanics) -> Callable[..., None]:
    """motion(values, q, v, inputs, dt, parts, positions, velocities): a whole run.

    `inputs` has shape (N, m), held from each sample to the next; row k of `positions` and
    `velocities`, shape (N, n), is the state at sample k.
    """
    plant = make_plant(mechanics)
    vector, out = row_of(max(1, mechanics.inputs)), put_row(mechanics.degrees)

    def motion(values: tuple, q: tuple, v: tuple, inputs: Any, dt: float, parts: int,
               positions: Any, velocities: Any) -> None:
        for k in range(len(positions)):
            out(positions, k, q)
            out(velocities, k, v)
            q, v = plant(values, q, v, vector(inputs, k), dt, parts)

    return motion


def row_of(size: int) -> Callable[..., tuple]:
    """row(array, k) -> row k of an array as a tuple of `size` floats."""
    names: dict[str, Any] = {}
    exec('def row(array, k): return (' + ''.join(f'array[k, {i}], ' for i in range(size)) + ')',
         names)
    return names['row']


def put_row(size: int) -> Callable[..., None]:
    """put(array, k, row): a tuple of `size` floats as row k of an array."""
    names: dict[str, Any] = {}
    exec('def put(array, k, row):\n' + '\n'.join(f'    array[k, {i}] = row[{i}]'
                                                 for i in range(size)), names)
    return names['put']
