"""What white measurement noise does to a linear observer in steady state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def steady_variances(transition: NDArray[np.float64], gain: NDArray[np.float64]
                     ) -> tuple[float, float, float]:
    """Variances of position, velocity and innovation per unit variance of white noise.

    Parameters
    ----------
    transition : A, shape (n, n); the first state is measured, the second is its rate.
    gain : K, shape (n,), of the correction x + K (y - x_0) after the prediction A x.

    The error after the correction obeys e+ = (I - K C) A e + K noise; its covariance is summed by
    doubling, which converges for every stable observer.

    Raises
    ------
    ValueError : the observer is unstable.
    """
    count = len(gain)
    kept = np.eye(count)
    kept[:, 0] -= gain
    power = kept @ transition
    if max(abs(np.linalg.eigvals(power))) >= 1.0:
        raise ValueError('the observer is unstable')
    covariance = np.outer(gain, gain)
    for _ in range(60):
        added = power @ covariance @ power.T
        covariance = covariance + added
        if np.max(np.abs(added)) <= 1e-15 * np.max(np.abs(covariance)):
            break
        power = power @ power
    before = transition @ covariance @ transition.T
    return float(covariance[0, 0]), float(covariance[1, 1]), float(before[0, 0]) + 1.0
