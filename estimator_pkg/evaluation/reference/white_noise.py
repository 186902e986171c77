"""The white noise of a reference velocity, told from the motion that it shows.

Third differences of a motion are small at usual sample rates, those of white noise are not. Violent
motion has them too; therefore the quietest tenth of the record counts, and what sees through the
motion wins where it leaves clearly less:

- Differences of a higher order: those of white noise grow with the order as they should, those of a
  motion that is sampled often enough fall.
- Where the reference has positions too, its velocity must be their derivative. The divided
  difference of position and velocity over three samples (on even ones that is Simpson's rule) is
  zero for every motion whose position is a polynomial of degree four. Of a motor that starts it
  leaves a thirtieth of what third differences leave, at 100 samples a second.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.compare.delay import GAP
from estimator_pkg.evaluation.compare.metrics import wrapped

Array = NDArray[np.float64]

ORDER, HIGHER = 3, (5, 7, 9)  # of the differences
CLEARLY_LESS = 0.5  # white noise gives more alike numbers than this, by whatever way
NODES = 3  # samples of a divided difference, which weighs their velocities 1, 4, 1: so
MISFITS_ALIKE = 1.0 + 2.0 * (8.0**2 + 1.0) / 18.0**2  # much are neighbours correlated
QUIETEST = 0.1  # the noise is that of the quietest tenth of the record, which of n samples of
UNLUCKY = 1.28  # white noise is lower by so many standard deviations of its rms
BLOCK = 0.2  # [s] of a stretch whose power is one value,
SHORTEST_BLOCK = 20  # but at least so many samples
MANY_BLOCKS = 20


def noise(
    time: Array, velocity: Array, position: Array | None = None, period: float = 0.0
) -> float:
    """The rms of the white noise on `velocity` [rad/s], from its quietest stretches; nan: too few.

    Parameters
    ----------
    time : shape (n,), strictly increasing [s].
    velocity : shape (n,) [rad/s].
    position : shape (n,), of the same reference [rad], in any convention; None, nan: it has none.
    period : wrap period of the positions [rad]; 0: none.
    """
    if len(time) < SHORTEST_BLOCK + ORDER:
        return np.nan
    step = float(np.median(np.diff(time)))
    third = _by_differences(velocity, ORDER, step)
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
    """The noise that would give the differences of this order."""
    gain = math.comb(2 * order, order)
    # how alike neighbouring differences of white noise are: the sum of their squared correlations
    alike = math.comb(4 * order, 2 * order) / gain**2
    return _quietest(np.diff(velocity, order) ** 2 / gain, step, alike)


def _quietest(squares: Array, step: float, alike: float) -> float:
    """The root of the mean of `squares` where it is low, corrected for having looked there."""
    size = int(max(BLOCK / step, SHORTEST_BLOCK))
    last = max(1, len(squares) - size + 1)
    # in a short record, blocks that overlap: a quiet stretch may lie across two
    starts = range(0, last, size if last >= MANY_BLOCKS * size else max(1, size // 4))
    powers = [float(np.mean(squares[i : i + size])) for i in starts]
    low = 1.0 - UNLUCKY * math.sqrt(0.5 * alike / size) if len(powers) > 1 else 1.0
    return float(np.sqrt(np.quantile(powers, QUIETEST)) / low)


def _misfit(time: Array, velocity: Array, position: Array, period: float, step: float) -> Array:
    """The divided differences, scaled so that white noise of the velocity gives its own rms.

    None where the position is no more than the sum of the velocities, noise and all (trapezoids).

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
    left = left[np.isfinite(left) & (span <= GAP * step)]
    summed = math.sqrt(2.0) * (moved - expected)[steps <= GAP * step] / step
    if not len(left) or np.nanmean(summed**2) < CLEARLY_LESS**2 * np.mean(left**2):
        return np.zeros(0)
    return np.asarray(left)
