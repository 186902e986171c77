"""Recursive least squares that forgets, without losing its covariance.

P grows as exp(t/memory) where the signals tell nothing, past every float in the end, while other
directions are told well. So nothing is forgotten beyond what was known at the start, each parameter
by itself; a trace of the start is added at each sample, so that rounding leaves no direction blind;
and where it has left no covariance all the same, P begins anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from estimator_pkg.observers.maths.unroll import algebra

LEAST_KEPT = 0.1  # of what is known, over a sample time far beyond the memory
TRACE = 1e-13  # of the covariance at the start


def kept(dt: float, memory: float) -> float:
    """Return the part of the information that is kept after dt [s], at this memory [s]; 0: all."""
    return max(math.exp(-dt / memory), LEAST_KEPT) if memory > 0.0 else 1.0


def make_update(size: int) -> Callable[..., tuple]:
    """Return update(theta, p, psi, e, forget, most) -> (theta, p, s), for `size` parameters.

    Recursive least squares with forgetting, for one measurement psi . theta of unit noise variance:

        s = forget + psi' P psi,   K = P psi/s,   theta += K e,   P = (P - K psi' P)/forget

    `e` is the innovation, s its variance in units of that of the noise; `forget` is from `kept`,
    `most` the covariance P at the start, a diagonal one.
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
