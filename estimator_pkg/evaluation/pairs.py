# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Test whether one estimate is better than another: a confidence interval over blocks of time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONFIDENCE = 0.95  # of a declared pair
MOST_BLOCKS = 40  # of a record, at most
SHORTEST_TIME = 0.25  # length of a block [s], at least
FEWEST_BLOCKS = 8  # blocks of a record, whatever their length
EIGHTH = 8  # events are few if they are in one of so many blocks at most


class Difference(NamedTuple):
    """Mean of the difference of two squared errors, and its half confidence interval.

    sign : 1: the first estimate is better, -1: the second, 0: not known.
    """

    mean: float
    half: float
    sign: int = 0


def blocks(time: Array) -> NDArray[np.int64]:
    """Return the number of each sample's block, from 0; shape (n,).

    Parameters
    ----------
    time : shape (n,), increasing [s].
    """
    length = float(time[-1] - time[0])
    count = int(min(MOST_BLOCKS, max(FEWEST_BLOCKS, length / SHORTEST_TIME)))
    return np.minimum(((time - time[0]) / length * count).astype(np.int64), count - 1)


def of_sums(sums: Sequence[NDArray], counts: Sequence[NDArray]) -> Difference:
    """Return the mean difference of two squared errors, from their sums over blocks of records.

    Blocks without samples are ignored.

    One array of shape (number of blocks,) for each record: sums [(rad/s)^2], counts.

    The sum over blocks has the variance of the blocks, and the covariance of neighbours if it is
    positive. Its quantile is Student's.
    """
    filled = [count > 0 for count in counts]
    number = sum(int(np.count_nonzero(each)) for each in filled)
    total = float(sum(np.sum(count) for count in counts))
    if number < 2:
        return Difference(math.nan, math.inf)
    mean = float(sum(np.sum(each) for each in sums)) / total
    variance = 0.0
    for each, count, full in zip(sums, counts, filled):
        rest = each[full] - mean * count[full]
        variance += float(rest @ rest) + 2.0 * max(0.0, float(rest[1:] @ rest[:-1]))
    error = math.sqrt(variance * number / (number - 1)) / total
    half = student(number - 1) * error
    return Difference(mean, half, 0 if abs(mean) <= half else (1 if mean < 0.0 else -1))


def agreed(sums: Sequence[Sequence[NDArray]], counts: Sequence[NDArray]) -> Difference:
    """Return the difference against the first of some references.

    Its sign is 0 unless all of them agree, and its interval is the longest.

    Parameters
    ----------
    sums : for each reference, those of `of_sums`, shape (blocks,). counts : as of `of_sums`.
    """
    tests = [of_sums(each, counts) for each in sums]
    alike = len({each.sign for each in tests}) == 1
    return Difference(
        tests[0].mean, max(each.half for each in tests), tests[0].sign if alike else 0
    )


def events(sums: NDArray) -> NDArray[np.int64]:
    """Return the blocks that make half of the difference of two squared errors, if they are few.

    Empty if these are more than an eighth of the blocks.

    Parameters
    ----------
    sums : shape (blocks,), difference of the sums of squared errors.
    """
    size = np.abs(sums)
    order = np.argsort(-size)
    count = 1 + int(np.searchsorted(np.cumsum(size[order]), 0.5 * np.sum(size)))
    return np.sort(order[:count]) if count <= max(1, len(sums) // EIGHTH) else order[:0]


def student(degrees: int) -> float:
    """Return the two-sided quantile of Student's t; within 0.1 % from 7 degrees of freedom on.

    Abramowitz and Stegun, Handbook of Mathematical Functions, 26.7.5.
    """
    z = NormalDist().inv_cdf(0.5 + 0.5 * CONFIDENCE)
    return (
        z
        + (z**3 + z) / (4.0 * degrees)
        + (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / (96.0 * degrees**2)
        + (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / (384.0 * degrees**3)
    )
