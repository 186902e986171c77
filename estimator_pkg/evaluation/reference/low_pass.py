# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A low-pass without phase: a Butterworth filter of fourth order run forward and backward.

Its gain is 1 / (1 + (f / f_c)^8). It acts on samples as if they were even, at their median time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def gain(frequency: Array, corner: float) -> Array:
    """Return the gain of the low-pass with this corner [Hz] at each frequency [Hz], shape (n,)."""
    return 1.0 / (1.0 + (frequency / corner) ** 8)


def low_passed(values: Array, rate: float, corner: float) -> Array:
    """Return the values low-passed without phase.

    Parameters
    ----------
    values : shape (n,), finite. rate : of the samples [Hz]. corner : [Hz].
    """
    if 2.0 * corner >= 0.9 * rate or len(values) < 4:
        return values
    line, spectrum, frequency = odd(values, rate)
    smooth = np.fft.irfft(spectrum * gain(frequency, corner), 2 * len(values))
    return line + smooth[: len(values)]


def odd(values: Array, rate: float) -> tuple[Array, NDArray[np.complex128], Array]:
    """Return (line through the ends, spectrum without it, extended as an odd function, [Hz]).

    `values` and the line have shape (n,); `rate` [Hz].
    """
    count = len(values)
    line = np.linspace(values[0], values[-1], count)
    rest = values - line
    frequency: Array = np.fft.rfftfreq(2 * count, 1.0 / rate).astype(np.float64)
    return line, np.fft.rfft(np.concatenate([rest, -rest[::-1]])), frequency
