# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Recover the vibration that the smoother took for noise of the readings.

One white jerk fits a slow motion or a vibration on it, not both. The vibration then remains in the
residual, where its spectrum rises above that of white noise. A Wiener filter takes it out (Wiener,
Extrapolation, Interpolation, and Smoothing of Stationary Time Series, 1949), and its derivative is
added to the velocity.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.reference.smoother.pieces import cut
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed

Array = NDArray[np.float64]

SPECTRUM_WINDOW = 128  # readings in a window of the spectrum
CLEAR_POWER = 1.5  # a power above this multiple of the white level is motion
UNEXPLAINED_PART = 0.5  # least fraction of the uncertainty that `unexplained` must be,
LEAST_NOISE = 12.0**-0.5  # and least noise beyond the quantisation, in quanta: else it is tones


def needed(smoothed: Smoothed) -> bool:
    """Return True if the residual has a motion that is not the quantiser's own tones."""
    noise = smoothed.noise
    room = math.sqrt(max(noise.reading**2 - noise.quantum**2 / 12.0, 0.0))
    return (
        smoothed.unexplained > UNEXPLAINED_PART * smoothed.uncertainty
        and room >= LEAST_NOISE * noise.quantum
    )


def recover_vibration(smoothed: Smoothed, rest: Array) -> tuple[Array, float]:
    """Return (the velocity in the residual [rad/s], shape (n,), its mean frequency [Hz]).

    The frequency is nan if nothing stands out.

    Parameters
    ----------
    rest : shape (n,), readings minus smoothed positions [rad]; 0 for an outlier.
    """
    velocity = np.zeros(len(rest))
    hop = SPECTRUM_WINDOW // 2
    window = np.sqrt(
        np.hanning(SPECTRUM_WINDOW + 1)[:SPECTRUM_WINDOW]
    )  # twice: halves that overlap add up to one
    jobs, powers = [], []
    for part in cut(smoothed.stamps, rest):
        padded = np.concatenate([np.zeros(hop), part.readings, np.zeros(SPECTRUM_WINDOW + hop)])
        starts = np.arange(0, len(part.readings) + hop, hop)
        spectra = np.fft.rfft(window * padded[starts[:, None] + np.arange(SPECTRUM_WINDOW)])
        jobs.append((part, spectra))
        powers.append(np.abs(spectra) ** 2)
    if not jobs:
        return velocity, math.nan
    power = np.concatenate(powers).mean(axis=0)
    quantised = smoothed.noise.quantum**2 / 12.0 * float(np.sum(window * window))
    white = max(float(np.median(power[1:])), quantised)
    gain = np.where(power > CLEAR_POWER * white, 1.0 - white / np.maximum(power, 1e-300), 0.0)
    gain[0] = gain[-1] = 0.0
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
