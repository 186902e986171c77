# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What one reading of a counter shows of the angle: an interval, and how a Gaussian meets it.

A count says that the angle lies in its cell, no more. Two counts in a row say more: the cell
before, moved by the predicted motion, and the cell now both hold the angle, and so does what they
have in common. At low speed that is the stretch just behind the edge that was crossed, as long as
the way made in one sample; near any whole number of counts per sample it is the same in a frame
that moves along, which is why a beat of speed and sampling is no different from creep.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.constants import SIGMAS

ROOT_HALF = math.sqrt(0.5)
DENSITY = 1.0 / math.sqrt(2.0 * math.pi)
TAIL_SIGMAS = 6.0  # sigmas from which the tail's own series is used: erfc's digits would cancel
THIN = 1e-3  # an interval thinner than this part of sigma is a point; the least part of a variance

NO_INFORMATION = 0  # the reading has no news for the prediction
MEASURED = 1  # a measurement: centre, half width
MISSING_EDGE = 2  # the prediction has left the cell, and no edge came


def within(e: float, half: float, sigma: float) -> tuple[float, float]:
    """Return the mean, and the variance over sigma^2, of N(0, sigma^2) cut off at e -+ half."""
    a, b = (e - half) / sigma, (e + half) / sigma
    side = sigma
    if a + b < 0.0:
        a, b, side = -b, -a, -sigma
    width = b - a
    if width < THIN:
        return side * (a + 0.5 * width), width * width / 12.0
    if a > TAIL_SIGMAS:
        if width * a > 2.0:
            return side * (a + 1.0 / a), 1.0 / (a * a)
        return side * (a + 0.5 * width), width * width / 12.0
    inside = 0.5 * (math.erfc(a * ROOT_HALF) - math.erfc(b * ROOT_HALF))
    at_a = DENSITY * math.exp(-0.5 * a * a)
    at_b = DENSITY * math.exp(-0.5 * b * b)
    mean = (at_a - at_b) / inside
    ratio = 1.0 + (a * at_a - b * at_b) / inside - mean * mean
    least = THIN * THIN
    return side * mean, (ratio if ratio > least else least)


def interval(
    innovation: float,
    unpredicted: float,
    quantum: float,
    variance: float,
    noise: float,
    flickers: bool,
) -> tuple[int, float, float]:
    """Return what this reading shows: (kind, centre less prediction, half width) [rad].

    Parameters
    ----------
    innovation : cell's centre minus predicted angle [rad].
    unpredicted : change of the reading minus predicted motion [rad].
    quantum : size of the cell [rad].
    variance : of the predicted angle [rad^2]. Above quantum^2/12 the cell alone is news.
    noise : variance of the edges [rad^2].
    flickers : noise crosses an edge more often than the angle does: no edge is a time. But the
        whole cell is news as soon as `SIGMAS` of the noise reach out of it.
    """
    half = 0.5 * quantum
    if 12.0 * variance > quantum * quantum:
        return MEASURED, innovation, half
    edges = math.sqrt(noise)
    hold = SIGMAS * edges
    if flickers:
        near = half - hold
        beyond = innovation > near or innovation < -near
        return MEASURED if beyond else NO_INFORMATION, innovation, half
    if unpredicted > half or unpredicted < -half:
        side = half if unpredicted > 0.0 else -half
        width = quantum - abs(unpredicted)
        if width > -quantum:  # else the speed is not what was thought: the cell alone
            width = (width if width > 0.0 else 0.0) + edges
            if width < quantum:
                centre = innovation - side + math.copysign(0.5 * width, unpredicted)
                return MEASURED, centre, 0.5 * width
        return MEASURED, innovation, half
    if innovation > half + hold or innovation < -half - hold:
        return MISSING_EDGE, innovation, half
    return NO_INFORMATION, innovation, half
