# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The interface of a mechanical model: functions for model-based observers and simulators.

A mechanism with positions q (n), velocities v and inputs u (m) moves by

    M(q) v' + C(q, v) v + dV/dq = G(q) u - D(q) v - F(v),    q' = v

and is partially linearisable (PLvCC) if a square Psi(q) makes its momenta p = Psi(q)^T M(q) v obey
p' = Psi^T (G u - dV/dq - ...), without terms quadratic in p; then v = calM(q) p with
calM = M^-1 Psi^-T. Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), equations (2) to (8).

The functions are written in the subset of Python that Numba compiles: vectors are tuples of floats,
matrices tuples of rows. The first argument is the tuple of the model's parameters, so that other
values need no new compilation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from estimator_pkg.parameters import declared

Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]

TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Mechanics:
    """A model with parameter values.

    Attributes
    ----------
    name : as users write it.
    joints : names of the positions, in order; their number is the degrees of freedom.
    periods : of each position [rad], 0 if it does not wrap.
    values : the model's numbers, first argument of every function below.
    actuated : for each input, which position's effort it is (index into `joints`).
    inertia : (values, q) -> M, symmetric and positive.
    factors : (values, q) -> (calM, Psi); None if the mechanism is not partially linearisable.
    force : (values, q, v, u) -> G u - dV/dq - F(v): all forces but damping and Coriolis ones.
    coriolis : (values, q, v) -> C(q, v) v.
    damping : (values, q) -> D, linear friction known to the observers; None: no damping.
    admits : (values, q) -> False where the model must not be used (a singular Psi).
    centre, reach : the configurations in which the model is checked: each position within
        centre +- reach; the centre is the default operating point.
    speed_matters : `force` depends on v.
    compiles : every function is in the subset that Numba compiles.
    complaint : () -> the last error of a user's code, or ''.
    """

    name: str
    joints: tuple[str, ...]
    periods: Vector
    values: Vector
    actuated: tuple[int, ...]
    inertia: Callable[..., Matrix]
    factors: Callable[..., tuple[Matrix, Matrix]] | None
    force: Callable[..., Vector]
    coriolis: Callable[..., Vector]
    damping: Callable[..., Matrix] | None
    admits: Callable[..., bool]
    centre: Vector
    reach: Vector
    speed_matters: bool = False
    compiles: bool = True
    complaint: Callable[[], str] = str

    @property
    def degrees(self) -> int:
        """Number of positions."""
        return len(self.joints)

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.actuated)


@dataclass(frozen=True)
class Model:
    """A model, as an entry point of the group ``velocity_estimator.models`` names it.

    Attributes
    ----------
    name : as users write it.
    summary : one line for ``velocity_estimator list``.
    parameters : the frozen dataclass that declares its numbers (see `estimator_pkg.parameters`).
    build : (parameters) -> Mechanics.
    reference : source of the equations.
    identified : names of the parameters that a recording of positions and inputs determines; the
        others must be known, or only their product with one of these is identifiable.
    """

    name: str
    summary: str
    parameters: type
    build: Callable[[Any], Mechanics]
    reference: str = ''
    identified: tuple[str, ...] = ()


def everywhere(values: Vector, q: Vector) -> bool:
    """Return True: the domain of a model without singular configurations."""
    return True


def assignments_of(model: Model, parameters: Any) -> tuple[str, ...]:
    """Return the 'parameter=value' texts that `load` takes for these parameters."""
    return tuple(
        f'{name}={getattr(parameters, name)!r}'.replace("'", '')
        for name in declared(model.parameters)
        if getattr(parameters, name) is not None
    )
