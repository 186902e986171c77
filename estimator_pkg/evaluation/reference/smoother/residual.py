# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The residual of the smoother: white noise, or motion that it did not follow."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.reference.smoother.pieces import Piece

Array = NDArray[np.float64]

SPECTRUM_WINDOW = 128  # readings in a window of the spectrum
OVER_WHITE = 2.0  # the spectrum of white noise stays below this multiple of its level
NEWS = 0.1  # a window counts if its readings have this fraction of the largest weight


def unexplained(
    parts: list[Piece], rest: list[Array], weights: list[Array], quantised: float
) -> float:
    """Return the rms speed of the part of `rest` above white noise [rad/s].

    Power spectral density over half-overlapping windows. The part above `OVER_WHITE` times the
    white level (the median, but at least that of the quantisation) counts as motion. Readings count
    by their weight, and windows without information (a count that does not change) count as rest.

    Parameters
    ----------
    rest : shape (n,) each, readings minus smoothed positions [rad]; nan: none.
    weights : shape (n,) each, their inverse variances; quantised : fraction of these variances
        due to quantisation.
    """
    step = float(np.median(np.concatenate([part.steps[1:] for part in parts])))
    heaviest = max((float(np.max(each)) for each in weights if len(each)), default=0.0)
    window = np.hanning(SPECTRUM_WINDOW)
    power, level = np.zeros(SPECTRUM_WINDOW // 2 + 1), 0.0
    count, telling = 0, 0
    for left, weight in zip(rest, weights):
        if len(left) < SPECTRUM_WINDOW:
            continue
        pushed = np.where(weight > 0.0, np.nan_to_num(left) * weight, 0.0)
        mean = _windows(weight).mean(axis=1)
        heavy = mean > NEWS * heaviest
        count, telling = count + len(mean), telling + int(np.count_nonzero(heavy))
        pieces = _windows(pushed)[heavy] / mean[heavy, None]
        pieces -= pieces.mean(axis=1)[:, None]
        power += np.sum(np.abs(np.fft.rfft(window * pieces)) ** 2, axis=0)
        level += float(np.sum(1.0 / mean[heavy]))
    if not telling:
        return 0.0
    power *= 2.0 * step / (telling * float(np.sum(window * window)))
    frequency = np.fft.rfftfreq(SPECTRUM_WINDOW, step)
    white = max(quantised * 2.0 * step * level / telling, float(np.median(power)))
    excess = np.maximum(power - OVER_WHITE * white, 0.0)
    speed = float(np.sum((2.0 * math.pi * frequency) ** 2 * excess)) * frequency[1]
    return math.sqrt(speed * telling / count)


def _windows(values: Array) -> Array:
    """Return the half-overlapping windows of an array, shape (windows, SPECTRUM_WINDOW)."""
    return np.lib.stride_tricks.sliding_window_view(values, SPECTRUM_WINDOW)[
        :: SPECTRUM_WINDOW // 2
    ]
