# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sampled signals: slopes, values between samples, wrapped differences, a low-pass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def slopes(time: Array, values: Array) -> Array:
    """Return, at each sample, the slope of the parabola through it and its neighbours.

    Parameters
    ----------
    time : shape (n,), strictly increasing [s].
    values : shape (n,).
    """
    if len(time) < 3:
        return np.gradient(values, time) if len(time) == 2 else np.zeros(len(time))
    return np.gradient(values, time, edge_order=2)


def cubic(time: Array, values: Array, at: Array, slope: Array | None = None) -> Array:
    """Return `values` at the times `at`, by cubic Hermite interpolation (exact at the samples).

    Parameters
    ----------
    time : shape (n,), strictly increasing [s].
    values : shape (n,).
    at : shape (m,) [s]; outside the samples the result is the value at the nearer end.
    slope : shape (n,), `slopes` of the values, if they are already known.
    """
    if len(time) < 2:
        return np.full(len(at), values[0] if len(values) else np.nan)
    if slope is None:
        slope = slopes(time, values)
    right = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    left = right - 1
    width = time[right] - time[left]
    part = np.clip((at - time[left]) / width, 0.0, 1.0)
    rest = 1.0 - part
    return (
        values[left] * rest * rest * (1.0 + 2.0 * part)
        + values[right] * part * part * (1.0 + 2.0 * rest)
        + width * part * rest * (slope[left] * rest - slope[right] * part)
    )


def wrapped(difference: Array, period: float) -> Array:
    """Return `difference`, shape (n,), in [-period/2, period/2); unchanged if `period` is 0."""
    if period <= 0.0:
        return difference
    return difference - period * np.floor(difference / period + 0.5)


def low_passed(values: Array, rate: float, corner: float) -> Array:
    """Return the values low-passed without phase, as if their samples were even.

    A Butterworth filter of fourth order, forward and backward: its gain is 1 / (1 + (f / f_c)^8).

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
