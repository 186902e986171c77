# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""GESO: the globally exponentially stable observer of partially linearisable mechanisms.

    qh' = calM(s) ph + L (y - qh)
    ph' = -Psi(s)^T [dV/dq - G u] - Psi^T D calM ph + Gamma calM(s)^T (y - qh),   vh = calM(s) ph

Aranovskiy, Ortega, Romero, Sokolov, 'A globally exponentially stable speed observer for a class of
mechanical systems' (International Journal of Control, 2019), equation (11). The error is linear at
any speed: locally q~'' + L q~' + K q~ = 0 with K = calM Gamma calM^T. So K, not Gamma, is the gain
of the innovation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator_pkg.circle import Circle
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.models import check
from estimator_pkg.models.load import load
from estimator_pkg.models.mechanics import Array, apply, transposed
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.tracking import natural_frequency
from estimator_pkg.observers.mechanism import gains as mechanical_gains
from estimator_pkg.observers.mechanism.observer import Core, LinearObserver, is_finite
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
    """Parameters of `geso`."""

    Gamma: tuple[float, ...] | None = parameter(
        None,
        kind=list,
        range=(-1e12, 1e12),
        advanced=True,
        description='gain of the momenta: one number, one per position, or a symmetric positive '
        'definite matrix row by row; the gain of the innovation is '
        'calM Gamma calM^T; automatic: from K, or from bandwidth_hz and damping',
        equation="ph' = ... + Gamma calM^T (y - qh)",
    )
    K: tuple[float, ...] | None = parameter(
        None,
        unit='1/s^2',
        kind=list,
        range=(-1e12, 1e12),
        advanced=True,
        description='gain of the innovation at the operating point, instead of Gamma; automatic: '
        'from Gamma, or from bandwidth_hz and damping',
        equation='Gamma = calM^-1 K calM^-T',
    )


class Geso(LinearObserver):
    """GESO with its gains; see `MechanismObserver`, also for shapes."""

    def __init__(self, gains: Gains, circle: Circle) -> None:
        mechanics = load(gains.model, gains.model_parameters)
        if not mechanics.linearisable:
            raise UserError(
                f"model '{mechanics.name}' is not partially linearisable (it has no Psi, and the "
                "Cholesky factor of M^-1 is not one): use the observer 'hgo', which does not need "
                'it'
            )
        super().__init__(gains, mechanics, circle)
        self.point = operating_point(gains, mechanics)
        self._tune(gains)
        self.states = [q for q, _ in check.random_states(mechanics)]
        self._use([self.point, *self.states], float(np.max(np.diag(self.L) / np.diag(self.K))))

    def _tune(self, gains: Gains) -> None:
        """Set the gain matrices, shape (n, n), that these parameters request.

        Raises
        ------
        UsageError : a gain is not positive definite, not Hurwitz, of wrong size, or set twice.
        """
        n = self.mechanics.degrees
        calm = self.mechanics.factors(self.point)[0]
        slow = TURN * gains.disturbance_hz
        if gains.Gamma is not None and gains.K is not None:
            raise UsageError("'Gamma' and 'K' are both set: set only one of them, not both")
        if gains.L is None and (gains.Gamma is not None or gains.K is not None):
            raise UsageError("'Gamma' or 'K' is set, but not 'L': set 'L' too")
        omega = natural_frequency(gains.bandwidth_hz, gains.damping)
        middle = 2.0 * gains.damping * omega
        # (s^2 + middle s + omega^2)(s + slow)
        self.L, K = np.eye(n) * (middle + slow), np.eye(n) * (omega * omega + middle * slow)
        if gains.L is not None:
            self.L = gain_matrix('L', gains.L, n)
            if gains.Gamma is None and gains.K is None:
                raise UsageError("'L' is set, but neither 'Gamma' nor 'K': set one of them too")
        mechanical_gains.require_hurwitz(self.L)
        if gains.Gamma is not None:
            asked = gain_matrix('Gamma', gains.Gamma, n)
            self.Gamma = mechanical_gains.require_positive('Gamma', asked)
        else:
            if gains.K is not None:
                K = mechanical_gains.require_positive('K', gain_matrix('K', gains.K, n))
            back = np.linalg.inv(calm)
            self.Gamma = back @ K @ back.T
        self.P0 = mechanical_gains.lyapunov_weight(self.L)
        foreseen = calm @ self.Gamma @ calm.T
        self.K = foreseen @ self.P0
        if slow > 0.0:
            product = np.eye(n) * omega * omega if gains.L is None else foreseen
            self.E = self.mechanics.inertia(self.point) @ product * slow

    def system(self, at: Array, core: Core, u: Array, dt: float) -> tuple[Array, Array]:
        """Return A and f of (11) at the positions `at`."""
        calm, psi = self.mechanics.factors(at)
        force, damping = self.forces(at, core.v, u, dt)
        return self._joined(calm, psi, damping), apply(transposed(psi), force)

    def _joined(self, calm: Array, psi: Array, damping: Array) -> Array:
        injection = self.Gamma @ transposed(calm) @ self.P0
        return self.joined(calm, injection, transposed(psi) @ damping @ calm, transposed(psi))

    def shown(self, core: Core, measurement: Array) -> Core | None:
        """Return the state with v = calM p; None where the model is not valid."""
        at = measurement if self.at_measurement else measurement + core.e
        if not self.mechanics.admits(at):
            return None
        return core._replace(v=apply(self.mechanics.factors(at)[0], core.x))

    def propagated(self, core: Core, at: Array) -> Array:
        """Return the velocities of the momenta: without forces these are constant everywhere."""
        if self.mechanics.admits(at):
            v = apply(self.mechanics.factors(at)[0], core.x)
            if is_finite(v):
                return v
        return core.v

    def linear(self, at: Array, power: Array) -> tuple[Array, Array]:
        """Return (A, V), see `MechanismObserver`."""
        calm, psi = self.mechanics.factors(at)
        return self._joined(calm, psi, self.mechanics.damping(at)), calm

    def describe(self, dt: float) -> dict[str, Any]:
        """Return properties of the gains by name."""
        found = {
            'operating_point': self.point.tolist(),
            'L': self.L.tolist(),
            'Gamma': self.Gamma.tolist(),
            **mechanical_gains.describe_loop(self.L, self.K, self.systems, dt),
        }
        # the proposition applies to (11): L + L^T > 0 and no disturbance state
        if self.E is None and np.allclose(self.P0, np.eye(len(self.P0))):
            found |= mechanical_gains.guaranteed(self.mechanics, self.L, self.Gamma, self.states)
        return found


class GesoObserver(Observer):
    """The entry point of `geso`."""

    name = 'geso'
    summary = 'globally exponentially stable observer of a mechanism with known model and input'
    reference = 'Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), equation (11)'
    kind = 'mechanical'
    gains = Gains
    plan = Geso
