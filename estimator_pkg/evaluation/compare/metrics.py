"""How far an estimate is from the truth: numbers at zero shift, and the delay beside them.

Errors are estimate minus truth at the same stamp. A late estimate is wrong while the speed changes,
and that stays in its error; the delay tells how much of it comes from being late.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.compare.delay import LONGEST, delay
from estimator_pkg.evaluation.compare.interpolation import cubic, slopes

Array = NDArray[np.float64]

BLOCK = 0.25  # the truth counts as constant if it is for two blocks of this length [s]
BLOCK_SAMPLES = 16  # or this many samples, where that is longer
LONG = 1_000_000  # samples that tell a delay
STEADY = 1e-4  # largest change of a constant truth within a block, part of its largest value


def wrapped(difference: Array, period: float) -> Array:
    """`difference` in [-period/2, period/2); unchanged where `period` is 0."""
    if period <= 0.0:
        return difference
    return difference - period * np.floor(difference / period + 0.5)


def summary(errors: Array) -> dict[str, float]:
    """rms, mean_abs, max_abs and bias of the finite `errors`; nan where there is none."""
    errors = errors[np.isfinite(errors)]
    if not len(errors):
        return {'rms': np.nan, 'mean_abs': np.nan, 'max_abs': np.nan, 'bias': np.nan}
    size = np.abs(errors)
    return {
        'rms': float(np.sqrt(np.mean(errors * errors))),
        'mean_abs': float(np.mean(size)),
        'max_abs': float(np.max(size)),
        'bias': float(np.mean(errors)),
    }


def velocity(
    time: Array, estimate: Array, truth: Array, truth_noise: float = 0.0
) -> dict[str, Any]:
    """The numbers of a velocity.

    Parameters
    ----------
    time : shape (n,), increasing [s].
    estimate, truth : shape (n,) [rad/s or m/s].
    truth_noise : rms noise of the truth, by which a constant one may still change.
    """
    return {
        **summary(estimate - truth),
        'delay_s': delay(*_middle(time, estimate, truth)),
        'noise': noise_at_constant_speed(time, estimate, truth, truth_noise),
    }


def position(time: Array, estimate: Array, truth: Array, period: float) -> dict[str, Any]:
    """The numbers of a position, whose error is the shorter way round the circle.

    Parameters
    ----------
    time : shape (n,), increasing [s].
    estimate, truth : shape (n,) [rad or m], each in any convention.
    period : wrap period [rad]; 0: no circle.
    """
    return {
        **summary(wrapped(estimate - truth, period)),
        'delay_s': _position_delay(*_middle(time, estimate, truth), period),
    }


def _middle(time: Array, estimate: Array, truth: Array) -> tuple[Array, Array, Array]:
    """As much of a long record as tells its delay, from its middle: memory stays bounded."""
    first = max(0, (len(time) - LONG) // 2)
    part = slice(first, first + LONG)
    return time[part], estimate[part], truth[part]


def noise_at_constant_speed(
    time: Array, estimate: Array, truth: Array, truth_noise: float = 0.0
) -> float:
    """The rms deviation of the estimate from its own mean where the truth is constant, else nan.

    A stretch counts from its second block on: what the estimate still settles is no noise.
    """
    good = np.isfinite(estimate) & np.isfinite(truth)
    time, estimate, truth = time[good], estimate[good], truth[good]
    if len(time) < 8:
        return np.nan
    length = max(BLOCK, BLOCK_SAMPLES * float(np.median(np.diff(time))))
    edges = np.searchsorted(time, np.arange(time[0], time[-1] + 0.5 * length, length))
    power, count = 0.0, 0
    for blocks in _stretches(truth, list(pairwise(edges)), truth_noise):
        if len(blocks) >= 2:
            part = estimate[blocks[1][0] : blocks[-1][1]]
            power += float(np.sum((part - np.mean(part)) ** 2))
            count += len(part)
    return float(np.sqrt(power / count)) if count else np.nan


def _stretches(
    truth: Array, blocks: list[tuple[int, int]], noise: float
) -> Iterator[list[tuple[int, int]]]:
    """The blocks (first, behind the last) in a row over which the truth is constant."""
    steady = STEADY * float(np.max(np.abs(truth))) + 1e-12

    def alike(one: tuple[int, int], other: tuple[int, int]) -> bool:
        return _same_speed(truth[slice(*one)], truth[slice(*other)], steady, noise)

    stretch: list[tuple[int, int]] = []
    for block in blocks:
        if stretch and not alike(stretch[0], block):
            yield stretch
            stretch = []
        if stretch or alike(block, block):
            stretch.append(block)
    yield stretch


def _same_speed(first: Array, block: Array, steady: float, noise: float) -> bool:
    """True if the truth of `block` is constant, and that of `first` too.

    What noise lets through in single samples, the means of half blocks do not.
    """
    if len(block) < BLOCK_SAMPLES // 2:
        return False
    if max(np.max(block), np.max(first)) - min(np.min(block), np.min(first)) > steady + 8 * noise:
        return False
    half = len(block) // 2
    allowed = steady + 4.0 * noise / np.sqrt(half)
    return bool(
        abs(np.mean(block[:half]) - np.mean(block[half:])) <= allowed
        and abs(np.mean(block) - np.mean(first)) <= allowed
    )


def _position_delay(time: Array, estimate: Array, truth: Array, period: float) -> float:
    """The shift [s] that minimises the position error, by Gauss-Newton.

    nan where the position never moves, or not as the truth does.
    """
    good = np.isfinite(estimate) & np.isfinite(truth)
    time, estimate, truth = time[good], estimate[good], truth[good]
    if len(time) < 8:
        return np.nan
    if period > 0.0:
        truth = np.unwrap(truth, period=period).astype(np.float64)
    speed = slopes(time, truth)
    power = float(np.mean(speed * speed))
    if power * (time[-1] - time[0]) ** 2 < 1e-12 * (1.0 + float(np.mean(truth * truth))):
        return np.nan
    shift = 0.0
    for _ in range(20):
        at = time - shift
        inside = (at >= time[0]) & (at <= time[-1])
        error = wrapped(estimate[inside] - cubic(time, truth, at[inside]), period)
        change = -float(np.mean(error * speed[inside])) / power
        shift += change
        if abs(change) < 1e-9:
            break
        if abs(shift) > LONGEST:
            return np.nan
    return shift
