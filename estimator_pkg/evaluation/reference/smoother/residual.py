"""What the smoother leaves of the readings: white noise, or motion that it did not follow."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.reference.smoother.pieces import Piece

Array = NDArray[np.float64]

WINDOW = 128  # readings of a window of the spectrum
CLEAR = 2.0  # of white noise, the spectrum stays below so many times its level
NEWS = 0.1  # a window tells something if its readings weigh so much of the heaviest


def unexplained(
    parts: list[Piece], rest: list[Array], weights: list[Array], quantised: float
) -> float:
    """The rms speed of the part of `rest` that stands out of white noise [rad/s].

    Power spectral density over half-overlapping windows; what exceeds `CLEAR` times the white level
    (the median, but at least that of the quantisation) is held to be motion. Each reading counts as
    much as it weighs, and windows in which nothing is told (a count that does not change) are held
    to be at rest.

    Parameters
    ----------
    rest : shape (n,) each, readings less smoothed positions [rad]; nan: none.
    weights : shape (n,) each, their inverse variances; quantised : the part of these variances that
        is the quantisation's.
    """
    step = float(np.median(np.concatenate([part.steps[1:] for part in parts])))
    heaviest = max((float(np.max(each)) for each in weights if len(each)), default=0.0)
    window = np.hanning(WINDOW)
    power, level = np.zeros(WINDOW // 2 + 1), 0.0
    count, telling = 0, 0
    for left, weight in zip(rest, weights):
        pushed = np.where(weight > 0.0, np.nan_to_num(left) * weight, 0.0)
        for at in range(0, len(pushed) - WINDOW + 1, WINDOW // 2):
            count += 1
            mean = float(np.mean(weight[at : at + WINDOW]))
            if mean <= NEWS * heaviest:
                continue
            telling += 1
            piece = pushed[at : at + WINDOW] / mean
            power += np.abs(np.fft.rfft(window * (piece - np.mean(piece)))) ** 2
            level += 1.0 / mean
    if not telling:
        return 0.0
    power *= 2.0 * step / (telling * float(np.sum(window * window)))
    frequency = np.fft.rfftfreq(WINDOW, step)
    white = max(quantised * 2.0 * step * level / telling, float(np.median(power)))
    excess = np.maximum(power - CLEAR * white, 0.0)
    speed = float(np.sum((2.0 * math.pi * frequency) ** 2 * excess)) * frequency[1]
    return math.sqrt(speed * telling / count)
