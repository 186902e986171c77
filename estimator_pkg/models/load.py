# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A mechanical model by its name: a built-in one, or a user's own; checked before it is used.

A user's own is named as ``package.module:Name``: ordinary Python with numpy. docs/known_inputs.md
lists what the class (or object) must define.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any

from estimator_pkg import registry
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.models.check import check
from estimator_pkg.models.mechanics import Mechanics, Model
from estimator_pkg.parameters import build, parse_assignments


def load(name: str, assignments: tuple[str, ...] = ()) -> Mechanics:
    """Return the model `name`, checked (see `estimator_pkg.models.check`).

    Parameters
    ----------
    name : a built-in model, or a user's own as ``package.module:Name``.
    assignments : 'parameter=value'; for a user's model, the names in its `parameters`.

    Raises
    ------
    UsageError : no such model, or a wrong parameter.
    UserError : a user's model cannot be imported, or fails the check; the message has the residual.
    """
    values = parse_assignments(list(assignments))
    if ':' in name:
        mechanics = Mechanics(instance(name, values), name)
    else:
        model: Model = registry.find(registry.MODELS, name)
        if not isinstance(model, Model):
            raise UsageError(
                f"model '{name}' is not a mechanical model: see 'velocity_estimator list' for those"
            )
        mechanics = model.build(build(model.parameters, values, owner=f"model '{name}'"))
    check(mechanics)
    mechanics.trusted = True
    return mechanics


def instance(path: str, values: Mapping[str, Any] | None = None) -> Any:
    """Return the user's object, with these values of its parameters as attributes.

    Raises
    ------
    UsageError : it cannot be imported (the message names the module), or has no such parameter.
    UserError : it cannot be created.
    """
    named = registry.load(path)
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
