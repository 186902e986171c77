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

from estimator_pkg.observers.maths.vectors import add_square, multiply

LEAST_KEPT = 0.1  # smallest part of the information kept, for sample times far beyond the memory
TRACE = 1e-13  # part of the initial covariance that each sample adds


def kept(dt: float, memory: float) -> float:
    """Return the part of the information kept after dt [s]; memory [s], 0: nothing is forgotten."""
    return max(math.exp(-dt / memory), LEAST_KEPT) if memory > 0.0 else 1.0


def update(
    theta: list[float],
    p: list[list[float]],
    psi: list[float],
    e: float,
    forget: float,
    most: list[float],
) -> float:
    """Take one measurement psi . theta of unit noise variance; return s, its variance.

    Recursive least squares with forgetting, in place:

        s = forget + psi' P psi,   K = P psi/s,   theta += K e,   P = (P - K psi' P)/forget

    `e` is the innovation; `forget` is from `kept`; `most` is the diagonal of the initial P, the
    rest of which is zero.
    """
    direction, seen = multiply(p, psi)
    if forget < 1.0 and (seen < 0.0 or any(row[i] < 0.0 for i, row in enumerate(p))):
        for i, row in enumerate(p):
            row[:] = [0.0] * len(psi)
            row[i] = most[i]
        direction, seen = multiply(p, psi)
    s = forget + seen
    step, keep, scale = e / s, 1.0 / forget, -1.0 / (forget * s)  # K = direction/s
    for i, along in enumerate(direction):
        theta[i] += step * along
    add_square(p, keep, scale, direction)
    if forget < 1.0:
        limit(p, most)
    return s


def limit(p: list[list[float]], most: list[float]) -> None:
    """Scale rows and columns so that no variance exceeds its initial one, and add the trace."""
    scales = [1.0] * len(most)
    for i, largest in enumerate(most):
        if p[i][i] > largest:
            scales[i] = math.sqrt(largest / p[i][i])
    for i, row in enumerate(p):
        if scales.count(1.0) < len(most):
            for j, scale in enumerate(scales):
                row[j] *= scales[i] * scale
        row[i] += TRACE * most[i]
