# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A user's own model, named as ``package.module:Name``: ordinary Python with numpy.

docs/known_inputs.md lists what the class (or object) must define. It is called with numpy arrays.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.models import check
from estimator_pkg.models.mechanics import Mechanics, everywhere, no_damping, no_factors
from estimator_pkg.registry import load as load_object

NEEDED = ('joints', 'inertia', 'gradient', 'inputs')
FORCES = ('joints', 'inertia', 'force')
DERIVATIVE_STEP = 1e-6  # step of the Christoffel symbols, for a model without Coriolis forces


def from_user(path: str, values: Mapping[str, Any] | None = None) -> Mechanics:
    """Return the model at ``package.module:Name``, with these values of its parameters.

    Raises
    ------
    UsageError : it cannot be imported (the message names the module), or has no such parameter.
    UserError : a required attribute is missing.
    """
    model = instance(path, values)
    if isinstance(model, Mechanics):
        return model
    mechanics = mechanics_of(model, path)
    return mechanics if mechanics.linearisable else _with_found_factors(mechanics)


def instance(path: str, values: Mapping[str, Any] | None = None) -> Any:
    """Return the user's object, with these values as attributes; raises as `from_user`."""
    named = load_object(path)
    try:
        model = named() if isinstance(named, type) else copy.copy(named)
    except Exception as error:  # a user's class may fail in any way
        raise UserError(
            f"model '{path}' cannot be created: {type(error).__name__}: {error}"
        ) from error
    known = numbers(model, path)
    for name, value in (values or {}).items():
        if not known:
            raise UsageError(
                f"model '{path}' takes no 'model_parameters': list its parameters in an "
                "attribute 'parameters', or set them in its module"
            )
        if name not in known:
            raise UsageError(f"model '{path}' has no parameter '{name}': {suggestion(name, known)}")
        if (
            isinstance(value, bool)
            or not isinstance(value, (int, float))
            or not math.isfinite(value)
        ):
            raise UsageError(
                f"parameter '{name}' of model '{path}' must be a number, not {value!r}"
            )
        setattr(model, name, float(value))
    return model


def numbers(model: Any, path: str) -> dict[str, float]:
    """Return the current values of the parameters that the attribute `parameters` lists.

    Raises
    ------
    UserError : one of them does not exist, or is not a number.
    """
    found: dict[str, float] = {}
    for name in getattr(model, 'parameters', ()):
        try:
            found[str(name)] = float(getattr(model, name))
        except (AttributeError, TypeError, ValueError) as error:
            raise UserError(
                f"model '{path}': 'parameters' lists '{name}', which is not a numeric attribute"
            ) from error
    return found


def mechanics_of(model: Any, path: str) -> Mechanics:
    """Return the user's object as `Mechanics`; raise UserError or UsageError."""
    needed = FORCES if hasattr(model, 'force') else NEEDED
    missing = [name for name in needed if not hasattr(model, name)]
    if missing:
        raise UserError(f"model '{path}' has no {missing[0]}: it must define {', '.join(needed)}")
    if isinstance(model.joints, str) or not isinstance(model.joints, Iterable):
        raise UserError(f"model '{path}': joints must be a list of names, not {model.joints!r}")
    joints = tuple(str(name) for name in model.joints)
    if not joints:
        raise UsageError(f"model '{path}': joints is empty: name at least one")
    count = len(joints)
    actuated = tuple(int(index) for index in getattr(model, 'actuated', range(count)))
    if any(not 0 <= index < count for index in actuated):
        raise UsageError(f"model '{path}': 'actuated' names joint {max(actuated)} of {count}")
    return Mechanics(
        name=path,
        joints=joints,
        values=(),
        actuated=actuated,
        periods=_numbers(model, path, 'periods', count, 2.0 * np.pi),
        centre=_numbers(model, path, 'centre', count, 0.0),
        reach=_numbers(model, path, 'reach', count, 1.0),
        model=OwnModel(model, path, count, len(actuated)),
        linearisable=hasattr(model, 'psi') or hasattr(model, 'factors'),
        damped=hasattr(model, 'damping'),
        speed_matters=hasattr(model, 'friction'),
    )


