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
from estimator_pkg.parameters import Parameter, build, declared

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unknowns:
    """A model with some of its parameters unknown.

    Attributes
    ----------
    names, units : of the unknown parameters.
    start, lowest, highest : shape (p,).
    make : (parameters) -> the model with them; raises UserError if they are invalid.
    texts : (parameters) -> the assignments that `model_parameters` takes.
    """

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
    about: Mapping[str, Parameter] = {}
    if ':' in name:
        first = numbers_of(instance(name, {**fixed, **start}), name)
        if not first:
            raise UsageError(
                f"model '{name}' lists no parameters to identify: "
                "add an attribute 'parameters' with their names"
            )
    else:
        record = registry.find(registry.MODELS, name)
        if not isinstance(record, Model) or not record.identified:
            raise UsageError(f"model '{name}' has no parameters that can be identified")
        for key in start:
            if key not in record.identified:
                hint = suggestion(key, record.identified)
                raise UsageError(f"'{key}' of model '{name}' is not identified: {hint}")
        about = declared(record.parameters)
        whole: Any = build(record.parameters, {**fixed, **start}, owner=f"model '{name}'")
        first = {key: float(getattr(whole, key)) for key in record.identified}
    names = tuple(key for key in first if key not in fixed)
    if not names:
        raise UsageError(
            f"model '{name}' has no unknown parameter: --set fixes all; omit some of them"
        )

    def values(numbers: Array) -> dict[str, Any]:
        return {**fixed, **dict(zip(names, numbers.tolist()))}

    def make(numbers: Array) -> Mechanics:
        if about:
            return record.build(build(record.parameters, values(numbers), owner=f"model '{name}'"))
        made = Mechanics(instance(name, values(numbers)), name)
        made.trusted = True
        return made

    def texts(numbers: Array) -> tuple[str, ...]:
        if about:
            return assignments_of(record, build(record.parameters, values(numbers)))
        return tuple(f'{key}={float(value)!r}' for key, value in values(numbers).items())

    def bounds(end: str, usual: float) -> Array:
        found = [getattr(about[key], end) if about else None for key in names]
        return np.array([usual if each is None else float(each) for each in found])

    return Unknowns(
        names,
        tuple(about[key].unit if about else '' for key in names),
        np.array([first[key] for key in names]),
        bounds('minimum', -np.inf),
        bounds('maximum', np.inf),
        make,
        texts,
    )
