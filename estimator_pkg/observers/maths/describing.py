"""Injections of a sliding mode at Gaussian innovations of one size.

An injection f(e) at a Gaussian innovation e of deviation s is a gain times e plus a remnant that is
uncorrelated with e (statistical linearisation; Gelb and Vander Velde, Multiple-Input Describing
Functions, 1968, chapter 7).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

POINTS = 200  # of the half of a Gaussian over which the injections are averaged


class Describing(NamedTuple):
    """An injection at innovations of one size.

    position, velocity : its gains. Of an implicit step `position` is that from the innovation to
        the offset after the step.
    remnant : covariance of what the gains do not explain, shape (2, 2).
    """

    position: float
    velocity: float
    remnant: Array


@lru_cache
def _half() -> tuple[float, ...]:
    """Return the quantiles of the positive half of a Gaussian: the injections are odd."""
    inverse = NormalDist().inv_cdf
    return tuple(inverse(0.5 + 0.5 * (k + 0.5) / POINTS) for k in range(POINTS))


def describing(
    inject: Callable[..., tuple[float, float]],
    first: float,
    second: float,
    m1: float,
    m2: float,
    dt: float,
    size: float,
    *,
    implicit: bool,
) -> Describing:
    """Return the describing function of an injection at innovations of deviation `size`.

    Parameters
    ----------
    inject : (e, first, second, m1, m2) -> two injections; of an implicit step
        (e, dt, first, second, m1, m2) -> the offset after the step, and the second injection.
    """
    points = np.array(_half())
    points *= size / np.sqrt(np.mean(points**2))
    if implicit:
        found = np.array([inject(e, dt, first, second, m1, m2) for e in points.tolist()])
    else:
        found = np.array([inject(e, first, second, m1, m2) for e in points.tolist()])
    gains = points @ found / np.sum(points**2)
    left = found - points[:, None] * gains
    position, velocity = gains.tolist()
    return Describing(position, velocity, left.T @ left / len(points))
