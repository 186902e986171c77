# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Integrate a model's equations by Runge-Kutta, for simulators and identification.

It uses the same models as the observers, by the engine where that has the model.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.calls import Memory, functions_of
from estimator_pkg.models.mechanics import Mechanics, Values, Vector
from estimator_pkg.observers.mechanism.state import Work, enlarge
from estimator_pkg.observers.mechanism.velocity import accelerate
from estimator_pkg.record import record

Array = NDArray[np.float64]


@record
class Plant:
    """A mechanism that moves."""

    values: Values
    damped: bool  # the model has damping
    q: Vector  # positions [rad or m]
    v: Vector  # velocities
    u: Vector  # inputs
    at: Vector  # positions and velocities within a step
    v2: Vector
    v3: Vector
    v4: Vector
    a1: Vector  # accelerations
    a2: Vector
    a3: Vector
    work: Work


def move(model: Any, plant: Plant, dt: float, parts: int) -> None:
    """Move by dt [s], with constant inputs, in `parts` steps of RK4."""
    n, q, v, at, f = model.JOINTS, plant.q, plant.v, plant.at, plant.work.f
    v2, v3, v4 = plant.v2, plant.v3, plant.v4
    a1, a2, a3 = plant.a1, plant.a2, plant.a3
    h = dt / float(parts)
    for _ in range(parts):
        accelerate(model, plant.work, plant.values, plant.damped, q, v, plant.u)
        for i in range(n):
            a1[i] = f[i]
            v2[i] = v[i] + 0.5 * h * f[i]
            at[i] = q[i] + 0.5 * h * v[i]
        accelerate(model, plant.work, plant.values, plant.damped, at, v2, plant.u)
        for i in range(n):
            a2[i] = f[i]
            v3[i] = v[i] + 0.5 * h * f[i]
            at[i] = q[i] + 0.5 * h * v2[i]
        accelerate(model, plant.work, plant.values, plant.damped, at, v3, plant.u)
        for i in range(n):
            a3[i] = f[i]
            v4[i] = v[i] + h * f[i]
            at[i] = q[i] + h * v3[i]
        accelerate(model, plant.work, plant.values, plant.damped, at, v4, plant.u)
        for i in range(n):
            q[i] = q[i] + h / 6.0 * v[i] + h / 3.0 * v2[i] + h / 3.0 * v3[i] + h / 6.0 * v4[i]
            v[i] = v[i] + h / 6.0 * a1[i] + h / 3.0 * a2[i] + h / 3.0 * a3[i] + h / 6.0 * f[i]


def course(
    model: Any,
    plant: Plant,
    count: int,
    inputs: NDArray[np.float64],
    steps: NDArray[np.float64],
    parts: NDArray[np.int64],
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
) -> None:
    """Write the positions and velocities at the begin and after each of `count` steps.

    Row k of `inputs`, shape (count, max(1, m)), acts over `steps[k]` [s], in `parts[k]` steps of
    RK4; row k of the results, shape (count + 1, n), is at the begin of that step. All are flat.
    """
    n, m = model.JOINTS, max(1, model.INPUTS)
    for i in range(n):
        positions[i], velocities[i] = plant.q[i], plant.v[i]
    for k in range(count):
        for i in range(m):
            plant.u[i] = inputs[k * m + i]
        move(model, plant, steps[k], parts[k])
        for i in range(n):
            positions[(k + 1) * n + i], velocities[(k + 1) * n + i] = plant.q[i], plant.v[i]


class MechanismSimulation:
    """A mechanism that is moved by its inputs.

    Parameters
    ----------
    q, v : positions and velocities at the begin, shape (n,).
    """

    def __init__(self, mechanics: Mechanics, q: Any, v: Any) -> None:
        self._mechanics, n = mechanics, mechanics.degrees
        made: Any = enlarge(Plant(), n)
        made.values[: len(mechanics.values)] = map(float, mechanics.values)
        made.damped = mechanics.damped
        made.q[:n], made.v[:n] = map(float, q), map(float, v)
        self._compiled = functions_of(mechanics.model)
        self._plant = made
        if self._compiled is not None:
            self._memory = Memory(Plant, made)

    def begin(self, q: Any, v: Any) -> None:
        """Start again from these positions and velocities, shape (n,)."""
        n, plant = self._mechanics.degrees, self._plant
        plant.q[:n], plant.v[:n] = map(float, q), map(float, v)
        if self._compiled is not None:
            self._memory.array['q'][0, :n], self._memory.array['v'][0, :n] = q, v

    def run(self, inputs: Any, steps: Any, parts: Any) -> tuple[Array, Array]:
        """Return (positions, velocities), shape (N + 1, n), see `course`; the motion goes on."""
        count, n = len(steps), self._mechanics.degrees
        given = np.zeros((count, max(1, self._mechanics.inputs)))
        given[:, : self._mechanics.inputs] = inputs
        kinds = zip((given.ravel(), steps, parts), (float, float, np.int64))
        columns: list[Any] = [np.ascontiguousarray(column, kind) for column, kind in kinds]
        positions, velocities = np.zeros((count + 1, n)), np.zeros((count + 1, n))
        if self._compiled is not None:
            pointers = [column.ctypes.data for column in (*columns, positions, velocities)]
            self._compiled.course(self._memory.pointer, count, *pointers)
        else:
            rows: list[Any] = [column.tolist() for column in columns]
            rows += [positions.ravel(), velocities.ravel()]
            course(self._mechanics.model, self._plant, count, *rows)
        return positions, velocities

    def step(self, u: Any, dt: float, parts: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return positions and velocities after dt [s] with constant inputs u; see `course`."""
        q, v = self.run([u[: self._mechanics.inputs]], [dt], [parts])
        return tuple(q[1].tolist()), tuple(v[1].tolist())


def acceleration(mechanics: Mechanics, q: Any, v: Any, u: Any) -> Array:
    """Return M^-1 [force - C v - D v], shape (n,), in plain Python."""
    work, n = enlarge(Work(), mechanics.degrees), mechanics.degrees
    q, v, u = ([float(each) for each in values] for values in (q, v, u))
    accelerate(mechanics.model, work, list(mechanics.values), mechanics.damped, q, v, u)
    return np.array(work.f[:n])
