# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A low-pass without phase: a Butterworth filter of fourth order run forward and backward.

Its gain is 1 / (1 + (f / f_c)^8). It acts on samples as if they were even, at their median time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def low_passed(values: Array, rate: float, corner: float) -> Array:
    """Return the values low-passed without phase.

    Parameters
    ----------
    values : shape (n,), finite. rate : of the samples [Hz]. corner : [Hz].
    """
    count = len(values)
    if 2.0 * corner >= 0.9 * rate or count < 4:
        return values
    line = np.linspace(values[0], values[-1], count)
    rest = values - line
    odd = np.concatenate([rest, -rest[::-1]])
    gain = 1.0 / (1.0 + (np.fft.rfftfreq(2 * count, 1.0 / rate) / corner) ** 8)
    return np.asarray(line + np.fft.irfft(np.fft.rfft(odd) * gain, 2 * count)[:count])
