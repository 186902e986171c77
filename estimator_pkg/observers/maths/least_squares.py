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

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_KEPT = 0.1  # smallest part of the information kept, for sample times far beyond the memory
TRACE = 1e-13  # part of the initial covariance that each sample adds


def kept(dt: float, memory: float) -> float:
    """Return the part of the information kept after dt [s]; memory [s], 0: nothing is forgotten."""
    return max(math.exp(-dt / memory), LEAST_KEPT) if memory > 0.0 else 1.0


def update(
    theta: Array, p: Array, psi: Array, e: float, forget: float, most: Array
) -> tuple[Array, Array, float]:
    """Take one measurement psi . theta of unit noise variance; return (theta, P, its variance s).

    Recursive least squares with forgetting:

        s = forget + psi' P psi,   K = P psi/s,   theta += K e,   P = (P - K psi' P)/forget

    `e` is the innovation; `forget` is from `kept`; `most` is the diagonal of the initial P, the
    rest of which is zero. P has shape (m, m), the other arrays (m,).
    """
    along = p @ psi
    seen = float(psi @ along)
    if forget < 1.0 and (seen < 0.0 or p.diagonal().min() < 0.0):
        p = np.diag(most)
        along = p @ psi
        seen = float(psi @ along)
    s = forget + seen
    p = (p - along[:, None] * along / s) / forget
    if forget < 1.0:
        p = limited(p, most)
    return theta + along * (e / s), p, s


def limited(p: Array, most: Array) -> Array:
    """Scale P, shape (m, m), so that no variance exceeds its initial one, and add the trace."""
    scales = np.sqrt(most / np.maximum(p.diagonal(), most))
    return p * scales * scales[:, None] + np.diag(TRACE * most)
