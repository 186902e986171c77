# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Everything that follows from gains and model of the observer `switched`, computed once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from estimator_pkg.errors import UsageError
from estimator_pkg.models.switched import SwitchedModel, check, load
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.maths.vectors import dot
from estimator_pkg.observers.switched.gains import Gains

LAMBDA, ALPHA = 1.5, 1.1  # lambda = 1.5 sqrt(L), alpha = 1.1 L


@dataclass(frozen=True)
class System:
    """A switched system and the fixed parts of its observer.

    Attributes
    ----------
    stages : (lambda, alpha) of each stage, by output.
    columns : first columns of the regression filters, by output.
    orders : `orders` of the model; zeros if the model has none.
    """

    gains: Gains
    model: SwitchedModel
    circle: Circle
    stages: tuple[tuple[tuple[float, float], ...], ...]
    columns: tuple[tuple[float, ...], ...]
    orders: tuple[tuple[int, ...], ...]

    @property
    def is_implicit(self) -> bool:
        """True if the stages are discretised implicitly."""
        return self.gains.form == 'implicit'

    @property
    def is_filtered(self) -> bool:
        """True if the extended observers give the published velocity."""
        return self.gains.velocity == 'filtered'

    @property
    def is_regression(self) -> bool:
        """True if least squares estimates Z."""
        return self.gains.discrete == 'regression'

    @property
    def period(self) -> float:
        """Wrap period of every output [rad]; 0: none."""
        return float(self.circle.period)

    @property
    def outputs(self) -> range:
        """Indices of the outputs."""
        return range(len(self.model.indices))

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.model.probe(0.0))

    def chains(self, state: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return (zeta, last derivative of each chain) of the super-twisting stages."""
        zeta: list[float] = []
        for i in self.outputs:
            zeta += [state.y[i], *state.zt[i][:-1]]
        return tuple(zeta), tuple(zt[-1] for zt in state.zt)

    def signals(self, y: tuple, u: tuple, zeta: tuple) -> tuple:
        """Return for each output Gamma, then the columns of Lambda (or their antiderivatives)."""
        if self.model.basis is not None:
            return tuple(tuple(float(x) for x in row) for row in self.model.basis(y, u))
        return tuple(
            (float(g), *map(float, row))
            for g, row in zip(self.model.gamma(zeta, u), self.model.lam(zeta, u))
        )

    def ending(self, zeta: tuple, u: tuple, z: tuple) -> tuple[float, ...]:
        """Return Gamma + Lambda Z, the last derivative of each chain (9)."""
        return tuple(
            float(g) + dot(tuple(map(float, row)), z)
            for g, row in zip(self.model.gamma(zeta, u), self.model.lam(zeta, u))
        )


@lru_cache(maxsize=16)
def _sound(name: str, steps: int | None) -> SwitchedModel:
    """Return the model of this name; it is checked once, because that takes half a second."""
    model = load(name)
    check(model, steps)
    return model


def make_system(gains: Gains, circle: Circle) -> System:
    """Return the system of these gains.

    Raises
    ------
    UsageError : the model is invalid, its rank condition is never met with these `steps`, or the
        memory is too short.
    """
    model = _sound(gains.model, None if gains.discrete == 'copy' else gains.steps)
    if 0.0 < gains.memory < 1.0 / gains.filter_rate:
        raise UsageError(
            f"parameter 'memory' = {gains.memory:g} s is shorter than the filter's time constant: "
            f'set 0, or at least {1.0 / gains.filter_rate:.3g} s'
        )
    scale, rate = gains.bound_scale, gains.filter_rate
    orders = model.orders or tuple((0,) * (model.size + 1) for _ in model.indices)
    if any(order > 1 or order >= k for own, k in zip(orders, model.indices) for order in own):
        raise UsageError(
            f"model '{gains.model}': 'orders' = {orders} has an entry that is too large: each must "
            'be 0, or 1 where the chain is longer than 1'
        )
    return System(
        gains,
        model,
        circle,
        tuple(
            tuple((LAMBDA * math.sqrt(scale * bound), ALPHA * scale * bound) for bound in own)
            for own in model.bounds
        ),
        tuple(
            tuple(-math.comb(k, i + 1) * rate ** (i + 1) for i in range(k)) for k in model.indices
        ),
        orders,
    )
