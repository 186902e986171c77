# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The objective of the tuner: an observer's error, delay and noise on parts of recorded bags."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.recording import EstimateSeries, Recording
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.delay import measured

Array = NDArray[np.float64]

SETTLING_TIME = 0.5  # time at the beginning of a part that is ignored [s]
AVERAGE = 0.05  # moving-average window that separates noise from motion [s],
AVERAGE_SAMPLES = 11  # or at least this many samples
FEWEST_ESTIMATES = 10  # smallest number of estimates for a result


@dataclass(frozen=True)
class Weights:
    """Weights of error, delay and noise; all three are in rad/s, so they can be added.

    error : rms velocity error at zero shift. delay : the error caused by the delay alone, which is
    the delay times the rms acceleration. noise : rms of the fast part of the estimate, in motion
    and at rest.
    """

    error: float
    delay: float
    noise: float


PREFERENCES = {
    'smooth': Weights(1.0, 0.0, 1.0),
    'balanced': Weights(1.0, 0.1, 0.1),
    'fast': Weights(1.0, 1.0, 0.0),
}


@dataclass(frozen=True)
class JointTruth:
    """The truth of one joint at the stamps where an estimate is due.

    stamps : shape (n,), ascending. velocity : shape (n,). acceleration : rms [rad/s^2].
    plain : shape (n,), the off-line reference without the recovered vibration; None: there
        is no such question.
    """

    stamps: NDArray[np.int64]
    velocity: Array
    acceleration: float
    plain: Array | None = None


@dataclass(frozen=True)
class Dataset:
    """A part of a bag: the observer's input, and the truth by joint."""

    recording: Recording
    known: dict[str, JointTruth]


class JointErrors(NamedTuple):
    """Error [rad/s], delay [s] and noise [rad/s] of an observer on one joint of a part.

    delay is nan if no shift fits best. published : fraction of the samples with an estimate.
    half : half of the delay's 95 % interval [s]; nan if the motion does not determine the delay.
    """

    error: float
    delay: float
    noise: float
    published: float
    half: float = math.nan


ErrorsByJoint = dict[str, JointErrors]  # by joint


def measure(part: Dataset, observer: str, values: Mapping[str, Any]) -> ErrorsByJoint | None:
    """Return the results of an observer with these values on a part; None if they do not work."""
    try:
        found = part.recording.run(observer, values)
    except UserError:
        return None
    results = {}
    for joint, known in part.known.items():
        result = _result(found[joint], known) if joint in found else None
        if result is None:
            return None
        results[joint] = result
    return results


def _result(estimate: EstimateSeries, known: JointTruth) -> JointErrors | None:
    elapsed = (known.stamps - known.stamps[0]) * 1e-9
    counted = settled(elapsed)
    at = np.minimum(np.searchsorted(known.stamps, estimate.stamps), len(known.stamps) - 1)
    same = known.stamps[at] == estimate.stamps
    rows, first = np.unique(at[same], return_index=True)
    velocity = estimate.velocity[same][first]
    velocity, rows = velocity[counted[rows]], rows[counted[rows]]
    if len(rows) < FEWEST_ESTIMATES:
        return None
    time, true = elapsed[rows], known.velocity[rows]
    error = velocity - true
    if not np.isfinite(error).all():
        return None
    width = averaged(time)
    noise = (velocity - smooth(time, velocity))[width:-width]
    late = measured(time, velocity, true)
    return JointErrors(
        float(np.sqrt(np.mean(error**2))),
        late.late,
        float(np.sqrt(np.mean(noise**2))),
        float(len(rows) / np.count_nonzero(counted)),
        late.half,
    )


def settled(elapsed: Array) -> NDArray[np.bool_]:
    """Return True for each sample, shape (n,), after the settling of a part; elapsed [s]."""
    return elapsed >= min(SETTLING_TIME, 0.25 * float(elapsed[-1]))


def cost(result: JointErrors, known: JointTruth, weights: Weights) -> float:
    """Return the weighted sum [rad/s]; samples without an estimate increase it.

    An unknown delay counts as if it caused the whole error.
    """
    late = abs(result.delay) * known.acceleration if math.isfinite(result.delay) else result.error
    total = weights.error * result.error + weights.noise * result.noise + weights.delay * late
    return total / max(result.published, 1e-3)


def costs(results: ErrorsByJoint | None, part: Dataset, weights: Weights) -> dict[str, float]:
    """Return costs by joint; inf if the values do not work."""
    if results is None:
        return dict.fromkeys(part.known, math.inf)
    return {joint: cost(result, part.known[joint], weights) for joint, result in results.items()}


def averaged(time: Array) -> int:
    """Return the length of the moving-average window that separates noise from motion [samples].

    `time` has shape (n,), increasing [s].
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    return max(1, min(max(AVERAGE_SAMPLES, round(AVERAGE / step)), len(time) // 4))


def smooth(time: Array, values: Array) -> Array:
    """Return the moving average, shape (n,); within a window of the ends it is wrong."""
    width = averaged(time)
    return np.convolve(values, np.ones(width) / width, 'same')


def mean(values: Sequence[float]) -> float:
    """Return the mean, inf without values."""
    return math.fsum(values) / len(values) if values else math.inf
