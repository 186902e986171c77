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
is the filter of the reversed record, in which only the sign of the speed differs. All functions are
in the subset that the engine has.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.reference.smoother.steps import (
    SmootherState,
    correct,
    get,
    predict,
    put,
)

Array = NDArray[np.float64]

FAR_OUTSIDE = -20.0  # beyond this many standard deviations outside the cell, a series is used
ROOT_2 = math.sqrt(2.0)
ROOT_2_PI = math.sqrt(2.0 * math.pi)
LEAST_PART = 1e-12  # smallest fraction of a variance that remains


def site(
    mean: float, variance: float, half: float, noise: float, counted: bool = True
) -> tuple[float, float, float]:
    """Return (precision, pull, log of the probability, if `counted`) of a cell for a Gaussian.

    Parameters
    ----------
    mean, variance : of the Gaussian, relative to the centre of the cell.
    half : half of the width of the cell; noise : standard deviation of its blur.
    """
    sign = 1.0 if mean >= 0.0 else -1.0
    known = 1.0 / (variance + noise * noise)
    per = math.sqrt(known)  # inverse of the standard deviation of position plus blur
    low, high = (-half - sign * mean) * per, (half - sign * mean) * per
    log_z = 0.0
    if high < FAR_OUTSIDE:  # one-sided: the far end is out of reach
        h = -high
        ratio = h + 1.0 / h - 2.0 / (h * h * h)
        d, f = -ratio, ratio * (ratio + high)
        if counted:
            log_z = -0.5 * h * h - math.log(ROOT_2_PI * h)
    else:
        z = max(0.5 * (math.erfc(-high / ROOT_2) - math.erfc(-low / ROOT_2)), 1e-300)
        density = 1.0 / (ROOT_2_PI * z)
        at_low = math.exp(-0.5 * low * low) * density
        at_high = math.exp(-0.5 * high * high) * density
        d = at_low - at_high
        f = d * d - (low * at_low - high * at_high)
        if counted:
            log_z = math.log(z)
    f = min(max(f, 0.0), 1.0)
    precision = f * known / max(1.0 - variance * known * f, LEAST_PART)
    shift = sign * d * per
    return precision, precision * (mean + variance * shift) + shift, log_z


def _together(x: SmootherState, y: SmootherState) -> tuple[float, float]:
    """Return (mean, variance) of the position from the messages `x` and `y` together.

    The variance is the first element of P_x (P_x + P_y)^-1 P_y; `y` is of the reversed record.
    """
    s00, s01, s02 = x.p00 + y.p00, x.p01 - y.p01, x.p02 + y.p02
    s11, s12, s22 = x.p11 + y.p11, x.p12 - y.p12, x.p22 + y.p22
    r0 = 1.0 / s00  # s = l d l', with r = 1 / d
    l10, l20 = s01 * r0, s02 * r0
    r1 = 1.0 / max(s11 - l10 * s01, LEAST_PART * s11)
    d21 = s12 - l20 * s01
    l21 = d21 * r1
    r2 = 1.0 / max(s22 - l20 * s02 - l21 * d21, LEAST_PART * s22)
    b1 = x.p01 - l10 * x.p00
    w2 = (x.p02 - l20 * x.p00 - l21 * b1) * r2
    w1 = b1 * r1 - l21 * w2
    w0 = x.p00 * r0 - l10 * w1 - l20 * w2
    variance = w0 * y.p00 - w1 * y.p01 + w2 * y.p02
    mean = x.q + w0 * (y.q - x.q) + w1 * (-y.v - x.v) + w2 * (y.a - x.a)
    return mean, max(variance, LEAST_PART * min(x.p00, y.p00))


def _scale(mean: float, variance: float, precision: float, pull: float) -> float:
    """Return the log of the integral of a Gaussian times a site."""
    grown = 1.0 + precision * variance
    return -0.5 * (
        math.log(grown)
        + (precision * mean * mean - 2.0 * pull * mean - pull * pull * variance) / grown
    )


def along(
    start: SmootherState,
    count: int,
    gaps: Array,
    centres: Array,
    half: float,
    noise: float,
    jerk: float,
    sites: Array,
    messages: Array,
    passes: int,
) -> float:
    """Sweep to and fro along a stretch, and update the sites in all `passes` but the first.

    Each direction replaces the messages of the other. Return the log of the probability of all
    readings in the last pass. Its error is of the second order in that of the sites: they maximise
    it.

    Parameters
    ----------
    start : state at either end of the stretch, relative to its cell.
    gaps : shape (count + 1,), time from the start of the stretch to the first cell, between cells,
        and from the last cell to the end [s].
    centres : shape (count,), middles of the cells.
    sites : shape (count, 2), (precision, pull), to begin with, and the result.
    messages : shape (count, SIZE), filled.
    """
    log_z, way = 0.0, -1
    x = SmootherState()
    y = SmootherState()
    for turn in range(passes):
        last = turn == passes - 1
        x.take(start)
        x.q = centres[0] if way > 0 else centres[count - 1]
        for k in range(count):
            i = k if way > 0 else count - 1 - k
            predict(x, gaps[i] if way > 0 else gaps[i + 1], jerk)
            centre = centres[i]
            if turn > 0:
                get(y, messages, i)
                mean, variance = _together(x, y)
                mean -= centre
                precision, pull, found = site(mean, variance, half, noise, last)
                sites[2 * i], sites[2 * i + 1] = precision, pull
                if last:
                    log_z += found - _scale(mean, variance, precision, pull)
                    log_z += _scale(x.q - centre, x.p00, precision, pull)
            put(messages, i, x)
            weight = sites[2 * i]
            correct(x, sites[2 * i + 1] + weight * (centre - x.q), weight)
        way = -way
    return log_z


def used(
    count: int,
    readings: Array,
    steps: Array,
    quantum: float,
    drift: float,
    of_a_run: float,
    rows: NDArray[np.int64],
    gaps: Array,
) -> int:
    """Choose the cells of a stretch that are used; return their number n.

    In a run of equal readings these are the first, the last, and as many between as are
    informative: about `of_a_run`, and at least one in `drift` readings.

    Parameters
    ----------
    readings : shape (count,), middles of the cells [rad]; nan is not a cell.
    steps : shape (count,), time from the reading before [s]; the first is not used.
    rows : shape (count,), its first n filled with the indices of the cells.
    gaps : shape (count + 1,), its first n + 1 filled with the times of `along` [s].
    """
    found, first, since = 0, 0, 0.0
    while first < count:
        end = first + 1
        while end < count and abs(readings[end] - readings[end - 1]) < 0.5 * quantum:
            end += 1
        every = max(1, int(min((end - first) / of_a_run, drift)))
        for i in range(first, end):
            if i > 0:
                since += steps[i]
            if readings[i] == readings[i] and ((i - first) % every == 0 or i == end - 1):
                rows[found] = i
                gaps[found] = since
                since = 0.0
                found += 1
        first = end
    gaps[found] = since
    return found
