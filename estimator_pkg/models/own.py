# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A user's own model, named as ``package.module:Name``: ordinary Python with numpy.

docs/own_model.md lists what the class (or object) must define. It is called with numpy arrays, and
its results become tuples here, so that it works in every observer and simulator. A model with
``compiles = True`` is called with tuples of floats instead, returns tuples, and is compiled like
the built-in ones.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.models import check
from estimator_pkg.models.mechanics import Mechanics, everywhere
from estimator_pkg.registry import load as load_object

NEEDED = ('joints', 'inertia', 'gradient', 'inputs')
COMPILED = ('joints', 'inertia', 'force', 'coriolis')
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
    if mechanics.factors is None and not mechanics.compiles:
        return _with_found_factors(mechanics)
    return mechanics


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

    A model that compiles has none, because compiling fixes them.

    Raises
    ------
    UserError : one of them does not exist, or is not a number.
    """
    found: dict[str, float] = {}
    if getattr(model, 'compiles', False):
        return found
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
    needed = COMPILED if getattr(model, 'compiles', False) else NEEDED
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
    if getattr(model, 'compiles', False):
        parts = _compilable(model)
    else:
        parts = _ordinary(model, count)
    return Mechanics(
        name=path,
        joints=joints,
        values=(0.0,),
        actuated=actuated,
        periods=_numbers(model, path, 'periods', count, 2.0 * np.pi),
        centre=_numbers(model, path, 'centre', count, 0.0),
        reach=_numbers(model, path, 'reach', count, 1.0),
        speed_matters=hasattr(model, 'friction'),
        compiles=bool(getattr(model, 'compiles', False)),
        **parts,
    )


def _with_found_factors(mechanics: Mechanics) -> Mechanics:
    """Return the model with Psi = the lower Cholesky factor of M^-1, if that makes it PLvCC.

    It does for every constant M, for every single joint, and for a mechanism such as the
    cart-pendulum.
    """

    def factors(values: tuple, q: tuple) -> tuple:
        psi = np.linalg.cholesky(np.linalg.inv(np.array(mechanics.inertia(values, q))))
        return _matrix(psi), _matrix(psi)

    candidate = replace(mechanics, factors=factors)
    try:
        check.check(candidate)
    except (UserError, np.linalg.LinAlgError):
        return mechanics
    return candidate


def guarded(mechanics: Mechanics) -> Mechanics:
    """Return the model with NaN instead of every failure of the user's code; observers flag it.

    `complaint` returns the last failure. A model that compiles is unchanged.
    """
    if mechanics.compiles:
        return mechanics
    n, failure = mechanics.degrees, ['']
    row = (math.nan,) * n

    def around(function: Any, instead: Any) -> Any:
        if function is None:
            return None

        def safe(*arguments: Any) -> Any:
            try:
                return function(*arguments)
            except Exception as error:  # a user's code may fail in any way
                failure[0] = f'{type(error).__name__}: {error}'
                return instead

        return safe

    return replace(
        mechanics,
        inertia=around(mechanics.inertia, (row,) * n),
        factors=around(mechanics.factors, ((row,) * n, (row,) * n)),
        force=around(mechanics.force, row),
        coriolis=around(mechanics.coriolis, row),
        damping=around(mechanics.damping, (row,) * n),
        admits=around(mechanics.admits, False),
        complaint=lambda: failure[0],
    )


def _numbers(model: Any, path: str, name: str, count: int, usual: float) -> tuple[float, ...]:
    provided = getattr(model, name, (usual,) * count)
    values = tuple(float(value) for value in np.atleast_1d(provided))
    if len(values) != count:
        raise UserError(f"model '{path}': {name} has {len(values)} numbers for {count} joints")
    return values


def _vector(value: Any) -> tuple[float, ...]:
    return tuple(np.asarray(value, float).ravel().tolist())


def _matrix(value: Any) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in np.atleast_2d(np.asarray(value, float)).tolist())


def _ordinary(model: Any, count: int) -> dict[str, Any]:
    """Return the functions for methods that use numpy arrays."""
    array = np.array

    def inertia(values: tuple, q: tuple) -> tuple:
        return _matrix(model.inertia(array(q)))

    def force(values: tuple, q: tuple, v: tuple, u: tuple) -> tuple:
        at = array(q)
        total = np.asarray(model.inputs(at), float) @ array(u) - model.gradient(at)
        if friction is not None:
            total = total - friction(array(v))
        return _vector(total)

    def coriolis(values: tuple, q: tuple, v: tuple) -> tuple:
        return _vector(coriolis_force(array(q), array(v)))

    def admits(values: tuple, q: tuple) -> bool:
        return bool(model.admits(array(q)))

    def damping(values: tuple, q: tuple) -> tuple:
        return _matrix(model.damping(array(q)))

    def factors(values: tuple, q: tuple) -> tuple:
        at = array(q)
        psi = np.asarray(model.psi(at), float)
        if calm is not None:
            return _matrix(calm(at)), _matrix(psi)
        return _matrix(np.linalg.inv(psi.T @ np.asarray(model.inertia(at), float))), _matrix(psi)

    friction = getattr(model, 'friction', None)
    calm = getattr(model, 'calm', None)
    coriolis_force = getattr(model, 'coriolis', None) or _christoffel(model, count)
    return {
        'inertia': inertia,
        'force': force,
        'coriolis': coriolis,
        'factors': factors if hasattr(model, 'psi') else None,
        'damping': damping if hasattr(model, 'damping') else None,
        'admits': admits if hasattr(model, 'admits') else everywhere,
    }


def _christoffel(model: Any, count: int) -> Callable[..., Any]:
    """Return C v from the mass matrix by central differences."""

    def coriolis(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        turning, energy = np.zeros((count, count)), np.zeros(count)
        for index in range(count):
            step = np.zeros(count)
            step[index] = DERIVATIVE_STEP
            slope = (
                np.asarray(model.inertia(q + step), float)
                - np.asarray(model.inertia(q - step), float)
            ) / (2.0 * DERIVATIVE_STEP)
            turning += v[index] * slope
            energy[index] = 0.5 * v @ slope @ v
        return turning @ v - energy

    return coriolis


def _compilable(model: Any) -> dict[str, Any]:
    """Return the functions of a model in the compilable subset: module-level functions of q, ..."""
    inner_inertia, inner_force, inner_coriolis = model.inertia, model.force, model.coriolis
    inner_factors: Any = getattr(model, 'factors', None)
    inner_damping: Any = getattr(model, 'damping', None)
    inner_admits: Any = getattr(model, 'admits', None)

    def inertia(values: tuple, q: tuple) -> tuple:
        return inner_inertia(q)

    def force(values: tuple, q: tuple, v: tuple, u: tuple) -> tuple:
        return inner_force(q, v, u)

    def coriolis(values: tuple, q: tuple, v: tuple) -> tuple:
        return inner_coriolis(q, v)

    def factors(values: tuple, q: tuple) -> tuple:
        return inner_factors(q)

    def damping(values: tuple, q: tuple) -> tuple:
        return inner_damping(q)

    def admits(values: tuple, q: tuple) -> bool:
        return inner_admits(q)

    return {
        'inertia': inertia,
        'force': force,
        'coriolis': coriolis,
        'factors': factors if inner_factors is not None else None,
        'damping': damping if inner_damping is not None else None,
        'admits': admits if inner_admits is not None else everywhere,
    }
