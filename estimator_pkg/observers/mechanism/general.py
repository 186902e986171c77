# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The general form of Remark 6, for systems that are linear in their unmeasured states.

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

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.mechanism.gains import (
    lyapunov_weight,
    require_hurwitz,
    require_positive,
)
from estimator_pkg.observers.mechanism.noise import exponential

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
    f2 : (y, u) -> shape (n2,).
    L : shape (n1, n1), -L Hurwitz.
    Gamma : shape (n2, n2), symmetric and positive definite.
    f1 : (y, u) -> shape (n1,); None: zero.

    Raises
    ------
    UsageError : -L is not Hurwitz, Gamma is not positive definite, or a shape is wrong.
    """

    def __init__(
        self,
        B: Callable[[Array], Array],
        f2: Callable[[Array, Array], Array],
        L: Array,
        Gamma: Array,
        f1: Callable[[Array, Array], Array] | None = None,
    ) -> None:
        self._B, self._f1, self._f2 = B, f1, f2
        self.L, self.Gamma = np.asarray(L, float), np.asarray(Gamma, float)
        if self.L.ndim != 2 or self.L.shape[0] != self.L.shape[1]:
            raise UsageError(f"'L' has the shape {self.L.shape}: it must be a square matrix")
        if self.Gamma.ndim != 2 or self.Gamma.shape[0] != self.Gamma.shape[1]:
            raise UsageError(
                f"'Gamma' has the shape {self.Gamma.shape}: it must be a square matrix"
            )
        require_hurwitz(self.L)
        self.Gamma = require_positive('Gamma', self.Gamma)
        self.P0 = lyapunov_weight(self.L)

    def start(self, y: Array) -> GeneralState:
        """Return the initial state: measured part `y`, shape (n1,), unmeasured part zero."""
        return GeneralState(np.array(y, float), np.zeros(len(self.Gamma)))

    def observable_everywhere(self, configurations: Array) -> bool:
        """Return True if B has full column rank at all configurations, shape (k, n1).

        This is the condition for a uniform rate.
        """
        return all(np.linalg.matrix_rank(self._B(y)) == len(self.Gamma) for y in configurations)

    def step(
        self, state: GeneralState, y: Array, following: Array, u: Array, dt: float
    ) -> GeneralState:
        """Return the state after one more sample of `dt` [s].

        The measurement changes linearly from `y` to `following`, shape (n1,) each; the input `u` is
        constant.

        Raises
        ------
        UsageError : B does not have the shape (n1, n2).
        """
        n1, n2 = len(self.L), len(self.Gamma)
        middle = 0.5 * (np.asarray(y) + np.asarray(following))
        B = np.asarray(self._B(middle), float)
        if B.shape != (n1, n2):
            raise UsageError(
                f'B has the shape {B.shape}: with this L and Gamma it must be ({n1}, {n2})'
            )
        size = n1 + n2
        whole = np.zeros((size + 1, size + 1))
        whole[:n1, :n1], whole[:n1, n1:size] = -self.L, B
        whole[n1:size, :n1] = -self.Gamma @ B.T @ self.P0
        whole[:n1, size] = -(np.asarray(following) - np.asarray(y)) / dt
        if self._f1 is not None:
            whole[:n1, size] += self._f1(middle, u)
        whole[n1:size, size] = self._f2(middle, u)
        error = np.concatenate([state.measured - y, state.unmeasured, [1.0]])
        after = exponential(whole * dt) @ error
        return GeneralState(np.asarray(following) + after[:n1], after[n1:size])
