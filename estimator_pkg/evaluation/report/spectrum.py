# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Views of an error: over frequency, and over speed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPECTRUM_WINDOW = 2048  # samples of a window of the spectrum, or a quarter of the record
BINS = 24  # of speed
BIN_FEWEST = 5  # bins of speed with fewer samples are skipped


def density(time: Array, error: Array) -> tuple[Array, Array]:
    """Return (frequency [Hz], root of the power density [(rad/s)/sqrt Hz]) of an error.

    The samples are put on an even grid (the error is constant across gaps); Hann windows overlap by
    half. Both have shape (k,), k = 0 for too few samples.

    Parameters
    ----------
    time : shape (n,), increasing [s].
    error : shape (n,) [rad/s]; nan: none.
    """
    good = np.isfinite(error)
    time, error = time[good], error[good]
    if len(time) < 64:
        return np.zeros(0), np.zeros(0)
    step = float(np.median(np.diff(time)))
    count = min(len(time), int((time[-1] - time[0]) / step) + 1)
    # gaps are cut out: a record of pieces keeps its samples, not its pauses
    if count > 2 * len(time) or np.max(np.diff(time)) > 20.0 * step:
        even = error
    else:
        even = np.interp(time[0] + step * np.arange(count), time, error)
    size = min(SPECTRUM_WINDOW, 1 << (len(even) // 4).bit_length() - 1)
    size = max(size, 32)
    window = np.hanning(size)
    power: Array = np.zeros(size // 2 + 1)
    pieces = 0
    for at in range(0, len(even) - size + 1, size // 2):
        power += np.abs(np.fft.rfft(window * even[at : at + size])) ** 2
        pieces += 1
    if not pieces:
        return np.zeros(0), np.zeros(0)
    power *= 2.0 * step / (pieces * float(np.sum(window * window)))
    return np.arange(1, size // 2 + 1) / (size * step), np.sqrt(power[1:])


def by_speed(truth: Array, error: Array) -> tuple[Array, Array]:
    """Return (speed, rms error) [rad/s] over bins of true speed, each of shape (k,)."""
    good = np.isfinite(truth) & np.isfinite(error)
    truth, error = truth[good], error[good]
    if len(truth) < BIN_FEWEST:
        return np.zeros(0), np.zeros(0)
    order = np.argsort(truth, kind='stable')
    parts = [
        part
        for part in np.array_split(order, min(BINS, max(1, len(order) // BIN_FEWEST)))
        if len(part)
    ]
    return (
        np.array([np.mean(truth[part]) for part in parts]),
        np.array([np.sqrt(np.mean(error[part] ** 2)) for part in parts]),
    )
