"""A mechanism as a plant over a whole run; what observers do not know is put around it elsewhere.

The same `Mechanics` that drives the observers moves the plant. Everything compiles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.models.motion import make_plant, put_row, row_of


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
