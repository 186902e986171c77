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
    """What is left after dt [s] of what was known, at a memory of so many seconds; 0: for ever."""
    return max(math.exp(-dt / memory), LEAST_KEPT) if memory > 0.0 else 1.0


def make_update(size: int) -> Callable[..., tuple]:
    """update(theta, p, psi, error, forget, most) -> (theta, p, spread), for `size` parameters.

    One equation psi . theta = ... more, which theta misses by `error`. `forget` is of `kept`,
    `most` the covariance p at the start, a diagonal one; error^2/spread has the variance of the
    noise.
    """
    free = algebra(size)
    apply, dot, add, rank_one = free.apply, free.dot, free.add, free.rank_one
    wider, limited = free.wider, free.limited
    nothing = ((0.0,) * size,) * size

    def update(
        theta: tuple, p: tuple, psi: tuple, error: float, forget: float, most: tuple
    ) -> tuple[tuple, tuple, float]:
        direction = apply(p, psi)
        if forget < 1.0 and (wider(nothing, p) or dot(psi, direction) < 0.0):
            p = most
            direction = apply(p, psi)
        spread = forget + dot(psi, direction)
        theta = add(theta, error / spread, direction)
        p = rank_one(p, 1.0 / forget, -1.0 / (forget * spread), direction)
        return theta, limited(p, most, TRACE) if forget < 1.0 else p, spread

    return update
