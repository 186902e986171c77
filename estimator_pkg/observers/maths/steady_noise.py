# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Steady-state covariances of a linear observer under white measurement noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def steady_covariance(
    step: NDArray[np.float64], entering: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the P that solves P = step P step^T + entering, the covariance in steady state.

    All matrices have shape (n, n), P in the unit of `entering`. The sum is computed by doubling. P
    is infinite if `step` is not stable.
    """
    if max(abs(np.linalg.eigvals(step))) >= 1.0:
        return np.full_like(entering, np.inf)
    covariance, power = entering, step
    for _ in range(60):
        added = power @ covariance @ power.T
        covariance = covariance + added
        if np.max(np.abs(added)) <= 1e-15 * np.max(np.abs(covariance)):
            break
        power = power @ power
    return covariance


def steady_variances(
    transition: NDArray[np.float64], gain: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Return variances of position, velocity and innovation per unit variance of white noise.

    Parameters
    ----------
    transition : A, shape (n, n); the first state is measured, the second is its rate.
    gain : K, shape (n,), of the correction x + K (y - x_0) after the prediction A x.

    The error after the correction obeys e+ = (I - K C) A e + K noise.

    Raises
    ------
    ValueError : the observer is unstable.
    """
    kept = np.eye(len(gain))
    kept[:, 0] -= gain
    covariance = steady_covariance(kept @ transition, gain[:, None] * gain)
    if not np.all(np.isfinite(covariance)):
        raise ValueError('the observer is unstable')
    before = transition @ covariance @ transition.T
    return float(covariance[0, 0]), float(covariance[1, 1]), float(before[0, 0]) + 1.0
