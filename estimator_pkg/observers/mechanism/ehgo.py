# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""EHGO: the extended high-gain observer, which also estimates a disturbance of the acceleration.

    x1h' = x2h + (h1/eps) e,   x2h' = model + sg + (h2/eps^2) e,   sg' = (h3/eps^3) e

Equation (25) of the paper; `model` is that of `hgo`. With `bandwidth_hz` its three error poles are
equal (damping 1). The transfer function from true to estimated velocity, for motion that the model
does not predict, is then (K s + E)/(s + w)^3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.models.mechanics import Array
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.mechanism.hgo import HighGain
from estimator_pkg.observers.mechanism.parameters import BandwidthGains, MechanicalGains
from estimator_pkg.parameters import parameter

TRIPLE_POLE = (3.0, 3.0, 1.0)  # (s + 1)^3
UNIT_BANDWIDTH = 1.642467686  # -3 dB frequency over w of (3 s + 1)/(s + 1)^3: velocity


@dataclass(frozen=True)
class Gains(MechanicalGains, BandwidthGains):
    """Parameters of `ehgo`."""

    h: tuple[float, ...] | None = parameter(
        None,
        kind=list,
        range=(0.0, 1e9),
        advanced=True,
        description="the paper's h1, h2, h3, used with epsilon; automatic: three equal poles",
        equation='(h1/epsilon, h2/epsilon^2, h3/epsilon^3)',
    )
    epsilon: float = parameter(
        1.0, unit='s', range=(1e-9, 1e3), advanced=True, description="the paper's epsilon"
    )


class Ehgo(HighGain):
    """EHGO with its gains, shape (n, n) each; see `HighGain`."""

    complaint = (
        "the gains 'h' do not make the error decay: every root of s^3 + h1 s^2 + h2 s + h3 needs "
        'a negative real part'
    )

    def tuned(self, gains: Gains, n: int) -> tuple[Array, Array, Array]:
        """Return h1/eps, h2/eps^2, h3/eps^3, see `HighGain`."""
        h, epsilon = gains.h, gains.epsilon
        if h is None:
            h, epsilon = TRIPLE_POLE, UNIT_BANDWIDTH / (2.0 * np.pi * gains.bandwidth_hz)
        if len(h) != 3:
            raise UsageError(f"parameter 'h' has {len(h)} numbers: 'ehgo' takes 3, h1, h2 and h3")
        eye = np.eye(n)
        return h[0] / epsilon * eye, h[1] / epsilon**2 * eye, h[2] / epsilon**3 * eye


class EhgoObserver(Observer):
    """The entry point of `ehgo`."""

    name = 'ehgo'
    summary = 'extended high-gain observer of any mechanism: estimates unknown forces too'
    reference = '(25) of Aranovskiy, Ortega, Romero, Sokolov (IJC 2019)'
    kind = 'mechanical'
    gains = Gains
    plan = Ehgo
