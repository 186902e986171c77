# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The parameters of a model that `identify` can fit: start values and bounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import registry
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.models.load import instance
from estimator_pkg.models.load import numbers as numbers_of
from estimator_pkg.models.mechanics import Mechanics, Model, assignments_of
from estimator_pkg.parameters import build, declared

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unknowns:
    """A model with some of its parameters unknown.

    Attributes
    ----------
    model : as users write it.
    names, units : of the unknown parameters.
    start, lowest, highest : shape (p,).
    make : (parameters) -> the model with them; raises UserError if they are invalid.
    texts : (parameters) -> the assignments that `model_parameters` takes.
    """

    model: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    start: Array
    lowest: Array
    highest: Array
    make: Callable[[Array], Mechanics]
    texts: Callable[[Array], tuple[str, ...]]


def unknowns(name: str, fixed: Mapping[str, Any], start: Mapping[str, Any]) -> Unknowns:
    """Return the unknowns of a built-in model, or of a user's own.

    Parameters
    ----------
    fixed : fixed parameters with known values.
    start : start values; the others start from the model's own.

    Raises
    ------
    UsageError : no such model, no such parameter, or no unknown parameter.
    """
    both = set(fixed) & set(start)
    if both:
        raise UsageError(f"'{both.pop()}' is in both --set and --start: omit one")
    found = _own(name, fixed, start) if ':' in name else _built_in(name, fixed, start)
    if not found.names:
        raise UsageError(
            f"model '{name}' has no unknown parameter: --set fixes all; omit some of them"
        )
    return found


def _built_in(name: str, fixed: Mapping[str, Any], start: Mapping[str, Any]) -> Unknowns:
    record = registry.find(registry.MODELS, name)
    if not isinstance(record, Model) or not record.identified:
        raise UsageError(f"model '{name}' has no parameters that can be identified")
    about = declared(record.parameters)
    for key in start:
        if key not in record.identified:
            raise UsageError(
                f"'{key}' of model '{name}' is not identified: {suggestion(key, record.identified)}"
            )
    first: Any = build(record.parameters, {**fixed, **start}, owner=f"model '{name}'")
    names = tuple(key for key in record.identified if key not in fixed)

    def parameters(numbers: Array) -> Any:
        values = dict(zip(names, numbers.tolist()))
        return build(record.parameters, {**fixed, **values}, owner=f"model '{name}'")

    return Unknowns(
        name,
        names,
        tuple(about[key].unit for key in names),
        np.array([float(getattr(first, key)) for key in names]),
        np.array([_bound(about[key].minimum, -np.inf) for key in names]),
        np.array([_bound(about[key].maximum, np.inf) for key in names]),
        lambda numbers: record.build(parameters(numbers)),
        lambda numbers: assignments_of(record, parameters(numbers)),
    )


def _own(path: str, fixed: Mapping[str, Any], start: Mapping[str, Any]) -> Unknowns:
    first = numbers_of(instance(path, {**fixed, **start}), path)
    if not first:
        raise UsageError(
            f"model '{path}' lists no parameters to identify: "
            "add an attribute 'parameters' with their names"
        )
    names = tuple(key for key in first if key not in fixed)

    def make(numbers: Array) -> Mechanics:
        values = {**fixed, **dict(zip(names, numbers.tolist()))}
        made = Mechanics(instance(path, values), path)
        made.trusted = True
        return made

    def texts(numbers: Array) -> tuple[str, ...]:
        return tuple(
            f'{key}={float(value)!r}'
            for key, value in {**fixed, **dict(zip(names, numbers.tolist()))}.items()
        )

    size = len(names)
    return Unknowns(
        path,
        names,
        ('',) * size,
        np.array([first[key] for key in names]),
        np.full(size, -np.inf),
        np.full(size, np.inf),
        make,
        texts,
    )


def _bound(value: float | None, usual: float) -> float:
    return usual if value is None else float(value)
