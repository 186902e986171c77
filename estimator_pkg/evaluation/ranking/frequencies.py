# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The frequencies on which a choice rests, by low-passing the reference without phase."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.reference.low_pass import gain, odd

Array = NDArray[np.float64]

STAYS = 1.05  # a choice rests on a frequency if it costs more than this without it
HIGHEST, LOWEST = 0.45, 0.5  # the search begins at this part of the sample rate and ends here [Hz]
STEP = 1.25  # from one frequency to the next
FINE = 1.02  # ratio of neighbouring bins of a spectrum


class Frequencies(NamedTuple):
    """An estimate against its reference, by bins of frequency.

    square : mean square of the error. power : mean square of the reference. cross : twice the mean
    product of both. centre : of the bins [Hz]. The last three have shape (bins,).
    """

    square: float
    power: NDArray
    cross: NDArray
    centre: NDArray

    @classmethod
    def of(cls, estimate: Array, reference: Array, rate: float) -> Frequencies:
        """Return these of arrays of shape (n,) at this sample rate [Hz], by Parseval's theorem."""
        count = _smooth_length(len(reference))
        error, reference = (estimate - reference)[:count], reference[:count]
        _, spectrum, frequency = odd(reference, rate)
        bins = np.zeros(len(frequency), np.int64)
        bins[1:] = 1 + (np.log(frequency[1:] / frequency[1]) / np.log(FINE)).astype(np.int64)
        weight = np.full(len(frequency), 1.0 / (count * count))
        weight[[0, -1]] *= 0.5  # these two are in the spectrum once, the others twice
        product = (np.conj(np.fft.rfft(error, 2 * count)) * spectrum).real
        return cls(
            float(np.mean(error**2)),
            np.bincount(bins, 0.5 * weight * np.abs(spectrum) ** 2),
            np.bincount(bins, 2.0 * weight * product),
            np.bincount(bins, frequency) / np.maximum(np.bincount(bins), 1),
        )

    def against(self, corner: float) -> float:
        """Return the mean square error against the reference low-passed at `corner` [Hz]."""
        lost = 1.0 - gain(self.centre, corner)
        return self.square + float(self.cross @ lost + self.power @ lost**2)


def rests_on(ranked: Sequence[Frequencies], rate: float) -> float:
    """Return the lowest frequency [Hz] that the choice of the first of these estimates needs.

    Without the reference's motion above it the choice would cost at most 5 % more than the best.
    nan if it costs no more without any motion above `LOWEST`.
    """
    rests = corner = HIGHEST * rate
    while corner > LOWEST:
        squares = [each.against(corner) for each in ranked]
        if squares[0] > STAYS**2 * min(squares):
            return rests
        rests, corner = corner, corner / STEP
    return math.nan


@cache
def _smooth_length(count: int) -> int:
    """Return the largest number up to `count` whose prime factors are 2, 3 and 5: quick FFTs."""
    powers = ([factor**k for k in range(count.bit_length())] for factor in (2, 3, 5))
    return max(each for each in map(math.prod, product(*powers)) if each <= count)
