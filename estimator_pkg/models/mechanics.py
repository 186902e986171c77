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
from estimator_pkg.parameters import declared, structural

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
POSITIVE = 1e-9  # least value of a parameter that must not be 0
DIFFERENCE = 1e-5  # step of the central differences, over the reach of a position
NEEDED = ('joints', 'inertia', 'gradient', 'inputs')


def apply(matrix: Array, x: Array) -> Array:
    """Return A x of the last axes, shape (..., n), for A of shape (..., n, m)."""
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
    linearisable : it has a Psi.
    damped : it has viscous friction. dry : it has Coulomb friction.
    trusted : it was checked: NaN takes the place of every failure of the model's code.
    complaint : the last such failure, or ''.

    Raises
    ------
    UserError, UsageError : a required attribute is missing or wrong.
    """

    def __init__(self, model: Any, name: str) -> None:
        missing = [each for each in NEEDED if not hasattr(model, each)]
        if missing:
            raise UserError(
                f"model '{name}' has no {missing[0]}: it must define {', '.join(NEEDED)}"
            )
        if isinstance(model.joints, str) or not isinstance(model.joints, Iterable):
            raise UserError(f"model '{name}': joints must be a list of names, not {model.joints!r}")
        self.name, self.model, self.ours = name, model, ':' not in name
        self.trusted, self.complaint = False, ''
        self.joints = tuple(str(joint) for joint in model.joints)
        n = self.degrees = len(self.joints)
        if not n:
            raise UsageError(f"model '{name}': joints is empty: name at least one")
        self.actuated = tuple(int(index) for index in getattr(model, 'actuated', range(n)))
        if any(not 0 <= index < n for index in self.actuated):
            raise UsageError(f"model '{name}': 'actuated' names joint {max(self.actuated)} of {n}")
        self.inputs = len(self.actuated)
        self._shapes = {'n': (n,), 'nn': (n, n), 'nm': (n, self.inputs)}
        self.periods = self._numbers('periods', TURN)
        self.centre = self._numbers('centre', 0.0)
        self.reach = self._numbers('reach', 1.0)
        self.linearisable = hasattr(model, 'psi')  # or `check` finds that it is
        one = np.ones(n)
        self.damped = hasattr(model, 'damping') and (not self.ours or bool(self.damping(one).any()))
        self.dry = hasattr(model, 'friction') and (
            not self.ours or bool(np.any([model.friction(one), model.friction(-one)]))
        )

    def _numbers(self, name: str, usual: float) -> tuple[float, ...]:
        provided = np.atleast_1d(getattr(self.model, name, (usual,) * self.degrees))
        if len(provided) != self.degrees:
            raise UserError(
                f"model '{self.name}': {name} has {len(provided)} numbers for {self.degrees} joints"
            )
        return tuple(float(value) for value in provided)

    def inertia(self, q: Array) -> Array:
        """Return M, shape (n, n)."""
        return self._called('inertia', 'nn', self.model.inertia, q)

    def coriolis(self, q: Array, v: Array) -> Array:
        """Return C v, shape (n,)."""
        return self._called(
            'coriolis', 'n', getattr(self.model, 'coriolis', self.christoffel), q, v
        )

    def christoffel(self, q: Array, v: Array) -> Array:
        """Return C v = (dM/dt) v - d/dq (v^T M v / 2), shape (n,), by central differences of M."""
        slopes = self.slopes(self.inertia, q)
        return np.tensordot(v, slopes, 1) @ v - 0.5 * (slopes @ v) @ v

    def damping(self, q: Array) -> Array:
        """Return D, shape (n, n); zero if there is none."""
        if not hasattr(self.model, 'damping'):
            return np.zeros((*q.shape, self.degrees))
        return self._called('damping', 'nn', self.model.damping, q)

    def force(self, q: Array, v: Array, u: Array) -> Array:
        """Return G u - dV/dq - F(v), shape (n,)."""
        inputs = self.model.inputs(q) if self.ours else 0.0
        if np.ndim(inputs) == 2:  # one G for all q is quicker
            driven = u @ np.asarray(inputs).T
        else:
            driven = apply(self._called('inputs', 'nm', self.model.inputs, q), u)
        total = driven - self._called('gradient', 'n', self.model.gradient, q)
        return total - self._called('friction', 'n', self.model.friction, v) if self.dry else total

    def factors(self, q: Array) -> tuple[Array, Array]:
        """Return (calM, Psi), shape (n, n) each.

        A model without Psi gets the lower Cholesky factor of M^-1, which often is one;
        `check.linear_residual` finds out.
        """
        if not hasattr(self.model, 'psi'):
            psi = self._called(
                'psi', 'nn', lambda q: np.linalg.cholesky(np.linalg.inv(self.inertia(q))), q
            )
            return psi, psi
        psi = self._called('psi', 'nn', self.model.psi, q)
        return solved(transposed(psi) @ self.inertia(q), np.eye(self.degrees)), psi

    def admits(self, q: Array) -> bool:
        """Return False where the model must not be used, or cannot be."""
        if not hasattr(self.model, 'admits'):
            return True
        try:
            return bool(np.all(self.model.admits(q)))
        except Exception as error:  # a user's code may fail in any way
            self._fail('admits', q, error)
            return False

    def acceleration(self, q: Array, v: Array, u: Array) -> Array:
        """Return v' = M^-1 [G u - dV/dq - F(v) - C v - D v], shape (n,)."""
        force = self.force(q, v, u) - self.coriolis(q, v)
        if self.damped:
            force = force - apply(self.damping(q), v)
        return solved(self.inertia(q), force[..., None])[..., 0]

    def slopes(self, function: Callable[[Array], Array], q: Array) -> Array:
        """Return the derivatives of `function` by each position, shape (n, ...), at one q."""
        steps = np.diag(DIFFERENCE * np.maximum(self.reach, 1e-6))
        return np.array([(function(q + h) - function(q - h)) / (2.0 * h.sum()) for h in steps])

    def _called(self, name: str, axes: str, function: Callable[..., Any], *at: Array) -> Array:
        """Return what a method of the model gives, as an array with these last axes ('nm': n, m).

        Raises
        ------
        UserError : it fails or has another shape, and the model is not yet trusted.
        """
        if at[0].ndim > 1 and not self.ours:
            return np.array([self._called(name, axes, function, *row) for row in zip(*at)])
        wanted = at[0].shape[:-1] + self._shapes[axes]
        try:
            found: Array = np.asarray(function(*at), float)
            if found.shape == wanted:
                return found
            if at[0].ndim > 1:
                return np.broadcast_to(found, wanted)
            if _long(found.shape) == _long(wanted):
                return found.reshape(wanted)
            raise ValueError(f'it has dimensions {found.shape}, not {wanted}')
        except Exception as error:  # a user's code may fail in any way
            self._fail(name, at[0], error)
            return np.full(wanted, np.nan)

    def _fail(self, name: str, at: Array, error: Exception) -> None:
        self.complaint = f'{type(error).__name__}: {error}'
        if not self.trusted:
            raise UserError(
                f"model '{self.name}': {name} fails at {text(at)}: {self.complaint}"
            ) from error


