# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A mechanical model by its name: a built-in one, or a user's own; checked before it is used."""

from __future__ import annotations

from estimator_pkg import registry
from estimator_pkg.errors import UsageError
from estimator_pkg.models.check import check
from estimator_pkg.models.mechanics import Mechanics, Model
from estimator_pkg.models.own import from_user, guarded
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
        mechanics = from_user(name, values)
        check(mechanics)
        return guarded(mechanics)
    model: Model = registry.find(registry.MODELS, name)
    if not isinstance(model, Model):
        raise UsageError(
            f"model '{name}' is not a mechanical model: see 'velocity_estimator list' for those"
        )
    mechanics = model.build(build(model.parameters, values, owner=f"model '{name}'"))
    check(mechanics)
    return mechanics
