# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The frequencies on which a choice rests, by low-passing the reference without phase.

The low-pass is a Butterworth filter of fourth order run forward and backward: its gain is
1 / (1 + (f / f_c)^8). It acts on the samples as if they were even, at their median sample time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STAYS = 1.05  # a choice rests on a frequency if it costs more than this without it
HIGHEST, LOWEST = 0.45, 0.5  # the search begins at this part of the sample rate and ends here [Hz]
STEP = 1.25  # from one frequency to the next
FINE = 1.02  # ratio of neighbouring bins of a spectrum


def gain(frequency: Array, corner: float) -> Array:
    """Return the gain of the low-pass with this corner [Hz]."""
    return 1.0 / (1.0 + (frequency / corner) ** 8)


def low_passed(values: Array, rate: float, corner: float) -> Array:
    """Return the values low-passed without phase.

    Parameters
    ----------
    values : shape (n,), finite. rate : of the samples [Hz]. corner : [Hz].
    """
    if 2.0 * corner >= 0.9 * rate or len(values) < 4:
        return values
    line, spectrum, frequency = _odd(values, rate)
    smooth = np.fft.irfft(spectrum * gain(frequency, corner), 2 * len(values))
    return line + smooth[: len(values)]


def _odd(values: Array, rate: float) -> tuple[Array, NDArray[np.complex128], Array]:
    """Return (line through the ends, spectrum without it, extended as an odd function, [Hz])."""
    count = len(values)
    line = np.linspace(values[0], values[-1], count)
    rest = values - line
    frequency: Array = np.fft.rfftfreq(2 * count, 1.0 / rate).astype(np.float64)
    return line, np.fft.rfft(np.concatenate([rest, -rest[::-1]])), frequency


def rests_on(errors: Array, reference: Array, chosen: int, rate: float) -> float:
    """Return the lowest frequency [Hz] that the choice needs.

    Without the reference's motion above it the choice would cost at most 5 % more than the best.

    Parameters
    ----------
    errors : shape (m, n), estimates minus reference. reference : shape (n,).
    chosen : index of the chosen estimate.
    """
    count = _smooth_length(errors.shape[1])
    errors, reference = errors[:, :count], reference[:count]
    _, spectrum, frequency = _odd(reference, rate)
    power, cross, centre = _binned(errors, spectrum, frequency)
    own = np.mean(errors**2, axis=1)
    rests = HIGHEST * rate
    corner = rests
    while corner > LOWEST:
        lost = 1.0 - gain(centre, corner)
        squares = own + cross @ lost + power @ lost**2
        if squares[chosen] > STAYS**2 * np.min(squares):
            break
        rests, corner = corner, corner / STEP
    return rests


def _binned(
    errors: Array, spectrum: NDArray[np.complex128], frequency: Array
) -> tuple[Array, Array, Array]:
    """Return by bins of frequency: the mean square of the reference, twice its mean product with
    each error (shape (m, bins)), and the frequency of the bins [Hz]; by Parseval's theorem.
    """
    count = errors.shape[1]
    bins = np.zeros(len(frequency), np.int64)
    bins[1:] = 1 + (np.log(frequency[1:] / frequency[1]) / np.log(FINE)).astype(np.int64)
    weight = np.full(len(frequency), 2.0)
    weight[0] = weight[-1] = 1.0
    weight /= 2.0 * count * count
    power: Array = np.bincount(bins, 0.5 * weight * np.abs(spectrum) ** 2).astype(np.float64)
    cross = np.array(
        [
            np.bincount(
                bins, 2.0 * weight * (np.conj(np.fft.rfft(each, 2 * count)) * spectrum).real
            )
            for each in errors
        ]
    )
    width = np.bincount(bins)
    centre = np.bincount(bins, frequency) / np.maximum(width, 1)
    return power, cross, centre


def _smooth_length(count: int) -> int:
    """Return the largest number up to `count` whose prime factors are 2, 3 and 5: quick FFTs."""
    best = 1
    two = 1
    while two <= count:
        three = two
        while three <= count:
            five = three
            while five <= count:
                best = max(best, five)
                five *= 5
            three *= 3
        two *= 2
    return best
