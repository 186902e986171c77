# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""HGO: the high-gain observer of a mechanism.

    x1h' = x2h + L e,   x2h' = M(y)^-1 [G u - dV/dq - C(y, x2h) x2h - D x2h] + K e,   e = y - x1h

With L = h1/eps and K = h2/eps^2 it is the paper's (21). It does not need Psi, so it works for every
mechanism. Its error grows with the speed, through C.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator_pkg.circle import Circle
from estimator_pkg.errors import UsageError
from estimator_pkg.models import check
from estimator_pkg.models.load import load
from estimator_pkg.models.mechanics import Array, solved
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.tracking import natural_frequency
from estimator_pkg.observers.mechanism import gains as mechanical_gains
from estimator_pkg.observers.mechanism.observer import Core, LinearObserver
from estimator_pkg.observers.mechanism.parameters import (
    LoopGains,
    MechanicalGains,
    gain_matrix,
    operating_point,
)
from estimator_pkg.parameters import parameter

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Gains(MechanicalGains, LoopGains):
    """Parameters of `hgo`."""

    K: tuple[float, ...] | None = parameter(
        None,
        unit='1/s^2',
        kind=list,
        range=(-1e12, 1e12),
        advanced=True,
        description='gain of the velocity: one number, one per position, or a matrix row by row; '
        'automatic: from h, or from bandwidth_hz and damping',
    )
    h: tuple[float, ...] | None = parameter(
        None,
        kind=list,
        range=(0.0, 1e9),
        advanced=True,
        description="the paper's h1, h2, used with epsilon instead of L and K; automatic: not used",
        equation='L = h1/epsilon, K = h2/epsilon^2',
    )
    epsilon: float = parameter(
        1.0, unit='s', range=(1e-9, 1e3), advanced=True, description="the paper's epsilon"
    )


class HighGain(LinearObserver):
    """An observer whose state is the velocity, with its gains: hgo and ehgo.

    It needs M, C and the forces, but not Psi. Its error contains C(q, vh) vh - C(q, v) v. Each
    shape is that of `MechanismObserver`.
    """

    complaint = "the error does not decay with these gains: 'L' and 'K' must be positive definite"

    def __init__(self, gains: Any, circle: Circle) -> None:
        mechanics = load(gains.model, gains.model_parameters)
        super().__init__(gains, mechanics, circle)
        self.L, self.K, self.E = self.tuned(gains, mechanics.degrees)
        points = [operating_point(gains, mechanics)]
        if mechanics.damped:
            points += [q for q, _ in check.random_states(mechanics)]
        self._use(points, float(np.max(np.diag(self.L) / np.diag(self.K))))
        slowest = mechanical_gains.slowest_pole(self.systems[0])
        if slowest <= 0.0:
            raise UsageError(f'{self.complaint} (slowest pole {-slowest:+.3g} 1/s)')

    def tuned(self, gains: Any, n: int) -> tuple[Array, Array, Array | None]:
        """Return the gain matrices (L [1/s], K [1/s^2], E [1/s^3]), shape (n, n).

        Raises
        ------
        UsageError : gains of wrong size, or set twice.
        """
        raise NotImplementedError

    def system(self, at: Array, core: Core, u: Array, dt: float) -> tuple[Array, Array]:
        """Return A and f = M^-1 [force - C v] of (21) and (25) at the positions `at`.

        Damping is in A: an explicit step of it would be unstable if friction stops a joint within a
        sample.
        """
        force, damping = self.forces(at, core.v, u, dt)
        force = force - self.mechanics.coriolis(at, core.v)
        right = np.concatenate([force[..., None], damping], axis=-1)
        found = solved(self.mechanics.inertia(at), right)
        return self._joined(found[..., 1:]), found[..., 0]

    def _joined(self, decay: Array) -> Array:
        one = np.eye(len(self.L))
        return self.joined(one, self.K, decay, one)

    def linear(self, at: Array, power: Array) -> tuple[Array, Array]:
        """Return (A, V), without Coriolis forces; see `MechanismObserver`."""
        decay = solved(self.mechanics.inertia(at), self.mechanics.damping(at))
        return self._joined(decay), np.eye(len(self.L))

    def describe(self, dt: float) -> dict[str, Any]:
        """Return properties of the gains by name."""
        return mechanical_gains.describe_loop(self.L, self.K, self.systems, dt)


class Hgo(HighGain):
    """HGO with its gains; see `HighGain`."""

    def tuned(self, gains: Gains, n: int) -> tuple[Array, Array, Array | None]:
        """Return the gain matrices, shape (n, n)."""
        slow, eye = TURN * gains.disturbance_hz, np.eye(n)
        if gains.h is not None:
            if gains.L is not None or gains.K is not None:
                raise UsageError("'h' is set together with 'L' or 'K': set 'h', or 'L' and 'K'")
            if len(gains.h) != 2:
                raise UsageError(
                    f"parameter 'h' has {len(gains.h)} numbers: 'hgo' takes 2, h1 and h2"
                )
            L, K = eye * gains.h[0] / gains.epsilon, eye * gains.h[1] / gains.epsilon**2
        elif gains.L is not None or gains.K is not None:
            if gains.L is None or gains.K is None:
                raise UsageError("only one of 'L' and 'K' is set: set both")
            L, K = gain_matrix('L', gains.L, n), gain_matrix('K', gains.K, n)
        else:
            omega = natural_frequency(gains.bandwidth_hz, gains.damping)
            middle = 2.0 * gains.damping * omega
            L, K = eye * (middle + slow), eye * (omega**2 + middle * slow)
            return L, K, eye * omega**2 * slow if slow > 0.0 else None
        return L, K, K * slow if slow > 0.0 else None


class HgoObserver(Observer):
    """The entry point of `hgo`."""

    name = 'hgo'
    summary = 'high-gain observer of any mechanism with known model and input'
    reference = 'Lee, Mukherjee, Khalil (2015); (21) of Aranovskiy et al. (IJC 2019)'
    kind = 'mechanical'
    gains = Gains
    plan = Hgo
