# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The interface of a mechanical model: functions for model-based observers and simulators.

A mechanism with positions q (n), velocities v and inputs u (m) moves by

    M(q) v' + C(q, v) v + dV/dq = G(q) u - D(q) v - F(v),    q' = v

and is partially linearisable (PLvCC) if a square Psi(q) makes its momenta p = Psi(q)^T M(q) v obey
p' = Psi^T (G u - dV/dq - ...), without terms quadratic in p; then v = calM(q) p with
calM = M^-1 Psi^-T. Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), equations (2) to (8).

A model is a module with functions of vectors (`inertia`, `factors`, ...), which the engine
translates too, or an object of a user's own with the same functions, see `models.own`. Their first
argument is what they set; `values` are the model's numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import ModuleType
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.parameters import declared

JOINTS = 4  # most positions of a model of ours
NUMBERS = 10  # most numbers of a model of ours
Vector = Annotated[list[float], JOINTS]
Matrix = Annotated[list[list[float]], JOINTS, JOINTS]
Values = Annotated[list[float], NUMBERS]
Array = NDArray[np.float64]

TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Mechanics:
    """A model with parameter values.

    Attributes
    ----------
    name : as users write it.
    joints : names of the positions, in order; their number is the degrees of freedom.
    periods : of each position [rad], 0 if it does not wrap.
    values : the model's numbers.
    actuated : for each input, which position's effort it is (index into `joints`).
    model : the module or object with these functions and the numbers `JOINTS` and `INPUTS`:
        inertia(out, values, q): M, symmetric and positive.
        factors(calm, psi, values, q): calM and Psi.
        force(out, values, q, v, u): G u - dV/dq - F(v): all forces but damping and Coriolis ones.
        coriolis(out, values, q, v): C(q, v) v.
        damping(out, values, q): D, linear friction known to the observers.
        admits(values, q) -> False where the model must not be used (a singular Psi).
    linearisable : it has `factors`.
    damped : it has `damping`, and D is not zero.
    centre, reach : the configurations in which the model is checked: each position within
        centre +- reach; the centre is the default operating point.
    speed_matters : `force` depends on v.
    complaint : () -> the last error of a user's code, or ''.
    """

    name: str
    joints: tuple[str, ...]
    periods: tuple[float, ...]
    values: tuple[float, ...]
    actuated: tuple[int, ...]
    model: Any
    centre: tuple[float, ...]
    reach: tuple[float, ...]
    linearisable: bool = True
    damped: bool = False
    speed_matters: bool = False
    complaint: Callable[[], str] = str

    @property
    def degrees(self) -> int:
        """Number of positions."""
        return len(self.joints)

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.actuated)

    @property
    def ours(self) -> bool:
        """True if the engine may have the model."""
        return isinstance(self.model, ModuleType)

    def admits(self, q: Iterable[float]) -> bool:
        """Return False where the model must not be used."""
        return bool(self.model.admits(self.values, _row(q)))

    def inertia(self, q: Iterable[float]) -> Array:
        """Return M, shape (n, n)."""
        return self._set(self.model.inertia, 1, q)[0]

    def damping(self, q: Iterable[float]) -> Array:
        """Return D, shape (n, n); zero if there is none."""
        none = np.zeros((self.degrees, self.degrees))
        return self._set(self.model.damping, 1, q)[0] if self.damped else none

    def factors(self, q: Iterable[float]) -> Array:
        """Return (calM, Psi), shape (2, n, n)."""
        return self._set(self.model.factors, 2, q)

    def coriolis(self, q: Iterable[float], v: Iterable[float]) -> Array:
        """Return C v, shape (n,)."""
        out = [0.0] * self.degrees
        self.model.coriolis(out, self.values, _row(q), _row(v))
        return np.array(out)

    def force(self, q: Iterable[float], v: Iterable[float], u: Iterable[float]) -> Array:
        """Return all forces but damping and Coriolis ones, shape (n,)."""
        out = [0.0] * self.degrees
        self.model.force(out, self.values, _row(q), _row(v), _row(u))
        return np.array(out)

    def _set(self, function: Callable[..., None], count: int, q: Iterable[float]) -> Array:
        n = self.degrees
        out = [[[0.0] * n for _ in range(n)] for _ in range(count)]
        function(*out, self.values, _row(q))
        return np.array(out)


def _row(values: Iterable[float]) -> list[float]:
    return [float(value) for value in values]


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


def everywhere(values: Values, q: Vector) -> bool:
    """Return True: the domain of a model without singular configurations."""
    return True


def no_factors(calm: Matrix, psi: Matrix, values: Values, q: Vector) -> None:
    """Set nothing: the mechanism is not partially linearisable."""


def no_damping(out: Matrix, values: Values, q: Vector) -> None:
    """Set nothing: there is no damping."""


def assignments_of(model: Model, parameters: Any) -> tuple[str, ...]:
    """Return the 'parameter=value' texts that `load` takes for these parameters."""
    return tuple(
        f'{name}={getattr(parameters, name)!r}'.replace("'", '')
        for name in declared(model.parameters)
        if getattr(parameters, name) is not None
    )