class OwnModel:
    """A user's object with the functions of a model, see `Mechanics.model`.

    Attributes
    ----------
    JOINTS, INPUTS : their numbers. failure : the last failure of the user's code, or ''.
    """

    def __init__(self, model: Any, path: str, joints: int, inputs: int) -> None:
        self.JOINTS, self.INPUTS, self.failure = joints, inputs, ''
        self._model, self._path = model, path
        self._friction = getattr(model, 'friction', None)
        self._calm = getattr(model, 'calm', None)
        self._coriolis = getattr(model, 'coriolis', None) or self._christoffel
        if hasattr(model, 'force'):
            setattr(self, '_force', model.force)  # noqa: B010
        for name, absent in (('damping', no_damping), ('admits', everywhere)):
            if not hasattr(model, name):
                setattr(self, name, absent)
        if not (hasattr(model, 'psi') or hasattr(model, 'factors')):
            setattr(self, 'factors', no_factors)  # noqa: B010

    def inertia(self, out: Any, values: Any, q: Any) -> None:
        """Set M."""
        self._set(out, 'inertia', self._model.inertia(self._array(q)))

    def force(self, out: Any, values: Any, q: Any, v: Any, u: Any) -> None:
        """Set all forces but damping and Coriolis ones."""
        at, speed = self._array(q), self._array(v)
        total = self._force(at, speed, self._array(u, self.INPUTS))
        self._set(out, 'force', total, flat=True)

    def _force(self, q: Any, v: Any, u: Any) -> Any:
        total = np.asarray(self._model.inputs(q), float) @ u - self._model.gradient(q)
        return total if self._friction is None else total - self._friction(v)

    def coriolis(self, out: Any, values: Any, q: Any, v: Any) -> None:
        """Set C v."""
        self._set(out, 'coriolis', self._coriolis(self._array(q), self._array(v)), flat=True)

    def damping(self, out: Any, values: Any, q: Any) -> None:
        """Set D."""
        self._set(out, 'damping', self._model.damping(self._array(q)))

    def admits(self, values: Any, q: Any) -> bool:
        """Return False where the model must not be used."""
        return bool(self._model.admits(self._array(q)))

    def factors(self, calm: Any, psi: Any, values: Any, q: Any) -> None:
        """Set calM and Psi."""
        at = self._array(q)
        if hasattr(self._model, 'factors'):
            found, of_psi = self._model.factors(at)
        else:
            of_psi = np.asarray(self._model.psi(at), float)
            if self._calm is not None:
                found = self._calm(at)
            else:
                found = np.linalg.inv(of_psi.T @ np.asarray(self._model.inertia(at), float))
        self._set(calm, 'calM', found)
        self._set(psi, 'Psi', of_psi)

    def _array(self, values: Any, count: int | None = None) -> Any:
        """Return the first `count` numbers (one per joint) as the user's code takes them."""
        return np.array(values[: self.JOINTS if count is None else count])

    def _set(self, out: Any, name: str, value: Any, flat: bool = False) -> None:
        """Set a vector (`flat`) or a matrix; raise UserError if it has other dimensions."""
        n = self.JOINTS
        wanted: tuple[int, ...] = (n,) if flat else (n, n)
        try:
            found: NDArray[np.float64] = np.asarray(value, float)
        except ValueError:
            self._refuse(name, 'ragged', wanted)
        found = found.ravel() if flat else np.atleast_2d(found)
        if found.shape != wanted:
            self._refuse(name, found.shape, wanted)
        for k, item in enumerate(found.tolist()):
            if flat:
                out[k] = item
            else:
                out[k][:n] = item

    def _refuse(self, name: str, found: Any, wanted: tuple[int, ...]) -> NoReturn:
        raise UserError(
            f"model '{self._path}' of {self.JOINTS} joints and {self.INPUTS} inputs: {name} has "
            f'dimensions {found}, not {wanted}'
        )

    def _christoffel(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return C v from the mass matrix by central differences."""
        count, inertia = self.JOINTS, self._model.inertia
        turning, energy = np.zeros((count, count)), np.zeros(count)
        for index in range(count):
            step = np.zeros(count)
            step[index] = DERIVATIVE_STEP
            slope = (
                np.asarray(inertia(q + step), float) - np.asarray(inertia(q - step), float)
            ) / (2.0 * DERIVATIVE_STEP)
            turning += v[index] * slope
            energy[index] = 0.5 * v @ slope @ v
        return turning @ v - energy


class _Found(OwnModel):
    """Psi = the lower Cholesky factor of M^-1."""

    def factors(self, calm: Any, psi: Any, values: Any, q: Any) -> None:
        """Set calM and Psi, which are the same."""
        inertia = np.atleast_2d(np.asarray(self._model.inertia(self._array(q)), float))
        found = np.linalg.cholesky(np.linalg.inv(inertia))
        self._set(calm, 'calM', found)
        self._set(psi, 'Psi', found)


def _with_found_factors(mechanics: Mechanics) -> Mechanics:
    """Return the model with Psi = the lower Cholesky factor of M^-1, if that makes it PLvCC.

    It does for every constant M, for every single joint, and for a mechanism such as the
    cart-pendulum.
    """
    own = mechanics.model
    made = _Found(own._model, own._path, own.JOINTS, own.INPUTS)
    made.__dict__.pop('factors', None)
    candidate = replace(mechanics, model=made, linearisable=True)
    try:
        check.check(candidate)
    except (UserError, np.linalg.LinAlgError):
        return mechanics
    return candidate


class Guarded:
    """An own model with NaN instead of every failure of the user's code; observers flag it."""

    def __init__(self, model: OwnModel) -> None:
        self.JOINTS, self.INPUTS, self.failure = model.JOINTS, model.INPUTS, ''
        for name in ('inertia', 'factors', 'force', 'coriolis', 'damping'):
            setattr(self, name, self._around(getattr(model, name)))
        self._admits = model.admits

    def admits(self, values: Any, q: Any) -> bool:
        """Return False where the model must not be used, or cannot be."""
        try:
            return bool(self._admits(values, q))
        except Exception as error:  # a user's code may fail in any way
            self.failure = f'{type(error).__name__}: {error}'
            return False

    def _around(self, function: Callable[..., None]) -> Callable[..., None]:
        def safe(*arguments: Any) -> None:
            try:
                function(*arguments)
            except Exception as error:  # a user's code may fail in any way
                self.failure = f'{type(error).__name__}: {error}'
                for out in arguments[: 2 if function.__name__ == 'factors' else 1]:
                    for k in range(self.JOINTS):
                        out[k] = [math.nan] * len(out) if isinstance(out[k], list) else math.nan

        return safe


def guarded(mechanics: Mechanics) -> Mechanics:
    """Return the model with NaN instead of every failure of the user's code.

    `complaint` returns the last failure.
    """
    if not isinstance(mechanics.model, OwnModel):
        return mechanics
    safe = Guarded(mechanics.model)
    return replace(mechanics, model=safe, complaint=lambda: safe.failure)


def _numbers(model: Any, path: str, name: str, count: int, usual: float) -> tuple[float, ...]:
    provided = getattr(model, name, (usual,) * count)
    values = tuple(float(value) for value in np.atleast_1d(provided))
    if len(values) != count:
        raise UserError(f"model '{path}': {name} has {len(values)} numbers for {count} joints")
    return values
