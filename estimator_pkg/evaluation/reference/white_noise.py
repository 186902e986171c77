# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The white noise of a reference velocity, separated from its motion.

At usual sample rates the third differences of a motion are small, and those of white noise are not.
A violent motion has large ones too. Therefore the quietest tenth of the record counts, and another
estimate that is less sensitive to motion is used if it is clearly smaller:

- Differences of a higher order: with the order, those of white noise grow as expected, and those of
  a motion that is sampled often enough fall.
- If the reference has positions, its velocity must be their derivative. The divided difference of
  position and velocity over three samples (at even steps: Simpson's rule) is zero for every motion
  whose position is a polynomial of degree four. For a motor that starts, at 100 samples a second,
  it is a thirtieth of the third differences.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.delay import GAP_STEPS
from estimator_pkg.evaluation.signals import wrapped

Array = NDArray[np.float64]

DIFFERENCE_ORDER, HIGHER = 3, (5, 7, 9)  # orders of the differences
CLEARLY_LESS = 0.5  # for white noise all estimates agree within this ratio
NODES = 3  # samples of a divided difference; it weighs their velocities 1, 4, 1, so this is the
MISFITS_ALIKE = 1.0 + 2.0 * (8.0**2 + 1.0) / 18.0**2  # sum of its neighbours' correlations squared
QUIETEST = 0.1  # the quietest fraction of the record counts; over n samples, the rms of white noise
UNLUCKY = 1.28  # is below its mean there by this many standard deviations
NOISE_BLOCK = 0.2  # length of a block whose power is one value [s],
SHORTEST_BLOCK = 20  # but at least this many samples
MANY_BLOCKS = 20


def noise(
    time: Array, velocity: Array, position: Array | None = None, period: float = 0.0
) -> float:
    """Return the rms of the white noise on `velocity` [rad/s]; nan for too few samples.

    Parameters
    ----------
    time : shape (n,), strictly increasing [s].
    velocity : shape (n,) [rad/s].
    position : shape (n,), of the same reference [rad], in any wrap convention; None, nan: none.
    period : wrap period of the positions [rad]; 0: none.
    """
    if len(time) < SHORTEST_BLOCK + DIFFERENCE_ORDER:
        return np.nan
    step = float(np.median(np.diff(time)))
    third = _by_differences(velocity, DIFFERENCE_ORDER, step)
    others = [
        _by_differences(velocity, order, step)
        for order in HIGHER
        if len(time) >= SHORTEST_BLOCK + order
    ]
    if position is not None and np.isfinite(position).all():
        left = _misfit(time, velocity, position, period, step)
        if len(left) >= SHORTEST_BLOCK:
            others.append(_quietest(left**2, step, MISFITS_ALIKE))
    least = min(others, default=third)
    return least if least < CLEARLY_LESS * third else third


def _by_differences(velocity: Array, order: int, step: float) -> float:
    """Return the rms of white noise with these differences of order `order`."""
    gain = math.comb(2 * order, order)
    # sum of the squared correlations of neighbouring differences of white noise
    alike = math.comb(4 * order, 2 * order) / gain**2
    return _quietest(np.diff(velocity, order) ** 2 / gain, step, alike)


def _quietest(squares: Array, step: float, alike: float) -> float:
    """Return the root of the mean of `squares` where it is low, corrected for this selection."""
    size = int(max(NOISE_BLOCK / step, SHORTEST_BLOCK))
    last = max(1, len(squares) - size + 1)
    # in a short record blocks overlap, because a quiet stretch may span two of them
    starts = range(0, last, size if last >= MANY_BLOCKS * size else max(1, size // 4))
    powers = [float(np.mean(squares[i : i + size])) for i in starts]
    low = 1.0 - UNLUCKY * math.sqrt(0.5 * alike / size) if len(powers) > 1 else 1.0
    return float(np.sqrt(np.quantile(powers, QUIETEST)) / low)


def _misfit(time: Array, velocity: Array, position: Array, period: float, step: float) -> Array:
    """Return the divided differences, scaled to the rms of white noise on the velocity.

    None if the position is only the sum of the velocities with their noise (trapezoids).

    With every node twice, f[t0, t0, t1, t1, ...] = sum of w_i^2 (f'(t_i) - 2 s_i f(t_i)), where
    w_i = 1 / prod of (t_i - t_j) and s_i = sum of 1 / (t_i - t_j) over the other nodes (Stoer and
    Bulirsch, Introduction to Numerical Analysis, section 2.1.5).
    """
    steps = np.diff(time)
    expected = 0.5 * (velocity[1:] + velocity[:-1]) * steps
    moved = expected + wrapped(np.diff(position) - expected, period)
    travelled = np.concatenate([[0.0], np.cumsum(moved)])
    count = len(time) - NODES + 1
    at, speed, way = (
        np.stack([values[i : count + i] for i in range(NODES)])
        for values in (time, velocity, travelled)
    )
    span = at[-1] - at[0]
    at, way = (at - at[0]) / span, (way - way[0]) / span
    weights, slopes = np.ones_like(at), np.zeros_like(at)
    for i in range(NODES):
        for j in range(NODES):
            if i != j:
                weights[i] /= (at[i] - at[j]) ** 2
                slopes[i] += 1.0 / (at[i] - at[j])
    left = np.sum(weights * (speed - 2.0 * slopes * way), axis=0) / np.sqrt(
        np.sum(weights**2, axis=0)
    )
    left = left[np.isfinite(left) & (span <= GAP_STEPS * step)]
    summed = math.sqrt(2.0) * (moved - expected)[steps <= GAP_STEPS * step] / step
    if not len(left) or np.nanmean(summed**2) < CLEARLY_LESS**2 * np.mean(left**2):
        return np.zeros(0)
    return np.asarray(left)
