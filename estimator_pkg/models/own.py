"""A user's own model, named as ``package.module:Name``: ordinary Python with numpy.

The class (or an object) gives what docs/own_model.md lists. It is called with numpy arrays, and its
answers become tuples here, so that it works in every observer and simulator. A model that says
``compiles = True`` is called with tuples of floats instead, answers with tuples, and is compiled
where everything else is.
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
DERIVATIVE_STEP = 1e-6  # of the Christoffel symbols, where the model gives no Coriolis forces


def from_user(path: str, values: Mapping[str, Any] | None = None) -> Mechanics:
    """The model at ``package.module:Name``, with these of its declared numbers.

    Raises
    ------
    UsageError : it cannot be imported (the module is named), or a number is none of its own.
    UserError : something is missing in it.
    """
    model = instance(path, values)
    if isinstance(model, Mechanics):
        return model
    mechanics = mechanics_of(model, path)
    if mechanics.factors is None and not mechanics.compiles:
        return _with_found_factors(mechanics)
    return mechanics


def instance(path: str, values: Mapping[str, Any] | None = None) -> Any:
    """The user's object, with these numbers as attributes; raises as `from_user`."""
    named = load_object(path)
    try:
        model = named() if isinstance(named, type) else copy.copy(named)
    except Exception as error:  # a user's class may fail in any way
        raise UserError(
            f"model '{path}' cannot be made: {type(error).__name__}: {error}"
        ) from error
    known = numbers(model, path)
    for name, value in (values or {}).items():
        if not known:
            raise UsageError(
                f"model '{path}' takes no 'model_parameters': its numbers stand in "
                "its own module, and no attribute 'parameters' names them"
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
    """The numbers that the model's attribute `parameters` names, with their values now.

    None of a model that compiles: what it computes with is settled when it is compiled.

    Raises
    ------
    UserError : one of them is not there, or is no number.
    """
    found: dict[str, float] = {}
    if getattr(model, 'compiles', False):
        return found
    for name in getattr(model, 'parameters', ()):
        try:
            found[str(name)] = float(getattr(model, name))
        except (AttributeError, TypeError, ValueError) as error:
            raise UserError(
                f"model '{path}': its 'parameters' name '{name}', which is no number of it"
            ) from error
    return found


def mechanics_of(model: Any, path: str) -> Mechanics:
    """The functions around the user's object; raises UserError, UsageError."""
    needed = COMPILED if getattr(model, 'compiles', False) else NEEDED
    missing = [name for name in needed if not hasattr(model, name)]
    if missing:
        raise UserError(f"model '{path}' has no {missing[0]}: it must give {', '.join(needed)}")
    if isinstance(model.joints, str) or not isinstance(model.joints, Iterable):
        raise UserError(f"model '{path}': joints must be a list of names, not {model.joints!r}")
    joints = tuple(str(name) for name in model.joints)
    if not joints:
        raise UsageError(f"model '{path}' names no joint")
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
    """The model with Psi = the lower Cholesky factor of M^-1, where that makes it PLvCC.

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
    """The model with every failure of the user's code as nan, which the observers flag.

    The last failure is what `complaint` says. A model that compiles is left as it is.
    """
    if mechanics.compiles:
        return mechanics
    n, said = mechanics.degrees, ['']
    row = (math.nan,) * n

    def around(function: Any, instead: Any) -> Any:
        if function is None:
            return None

        def safe(*arguments: Any) -> Any:
            try:
                return function(*arguments)
            except Exception as error:  # a user's code may fail in any way
                said[0] = f'{type(error).__name__}: {error}'
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
        complaint=lambda: said[0],
    )


def _numbers(model: Any, path: str, name: str, count: int, usual: float) -> tuple[float, ...]:
    given = getattr(model, name, (usual,) * count)
    values = tuple(float(value) for value in np.atleast_1d(given))
    if len(values) != count:
        raise UserError(f"model '{path}': {name} has {len(values)} numbers for {count} joints")
    return values


def _vector(value: Any) -> tuple[float, ...]:
    return tuple(np.asarray(value, float).ravel().tolist())


def _matrix(value: Any) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in np.atleast_2d(np.asarray(value, float)).tolist())


def _ordinary(model: Any, count: int) -> dict[str, Any]:
    """The functions around methods that take and give numpy arrays."""
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
        return _vector(given(array(q), array(v)))

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
    given = getattr(model, 'coriolis', None) or _christoffel(model, count)
    return {
        'inertia': inertia,
        'force': force,
        'coriolis': coriolis,
        'factors': factors if hasattr(model, 'psi') else None,
        'damping': damping if hasattr(model, 'damping') else None,
        'admits': admits if hasattr(model, 'admits') else everywhere,
    }


def _christoffel(model: Any, count: int) -> Callable[..., Any]:
    """C v from the mass matrix by central differences, where the model does not give it."""

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
    """The functions of a model in the compilable subset: module-level functions of (q, ...)."""
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