def _long(shape: tuple[int, ...]) -> list[int]:
    """Return the axes that are longer than 1: a column may be returned as a list."""
    return [size for size in shape if size > 1]


def text(values: Array) -> str:
    """Return a vector of shape (n,) as text."""
    return '(' + ', '.join(f'{value:.4g}' for value in values) + ')'


def solved(inertia: Array, right: Array) -> Array:
    """Return M^-1 B, shape (..., n, m); NaN if M is singular."""
    try:
        return np.asarray(np.linalg.solve(inertia, right), float)
    except np.linalg.LinAlgError:
        return np.full(np.broadcast_shapes(inertia.shape[:-1] + (1,), right.shape), np.nan)


def number(
    default: float | None, unit: str, description: str, least: float = 0.0, **declaration: Any
) -> Any:
    """Return the declaration of a model's parameter, from `least` to 1e6.

    `declaration` has what else `estimator_pkg.parameters.structural` takes.
    """
    return structural(
        default, unit=unit, range=(least, 1e6), description=description, **declaration
    )


def smooth_sign(v: Any, width: float) -> Any:
    """Return tanh(v / width), the sign in Coulomb friction; for width 0 the sign of v."""
    return np.tanh(v / width) if width > 0.0 else np.sign(v)


def sign_width(default: float, unit: str) -> Any:
    """Return the declaration of the width of `smooth_sign`."""
    return number(
        default,
        unit,
        'width of the smoothed sign of the Coulomb friction, tanh(v / width); 0: a plain sign',
        advanced=True,
    )


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
    known : names of the parameters that a recording of positions and inputs does not determine, or
        only as a product with one of the others.
    """

    name: str
    summary: str
    parameters: type
    reference: str = ''
    known: tuple[str, ...] = ()
    form: Callable[[Any], Any] | None = None

    def build(self, parameters: Any) -> Mechanics:
        """Return the model with these numbers."""
        return Mechanics(self.form(parameters) if self.form else parameters, self.name)

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of the parameters that `identify` finds."""
        return tuple(name for name in declared(self.parameters) if name not in self.known)


def assignments_of(model: Model, parameters: Any) -> tuple[str, ...]:
    """Return the 'parameter=value' texts that `load` takes for these parameters."""
    return tuple(
        f'{name}={getattr(parameters, name)!r}'.replace("'", '')
        for name in declared(model.parameters)
        if getattr(parameters, name) is not None
    )
