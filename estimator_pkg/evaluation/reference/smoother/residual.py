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
CLEAR_POWER = 1.5  # a power above this multiple of the white level is a vibration
TONES, TONE_BINS = 4, 3.0  # of the quantiser at a steady speed: number, width
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


def recover_vibration(
    parts: list[Piece], count: int, quantum: float, speed: float = math.nan
) -> tuple[Array, float]:
    """Return (the velocity in the residual [rad/s], shape (n,), its mean frequency [Hz]).

    One white jerk fits a slow motion or a vibration on it, not both. The vibration then remains in
    the residual, where its spectrum rises above that of white noise. A Wiener filter takes it out
    (Wiener, Extrapolation, Interpolation, and Smoothing of Stationary Time Series, 1949); its
    derivative is the velocity. The frequency is nan if nothing stands out.

    Parameters
    ----------
    parts : of the readings minus smoothed positions [rad]; 0 for an outlier.
    count : n. quantum : of the readings [rad].
    speed : of a steady motion [rad/s], whose tones of the quantiser are no vibration: multiples of
        the quanta per reading, modulo the sample rate; nan: the motion is not steady.
    """
    velocity = np.zeros(count)
    hop = SPECTRUM_WINDOW // 2
    window = np.sqrt(
        np.hanning(SPECTRUM_WINDOW + 1)[:SPECTRUM_WINDOW]
    )  # twice: halves that overlap add up to one
    jobs, powers = [], []
    for part in parts:
        padded = np.concatenate([np.zeros(hop), part.readings, np.zeros(SPECTRUM_WINDOW + hop)])
        starts = np.arange(0, len(part.readings) + hop, hop)
        spectra = np.fft.rfft(window * padded[starts[:, None] + np.arange(SPECTRUM_WINDOW)])
        jobs.append((part, spectra))
        powers.append(np.abs(spectra) ** 2)
    if not jobs:
        return velocity, math.nan
    power = np.concatenate(powers).mean(axis=0)
    quantised = quantum**2 / 12.0 * float(np.sum(window * window))
    white = max(float(np.median(power[1:])), quantised)
    gain = np.where(power > CLEAR_POWER * white, 1.0 - white / np.maximum(power, 1e-300), 0.0)
    gain[0] = gain[-1] = 0.0
    tone = speed / quantum * float(np.mean(jobs[0][0].steps[1:])) if quantum else math.nan
    if not math.isnan(tone):
        multiples = tone * np.arange(1, TONES + 1)
        places = np.abs(multiples - np.rint(multiples)) * SPECTRUM_WINDOW
        own = np.abs(np.arange(len(gain)) - places[:, None]) < TONE_BINS
        gain[own.any(axis=0)] = 0.0
    for part, spectra in jobs:
        omega = 2.0 * math.pi * np.fft.rfftfreq(SPECTRUM_WINDOW, float(np.median(part.steps[1:])))
        pieces = window * np.fft.irfft(spectra * (1j * omega * gain), SPECTRUM_WINDOW)
        found = np.zeros(len(part.readings) + SPECTRUM_WINDOW + 2 * hop)
        for number, piece in enumerate(pieces):
            found[number * hop : number * hop + SPECTRUM_WINDOW] += piece
        velocity[part.rows] = found[hop : hop + len(part.readings)]
    weight = gain * power * omega**2
    total = float(np.sum(weight))
    return velocity, float(np.sum(omega * weight) / (2.0 * math.pi * total)) if total else math.nan
