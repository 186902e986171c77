# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Readings of a counter as cells: intervals of one quantum in which the position was.

As a number with variance quantum^2/12, an unchanged reading would count again and again, and the
moment at which it changes, which is worth far more, no more than any other. Here each reading is
the statement "within half a quantum of this, blurred by noise". Expectation propagation (Minka
2001; on a chain as by Heskes and Zoeter 2002) finds a Gaussian factor for each, its site, that
gives the same mean and variance together with all others. The linear smoother then uses the sites
instead of the readings. Where the motion passes many counts per sample, the sites become the usual
quantum^2/12.

A site is (precision, pull), relative to the centre of its cell: exp(-precision u^2/2 + pull u).
A message is a state of `smoother.steps` without the site of its own reading. The backward message
is the filter of the reversed record, in which only the sign of the speed differs.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.reference.smoother.steps import predict

Array = NDArray[np.float64]

FAR = -20.0  # beyond this many standard deviations outside the cell, a series is used
ROOT_2 = math.sqrt(2.0)
ROOT_2_PI = math.sqrt(2.0 * math.pi)
SURE = 1e-12  # smallest fraction of a variance that remains


def site(mean: float, variance: float, half: float, noise: float) -> tuple[float, float, float]:
    """Return (precision, pull, log of the probability) of a cell for a Gaussian.

    Parameters
    ----------
    mean, variance : of the Gaussian, relative to the centre of the cell.
    half : half of the width of the cell; noise : standard deviation of its blur.
    """
    sign = 1.0 if mean >= 0.0 else -1.0
    spread = math.sqrt(variance + noise * noise)
    low, high = (-half - sign * mean) / spread, (half - sign * mean) / spread
    if high < FAR:  # one-sided: the far end is out of reach
        h = -high
        ratio = h + 1.0 / h - 2.0 / (h * h * h)
        d, f = -ratio, ratio * (ratio + high)
        log_z = -0.5 * h * h - math.log(ROOT_2_PI * h)
    else:
        z = max(0.5 * (math.erfc(-high / ROOT_2) - math.erfc(-low / ROOT_2)), 1e-300)
        at_low = math.exp(-0.5 * low * low) / (ROOT_2_PI * z)
        at_high = math.exp(-0.5 * high * high) / (ROOT_2_PI * z)
        d = at_low - at_high
        f = d * d - (low * at_low - high * at_high)
        log_z = math.log(z)
    f = min(max(f, 0.0), 1.0)
    part = variance / (spread * spread)
    precision = f / (spread * spread * max(1.0 - part * f, SURE))
    shift = sign * d / spread
    return precision, precision * (mean + variance * shift) + shift, log_z


def _absorb(x: tuple, centre: float, precision: float, pull: float) -> tuple:
    """Return the state after a site."""
    q, v, a, p00, p01, p02, p11, p12, p22 = x
    kept = 1.0 / (1.0 + precision * p00)
    e = (pull + precision * (centre - q)) * kept
    g = precision * kept
    return (
        q + p00 * e,
        v + p01 * e,
        a + p02 * e,
        p00 * kept,
        p01 * kept,
        p02 * kept,
        p11 - g * p01 * p01,
        p12 - g * p01 * p02,
        p22 - g * p02 * p02,
    )


def _together(x: tuple, y: tuple) -> tuple[float, float]:
    """Return (mean, variance) of the position from the messages `x` and `y` together.

    The variance is the first element of P_x (P_x + P_y)^-1 P_y; `y` is of the reversed record.
    """
    s00, s01, s02 = x[3] + y[3], x[4] - y[4], x[5] + y[5]
    s11, s12, s22 = x[6] + y[6], x[7] - y[7], x[8] + y[8]
    l00 = math.sqrt(s00)  # Cholesky: s = l l'
    l10, l20 = s01 / l00, s02 / l00
    l11 = math.sqrt(max(s11 - l10 * l10, SURE * s11))
    l21 = (s12 - l20 * l10) / l11
    l22 = math.sqrt(max(s22 - l20 * l20 - l21 * l21, SURE * s22))
    b0 = x[3] / l00
    b1 = (x[4] - l10 * b0) / l11
    b2 = (x[5] - l20 * b0 - l21 * b1) / l22
    w2 = b2 / l22
    w1 = (b1 - l21 * w2) / l11
    w0 = (b0 - l10 * w1 - l20 * w2) / l00
    variance = w0 * y[3] - w1 * y[4] + w2 * y[5]
    mean = x[0] + w0 * (y[0] - x[0]) + w1 * (-y[1] - x[1]) + w2 * (y[2] - x[2])
    return mean, max(variance, SURE * min(x[3], y[3]))


def _scale(mean: float, variance: float, precision: float, pull: float) -> float:
    """Return the log of the integral of a Gaussian times a site."""
    grown = 1.0 + precision * variance
    return -0.5 * (
        math.log(grown)
        + (precision * mean * mean - 2.0 * pull * mean - pull * pull * variance) / grown
    )


def towards(
    x: tuple, steps: Array, centres: Array, jerk: float, sites: Array, messages: Array
) -> None:
    """Compute the messages of one direction along a stretch, with fixed sites."""
    for i in range(len(centres)):
        if i > 0:
            x = predict(x, steps[i], jerk)
        for j in range(9):
            messages[i, j] = x[j]
        if centres[i] == centres[i]:
            x = _absorb(x, centres[i], sites[i, 0], sites[i, 1])


def sweep(
    x: tuple,
    steps: Array,
    centres: Array,
    half: float,
    noise: float,
    jerk: float,
    messages: Array,
    sites: Array,
) -> float:
    """Update every site along one direction of a stretch, with the other direction's messages.

    Return the log of the probability of all readings, which is correct once the sites converged.

    Parameters
    ----------
    x : the state before the first reading.
    steps : shape (n,), time since the reading before [s]; the first is not used.
    centres : shape (n,), middles of the cells; nan: no reading.
    messages : shape (n, 9), of the other way; filled with those of this way.
    sites : shape (n, 2), (precision, pull); used and replaced.
    """
    log_z = 0.0
    for i in range(len(centres)):
        if i > 0:
            x = predict(x, steps[i], jerk)
        centre = centres[i]
        if centre == centre:
            other = (
                messages[i, 0],
                messages[i, 1],
                messages[i, 2],
                messages[i, 3],
                messages[i, 4],
                messages[i, 5],
                messages[i, 6],
                messages[i, 7],
                messages[i, 8],
            )
            mean, variance = _together(x, other)
            mean -= centre
            precision, pull, found = site(mean, variance, half, noise)
            sites[i, 0] = precision
            sites[i, 1] = pull
            log_z += found - _scale(mean, variance, precision, pull)
            log_z += _scale(x[0] - centre, x[3], precision, pull)
        for j in range(9):
            messages[i, j] = x[j]
        if centre == centre:
            x = _absorb(x, centre, sites[i, 0], sites[i, 1])
    return log_z
