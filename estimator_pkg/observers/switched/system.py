# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The user's model: how the observer finds it, and its signals."""

from __future__ import annotations

from functools import lru_cache
from types import ModuleType

from estimator_pkg.models.switched import SwitchedModel, check, load
from estimator_pkg.observers.maths.vectors import dot


@lru_cache(maxsize=16)
def bound(module: ModuleType, name: str, steps: int) -> ModuleType:
    """Return the observer's module with the model of this name in it, as `model`.

    The model is checked once, because that takes half a second.
    """
    model = load(name)
    check(model, steps)
    made = ModuleType(f'{module.__name__} model={name}')
    vars(made).update({**vars(module), 'model': model, '__name__': made.__name__})
    return made


def signals(model: SwitchedModel, y: tuple, u: tuple, zeta: tuple) -> list[list[float]]:
    """Return for each output Gamma, then the columns of Lambda (or their antiderivatives)."""
    if model.basis is not None:
        return [list(map(float, row)) for row in model.basis(y, u)]
    return [
        [float(g), *map(float, row)] for g, row in zip(model.gamma(zeta, u), model.lam(zeta, u))
    ]


def ending(model: SwitchedModel, zeta: tuple, u: tuple, z: tuple) -> list[float]:
    """Return Gamma + Lambda Z, the last derivative of each chain (9)."""
    return [
        float(g) + dot(tuple(map(float, row)), z)
        for g, row in zip(model.gamma(zeta, u), model.lam(zeta, u))
    ]
