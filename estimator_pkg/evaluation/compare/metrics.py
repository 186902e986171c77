# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Errors of an estimate at zero shift, and its delay.

Errors are estimate minus truth at the same stamp. A late estimate is wrong while the speed changes,
and this is part of its error; the delay shows how much of the error it causes.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.delay import LONGEST_DELAY, measured
from estimator_pkg.evaluation.signals import cubic, slopes, wrapped

Array = NDArray[np.float64]

CONSTANT_BLOCK = 0.25  # the truth counts as constant if it is over two blocks of this length [s]
BLOCK_SAMPLES = 16  # or of this many samples, if that is longer
CONSTANT_CHANGE = 1e-4  # largest change of a constant truth within a block, over its largest value
SIGMAS_95 = 1.96  # the 95 % interval of a normal distribution [standard deviations]


def velocity(
    time: Array, estimate: Array, truth: Array, truth_noise: float = 0.0
) -> dict[str, Any]:
    """Return the metrics of a velocity.

    Parameters
    ----------
    time : shape (n,), increasing [s].
    estimate, truth : shape (n,) [rad/s or m/s].
    truth_noise : rms noise of the truth; a constant truth may change by it.
    """
    late = measured(time, estimate, truth).known
    return {
        **summary(estimate - truth),
        'delay_s': late.late,
        'delay_95_s': late.half,
        'noise': noise_at_constant_speed(time, estimate, truth, truth_noise),
    }


def position(time: Array, estimate: Array, truth: Array, period: float) -> dict[str, Any]:
    """Return the metrics of a position, whose error is the shorter way around the circle.

    Parameters
    ----------
    time : shape (n,), increasing [s].
    estimate, truth : shape (n,) [rad or m], each in any convention.
    period : wrap period [rad]; 0: no circle.
    """
    return {
        **summary(wrapped(estimate - truth, period)),
        'delay_s': _position_delay(time, estimate, truth, period),
    }


def summary(errors: Array) -> dict[str, float]:
    """Return rms, mean_abs, max_abs and bias of the finite `errors`, shape (n,), in their unit.

    They are nan without any.
    """
    errors = errors[np.isfinite(errors)]
    if not len(errors):
        return dict.fromkeys(('rms', 'mean_abs', 'max_abs', 'bias'), math.nan)
    size = np.abs(errors)
    return {
        'rms': float(np.sqrt(np.mean(errors * errors))),
        'mean_abs': float(np.mean(size)),
        'max_abs': float(np.max(size)),
        'bias': float(np.mean(errors)),
    }


def coverage(errors: Array, stddev: Array) -> float:
    """Return the fraction of the errors, shape (n,), within 1.96 stddev; nan if none is known."""
    known = np.isfinite(errors) & np.isfinite(stddev)
    if not known.any():
        return math.nan
    return float(np.mean(np.abs(errors[known]) <= SIGMAS_95 * stddev[known]))


def rms_at_delay(time: Array, estimate: Array, truth: Array, late: float) -> float:
    """Return the rms error against the truth delayed by `late` [s]; nan for no common time.

    Parameters
    ----------
    time, estimate, truth : shape (n,), as those of `velocity`.
    """
    inside = (time - late >= time[0]) & (time - late <= time[-1])
    return summary(estimate[inside] - cubic(time, truth, time[inside] - late))['rms']


def noise_at_constant_speed(
    time: Array, estimate: Array, truth: Array, truth_noise: float = 0.0
) -> float:
    """Return the rms deviation of the estimate from its mean while the truth is constant, else nan.

    Each stretch counts from its second block on: the settling before is not noise.

    Parameters
    ----------
    time, estimate, truth : shape (n,), these and `truth_noise` as for `velocity`.
    """
    good = np.isfinite(estimate) & np.isfinite(truth)
    time, estimate, truth = time[good], estimate[good], truth[good]
    if len(time) < 8:
        return math.nan
    length = max(CONSTANT_BLOCK, BLOCK_SAMPLES * float(np.median(np.diff(time))))
    edges = np.searchsorted(time, np.arange(time[0], time[-1] + 0.5 * length, length))
    steady = CONSTANT_CHANGE * float(np.max(np.abs(truth))) + 1e-12

    def constant(first: slice, block: slice) -> bool:
        return _same_speed(truth[first], truth[block], steady, truth_noise)

    stretches: list[list[slice]] = [[]]
    for block in (slice(*each) for each in pairwise(edges)):
        if stretches[-1] and not constant(stretches[-1][0], block):
            stretches.append([])
        if stretches[-1] or constant(block, block):
            stretches[-1].append(block)
    power, count = 0.0, 0
    for settling, *rest in filter(None, stretches):
        part = estimate[settling.stop : rest[-1].stop] if rest else estimate[:0]
        power += float(np.sum((part - np.mean(part)) ** 2)) if rest else 0.0
        count += len(part)
    return math.sqrt(power / count) if count else math.nan


def _same_speed(first: Array, block: Array, steady: float, noise: float) -> bool:
    """Return True if the truth of `block` is constant, and equal to that of `first`.

    Single samples may differ by noise; the means of half blocks may not.
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
    """Return the shift [s] that minimises the position error, by Gauss-Newton.

    nan if the position does not move, or moves differently from the truth.
    """
    good = np.isfinite(estimate) & np.isfinite(truth)
    time, estimate, truth = time[good], estimate[good], truth[good]
    if len(time) < 8:
        return math.nan
    if period > 0.0:
        truth = np.unwrap(truth, period=period).astype(np.float64)
    speed = slopes(time, truth)
    power = float(np.mean(speed * speed))
    if power * (time[-1] - time[0]) ** 2 < 1e-12 * (1.0 + float(np.mean(truth * truth))):
        return math.nan
    shift = 0.0
    for _ in range(20):
        at = time - shift
        inside = (at >= time[0]) & (at <= time[-1])
        error = wrapped(estimate[inside] - cubic(time, truth, at[inside]), period)
        change = -float(np.mean(error * speed[inside])) / power
        shift += change
        if abs(change) < 1e-9:
            break
        if abs(shift) > LONGEST_DELAY:
            return math.nan
    return shift
