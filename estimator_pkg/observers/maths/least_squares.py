# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Recursive least squares with forgetting and a bounded covariance.

Without excitation P grows as exp(t/memory) and would overflow, although other directions are well
excited. So the variance of each parameter is limited to its value at the start. A trace of the
initial covariance is added at each sample, so that rounding makes no direction singular. If P loses
positive definiteness it is reset.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from estimator_pkg.observers.maths.unroll import algebra

LEAST_KEPT = 0.1  # smallest part of the information kept, for sample times far beyond the memory
TRACE = 1e-13  # part of the initial covariance that each sample adds


def kept(dt: float, memory: float) -> float:
    """Return the part of the information kept after dt [s]; memory [s], 0: nothing is forgotten."""
    return max(math.exp(-dt / memory), LEAST_KEPT) if memory > 0.0 else 1.0


def make_update(size: int) -> Callable[..., tuple]:
    """Return the function update(theta, p, psi, e, forget, most) -> (theta, p, s).

    It is written out for `size` parameters.

    Recursive least squares with forgetting, for one measurement psi . theta of unit noise variance:

        s = forget + psi' P psi,   K = P psi/s,   theta += K e,   P = (P - K psi' P)/forget

    `e` is the innovation and s its variance per noise variance; `forget` is from `kept`; `most` is
    the initial covariance P, which is diagonal.
    """
    free = algebra(size)
    apply, dot, add, rank_one = free.apply, free.dot, free.add, free.rank_one
    wider, limited = free.wider, free.limited
    nothing = ((0.0,) * size,) * size

    def update(
        theta: tuple, p: tuple, psi: tuple, e: float, forget: float, most: tuple
    ) -> tuple[tuple, tuple, float]:
        direction = apply(p, psi)  # P psi
        if forget < 1.0 and (wider(nothing, p) or dot(psi, direction) < 0.0):
            p = most
            direction = apply(p, psi)
        s = forget + dot(psi, direction)
        theta = add(theta, e / s, direction)  # K = direction/s
        p = rank_one(p, 1.0 / forget, -1.0 / (forget * s), direction)
        return theta, limited(p, most, TRACE) if forget < 1.0 else p, s

    return update
