# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer of Remark 6, for systems that are linear in their unmeasured states.

    e1' = B(e1) e2 + f1(e1, u),   e2' = f2(e1, u),   y = e1

admits the observer

    e1h' = B(y) e2h + f1(y, u) + L (y - e1h)
    e2h' = f2(y, u) + Gamma B(y)^T P0 (y - e1h)

with n1 measured and n2 unmeasured states. The error converges to zero for every n1 and n2. It
converges exponentially with a uniform rate if n1 >= n2 and B has full column rank uniformly, and
otherwise if B is persistently exciting along the motion (14). GESO is the case e2 = p, B = calM.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from estimator_pkg.observers.mechanism.gains import (
    lyapunov_weight,
    require_hurwitz,
    require_positive,
)

Array = NDArray[np.float64]


class GeneralState(NamedTuple):
    """Estimates: measured part, shape (n1,), unmeasured part, shape (n2,)."""

    measured: Array
    unmeasured: Array


class GeneralObserver:
    """The observer of Remark 6, stepped exactly with B, f1, f2 frozen over a sample.

    Parameters
    ----------
    B : (y) -> matrix, shape (n1, n2).
    f1, f2 : (y, u) -> shape (n1,) and (n2,).
    L : shape (n1, n1), -L Hurwitz.
    Gamma : shape (n2, n2), symmetric and positive definite.

    Raises
    ------
    UsageError : -L is not Hurwitz, or Gamma is not positive definite.
    """

    def __init__(
        self,
        B: Callable[[Array], Array],
        f1: Callable[[Array, Array], Array],
        f2: Callable[[Array, Array], Array],
        L: Array,
        Gamma: Array,
    ) -> None:
        require_hurwitz(L)
        self._B, self._f1, self._f2, self._L = B, f1, f2, L
        self._Gamma, self._P0 = require_positive('Gamma', Gamma), lyapunov_weight(L)

    def start(self, y: Array) -> GeneralState:
        """Return the initial state: measured part `y`, shape (n1,), unmeasured part zero."""
        return GeneralState(y, np.zeros(len(self._Gamma)))

    def step(
        self, state: GeneralState, y: Array, following: Array, u: Array, dt: float
    ) -> GeneralState:
        """Return the state after one more sample of `dt` [s].

        The measurement changes linearly from `y` to `following`, shape (n1,) each; the input `u` is
        constant.
        """
        n1, size = len(self._L), len(self._L) + len(self._Gamma)
        middle = 0.5 * (y + following)
        B = self._B(middle)
        whole = np.zeros((size + 1, size + 1))
        whole[:n1, :n1], whole[:n1, n1:size] = -self._L, B
        whole[n1:size, :n1] = -self._Gamma @ B.T @ self._P0
        whole[:n1, size] = self._f1(middle, u) - (following - y) / dt
        whole[n1:size, size] = self._f2(middle, u)
        error = np.concatenate([state.measured - y, state.unmeasured, [1.0]])
        after = expm(whole * dt) @ error
        return GeneralState(following + after[:n1], after[n1:size])
