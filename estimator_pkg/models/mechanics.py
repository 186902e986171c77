# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Mechanical models as arrays, for model-based observers, simulators and identification.

A mechanism with positions q (n), velocities v and inputs u (m) moves by

    M(q) v' + C(q, v) v + dV/dq = G(q) u - D(q) v - F(v),    q' = v

and is partially linearisable (PLvCC) if a square Psi(q) makes its momenta p = Psi(q)^T M(q) v obey
p' = Psi^T (G u - dV/dq - ...), without terms quadratic in p; then v = calM(q) p with
calM = M^-1 Psi^-T. Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), equations (2) to (8).

A model is an object with the attributes and methods of docs/known_inputs.md: one of ours, or a
user's own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.parameters import declared

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
DERIVATIVE_STEP = 1e-6  # step of the Christoffel symbols, for a model without Coriolis forces
NEEDED = ('joints', 'inertia', 'gradient', 'inputs')
FORCES = ('joints', 'inertia', 'force')


def apply(matrix: Array, x: Array) -> Array:
    """Return A x of the last axes, shape (..., n), for A of shape (..., n, n)."""
    product: Array = (matrix @ x[..., None])[..., 0]
    return product


def transposed(matrix: Array) -> Array:
    """Return A^T of the last two axes, shape (..., n, m)."""
    return matrix.swapaxes(-1, -2)


def vector(*entries: Any) -> Array:
    """Return the vector of these entries: numbers, or arrays of one shape."""
    arrays = [each for each in entries if getattr(each, 'ndim', 0)]
    if not arrays:
        return np.array(entries, float)
    found = np.empty((*arrays[0].shape, len(entries)))
    for k, entry in enumerate(entries):
        found[..., k] = entry
    return found


def matrix(*rows: tuple[Any, ...]) -> Array:
    """Return the matrix of these rows, shape (..., n, n), with entries as those of `vector`."""
    flat = vector(*(entry for row in rows for entry in row))
    return flat.reshape(*flat.shape[:-1], len(rows), len(rows))


