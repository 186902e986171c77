# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Describing functions of sliding-mode injections for Gaussian innovations.

For a Gaussian innovation e of standard deviation s, an injection f(e) is a gain times e plus a
remnant that is uncorrelated with e (statistical linearisation; Gelb and Vander Velde,
Multiple-Input Describing Functions, 1968, chapter 7).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

QUANTILES = 200  # quantiles of half a Gaussian, over which the injections are averaged


class Describing(NamedTuple):
    """The statistical linearisation of a pair of injections."""

    position: float  # gain of the first; of an implicit step: to the offset after it
    velocity: float  # gain of the second
    remnant: Array  # covariance of the remnants, shape (2, 2)


@lru_cache
def _half() -> Array:
    """Return quantiles of the positive half of a Gaussian, of mean square 1."""
    inverse = NormalDist().inv_cdf
    points = np.array([inverse(0.5 + 0.5 * (k + 0.5) / QUANTILES) for k in range(QUANTILES)])
    return points / np.sqrt(np.mean(points**2))


def describing(inject: Callable[[Array], tuple[Array, Array]], size: float) -> Describing:
    """Return the describing function of `inject` for innovations of standard deviation `size`.

    Parameters
    ----------
    inject : (e) -> the two injections, shape (N,) all; for an implicit step (e) -> the offset after
        the step, and the second injection. It is odd.
    size : standard deviation of the innovation [rad or m].
    """
    points = size * _half()
    found = np.stack(inject(points), axis=-1)
    gains = points @ found / np.sum(points**2)
    left = found - points[:, None] * gains
    position, velocity = gains.tolist()
    return Describing(position, velocity, left.T @ left / len(points))
