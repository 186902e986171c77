# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""HGO: the high-gain observer of a mechanism.

    x1h' = x2h + L e,   x2h' = M(y)^-1 [G u - dV/dq - C(y, x2h) x2h - D x2h] + K e,   e = y - x1h

With L = h1/eps and K = h2/eps^2 it is the paper's (21). It does not need Psi, so it works for every
mechanism. Its error grows with the speed, through C.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.tracking import natural_frequency
from estimator_pkg.observers.mechanism.core import (  # noqa: F401  (its functions too)
    DRIVEN,
    EDGES,
    SINGLE_ANGLE,
    TURNS,
    MechanismEstimate,
    Plan,
    estimate,
    group_delay,
    is_reading,
    limits,
    prepare,
    restart,
    resume,
    start,
    step,
)
from estimator_pkg.observers.mechanism.core import keep_velocities as propagate  # noqa: F401
from estimator_pkg.observers.mechanism.parameters import LoopGains, MechanicalGains, gain_matrix
from estimator_pkg.observers.mechanism.state import Coefficients, Design, State  # noqa: F401
from estimator_pkg.observers.mechanism.velocity import SLIDING, advance, linear_plan  # noqa: F401  (its functions too)
from estimator_pkg.parameters import parameter

Array = NDArray[np.float64]
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


def tune(gains: Gains, n: int) -> tuple[Array, Array, Array | None]:
    """Return the gain matrices (L [1/s], K [1/s^2], E [1/s^3]), shape (n, n); E may be None.

    Raises
    ------
    UsageError : gains of wrong size, or set twice.
    """
    slow = TURN * gains.disturbance_hz
    eye = np.eye(n)
    if gains.h is not None:
        if gains.L is not None or gains.K is not None:
            raise UsageError("'h' is set together with 'L' or 'K': set 'h', or 'L' and 'K'")
        if len(gains.h) != 2:
            raise UsageError(f"parameter 'h' has {len(gains.h)} numbers: 'hgo' takes 2, h1 and h2")
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


def plan(gains: Gains, circle: Any) -> Plan:
    """Return what these gains imply; raises UserError, UsageError."""
    complaint = "the error does not decay with these gains: 'L' and 'K' must be positive definite"
    return linear_plan(sys.modules[__name__], gains, circle, complaint)


OBSERVER = Observer(
    name='hgo',
    summary='high-gain observer of any mechanism with known model and input',
    gains=Gains,
    kind='mechanical',
    reference='Lee, Mukherjee, Khalil (2015); (21) of Aranovskiy et al. (IJC 2019)',
)