class Mechanics:
    """A model with its numbers: what it returns, as arrays whose shapes are checked.

    Positions and velocities have shape (n,), or (..., n). The methods of a model of ours take both;
    what does not depend on them may have fewer axes. A user's take shape (n,).

    Parameters
    ----------
    model : see docs/known_inputs.md.
    name : as users write it.

    Attributes
    ----------
    ours : it is no user's own.
    joints : names of the positions, in order.
    periods : of each position [rad], 0 if it does not wrap.
    actuated : for each input, which position's effort it is (index into `joints`).
    centre, reach : the configurations in which the model is checked: each position within
        centre +- reach; the centre is the default operating point.
    linearisable : it has `factors`.
    damped : it has damping. dry : its forces depend on the velocities.
    trusted : it was checked: NaN takes the place of every failure of the model's code.
    complaint : the last such failure, or ''.

    Raises
    ------
    UserError, UsageError : a required attribute is missing or wrong.
    """

    def __init__(self, model: Any, name: str) -> None:
        needed = FORCES if hasattr(model, 'force') else NEEDED
        missing = [each for each in needed if not hasattr(model, each)]
        if missing:
            raise UserError(
                f"model '{name}' has no {missing[0]}: it must define {', '.join(needed)}"
            )
        if isinstance(model.joints, str) or not isinstance(model.joints, Iterable):
            raise UserError(f"model '{name}': joints must be a list of names, not {model.joints!r}")
        self.name, self.model, self.ours = name, model, ':' not in name
        self.joints = tuple(str(joint) for joint in model.joints)
        n = self.degrees = len(self.joints)
        if not n:
            raise UsageError(f"model '{name}': joints is empty: name at least one")
        self.actuated = tuple(int(index) for index in getattr(model, 'actuated', range(n)))
        if any(not 0 <= index < n for index in self.actuated):
            raise UsageError(f"model '{name}': 'actuated' names joint {max(self.actuated)} of {n}")
        self.inputs = len(self.actuated)
        self.periods = self._numbers('periods', TURN)
        self.centre = self._numbers('centre', 0.0)
        self.reach = self._numbers('reach', 1.0)
        self.damped = getattr(model, 'damped', hasattr(model, 'damping'))
        self.dry = getattr(model, 'dry', hasattr(model, 'friction'))
        self.linearisable = hasattr(model, 'psi') or hasattr(model, 'factors')
        self.trusted, self.complaint = False, ''
        self._of_coriolis = getattr(model, 'coriolis', self._christoffel)

    def _numbers(self, name: str, usual: float) -> tuple[float, ...]:
        provided = np.atleast_1d(getattr(self.model, name, (usual,) * self.degrees))
        if len(provided) != self.degrees:
            raise UserError(
                f"model '{self.name}': {name} has {len(provided)} numbers for {self.degrees} joints"
            )
        return tuple(float(value) for value in provided)

    def inertia(self, q: Array) -> Array:
        """Return M, shape (n, n)."""
        return self._called('inertia', self.model.inertia, 2, q)

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return C v, shape (n,)."""
        return self._called('coriolis', self._of_coriolis, 1, q, v)

    def damping(self, q: Array) -> Array:
        """Return D, shape (n, n); zero if there is none."""
        if not self.damped:
            return np.zeros((*q.shape, self.degrees))
        return self._called('damping', self.model.damping, 2, q)

    def force(self, q: Array, v: Array, u: Array) -> Array:
        """Return G u - dV/dq - F(v), shape (n,)."""
        return self._called('force', getattr(self.model, 'force', self._force), 1, q, v, u)

    def factors(self, q: Array) -> tuple[Array, Array]:
        """Return (calM, Psi), shape (n, n) each."""
        model = self.model
        if hasattr(model, 'factors'):
            calm, psi = self._called('factors', model.factors, 2, q, count=2)
            return calm, psi
        if not hasattr(model, 'psi'):  # often right; `check.partially_linear` finds out
            psi = self._called('Psi', lambda q: np.linalg.cholesky(_inverse(self.inertia(q))), 2, q)
            return psi, psi
        psi = self._called('Psi', model.psi, 2, q)
        if hasattr(model, 'calm'):
            return self._called('calM', model.calm, 2, q), psi
        return self._called('calM', lambda q: _inverse(psi.T @ self.inertia(q)), 2, q), psi

    def admits(self, q: Array) -> bool:
        """Return False where the model must not be used, or cannot be."""
        if not hasattr(self.model, 'admits'):
            return True
        try:
            return bool(np.all(self.model.admits(q)))
        except Exception as error:  # a user's code may fail in any way
            self._fail(error)
            return False

    def acceleration(self, q: Array, v: Array, u: Array) -> Array:
        """Return v' = M^-1 [G u - dV/dq - F(v) - C v - D v], shape (n,)."""
        force = self.force(q, v, u) - self.coriolis(q, v)
        if self.damped:
            force = force - apply(self.damping(q), v)
        return solved(self.inertia(q), force[..., None])[..., 0]

    def _force(self, q: Array, v: Array, u: Array) -> Array:
        model = self.model
        total: Array = np.asarray(model.inputs(q), float) @ u - model.gradient(q)
        return total - model.friction(v) if self.dry else total

    def _christoffel(self, q: Array, v: Array) -> Array:
        """Return C v from the mass matrix by central differences."""
        turning, energy = np.zeros((self.degrees, self.degrees)), np.zeros(self.degrees)
        for index, step in enumerate(DERIVATIVE_STEP * np.eye(self.degrees)):
            slope = (self.inertia(q + step) - self.inertia(q - step)) / (2.0 * DERIVATIVE_STEP)
            turning += v[index] * slope
            energy[index] = 0.5 * v @ slope @ v
        return turning @ v - energy

    def _called(
        self, name: str, function: Callable[..., Any], axes: int, *given: Array, count: int = 0
    ) -> Array:
        """Return what a method of the model gives, as an array; raise UserError for its shape."""
        if given[0].ndim > 1 and not self.ours:
            rows = [self._called(name, function, axes, *row, count=count) for row in zip(*given)]
            return np.stack(rows, axis=1 if count else 0)
        wanted = given[0].shape + given[0].shape[-1:] * (axes - 1)
        wanted = (count, *wanted) if count else wanted
        try:
            found: Array = np.asarray(function(*given), float)
            if found.shape != wanted and given[0].ndim > 1:
                found = np.broadcast_to(found, wanted)
            elif found.shape != wanted and found.size == np.prod(wanted):
                found = found.reshape(wanted)
        except Exception as error:  # a user's code may fail in any way
            self._fail(error)
            return np.full(wanted, np.nan)
        if found.shape != wanted:
            self._fail(
                UserError(
                    f"model '{self.name}' of {self.degrees} joints and {self.inputs} inputs: "
                    f'{name} has dimensions {found.shape}, not {wanted}'
                )
            )
            return np.full(wanted, np.nan)
        return found

    def _fail(self, error: Exception) -> None:
        if not self.trusted:
            raise error
        self.complaint = f'{type(error).__name__}: {error}'


def _inverse(found: Any) -> Array:
    inverse: Array = np.linalg.inv(found)
    return inverse


def solved(inertia: Array, right: Array) -> Array:
    """Return M^-1 B, shape (..., n, m); NaN if M is singular."""
    try:
        return np.asarray(np.linalg.solve(inertia, right), float)
    except np.linalg.LinAlgError:
        return np.full(np.broadcast_shapes(inertia.shape[:-1] + (1,), right.shape), np.nan)


@dataclass(frozen=True)
class Model:
    """A model, as an entry point of the group ``velocity_estimator.models`` names it.

    Attributes
    ----------
    name : as users write it.
    summary : one line for ``velocity_estimator list``.
    parameters : the frozen dataclass that declares its numbers (see `estimator_pkg.parameters`) and
        has the methods of the model (see docs/known_inputs.md), for arrays of shape (..., n).
    form : (parameters) -> the object with the methods, where their names are those of numbers.
    reference : source of the equations.
    identified : names of the parameters that a recording of positions and inputs determines; the
        others must be known, or only their product with one of these is identifiable.
    """

    name: str
    summary: str
    parameters: type
    reference: str = ''
    identified: tuple[str, ...] = ()
    form: Callable[[Any], Any] | None = None

    def build(self, parameters: Any) -> Mechanics:
        """Return the model with these numbers."""
        return Mechanics(self.form(parameters) if self.form else parameters, self.name)


def assignments_of(model: Model, parameters: Any) -> tuple[str, ...]:
    """Return the 'parameter=value' texts that `load` takes for these parameters."""
    return tuple(
        f'{name}={getattr(parameters, name)!r}'.replace("'", '')
        for name in declared(model.parameters)
        if getattr(parameters, name) is not None
    )
