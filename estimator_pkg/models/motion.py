# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Integrate a model's equations by Runge-Kutta, for simulators and identification."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from estimator_pkg.models.mechanics import Array, Mechanics


def move(plant: Any, q: Any, v: Any, u: Any, dt: Array | float, parts: int) -> tuple[Any, Any]:
    """Return positions and velocities after dt [s] with constant inputs u, in `parts` RK4 steps.

    Parameters
    ----------
    plant : a model of ours, or a joint with its `acceleration`.
    q, v, u : numbers, or shape (..., n) and (..., m): any number of motions of a model of ours.
    dt : a number, or of shape (..., 1).
    """
    h = dt / parts
    a = plant.acceleration
    for _ in range(parts):
        a1 = a(q, v, u)
        v2 = v + 0.5 * h * a1
        a2 = a(q + 0.5 * h * v, v2, u)
        v3 = v + 0.5 * h * a2
        a3 = a(q + 0.5 * h * v2, v3, u)
        v4 = v + h * a3
        a4 = a(q + h * v3, v4, u)
        q = q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return q, v


def course(
    plant: Mechanics, q: Array, v: Array, inputs: Array, steps: Array, parts: Iterable[int]
) -> tuple[Array, Array]:
    """Return positions and velocities, shape (N + 1, ..., n): at the start and after each step.

    Parameters
    ----------
    inputs : shape (N, ..., m); row k acts over `steps[k]` [s], in `parts[k]` steps of RK4.
    q, v, steps : as q, v and dt of `move`.
    """
    positions, velocities = [q], [v]
    for u, dt, count in zip(inputs, steps, parts):
        q, v = move(plant, q, v, u, dt, count)
        positions.append(q)
        velocities.append(v)
    return np.array(positions), np.array(velocities)
