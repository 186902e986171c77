"""What the tuner minimises: an observer's error, delay and noise on parts of recorded bags."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.recording import Estimate, Recording
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.delay import delay

Array = NDArray[np.float64]

SETTLING = 0.5  # [s] at the beginning of a part that do not count
AVERAGE = 0.05  # [s] noise is what changes faster than the mean over so long,
AVERAGE_SAMPLES = 11  # or over so many samples
FEWEST = 10  # estimates, below which they say nothing


@dataclass(frozen=True)
class Weights:
    """How much error, delay and noise count; all three in rad/s, so that they can be added.

    error : rms velocity error at zero shift. delay : the error that the delay alone makes, which is
    the delay times the rms acceleration. noise : rms of the fast part of the estimate, whether it
    moved or not.
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
class Known:
    """The truth of one joint where an estimate is due.

    stamps : shape (n,), ascending. velocity : shape (n,). acceleration : rms [rad/s^2].
    """

    stamps: NDArray[np.int64]
    velocity: Array
    acceleration: float


@dataclass(frozen=True)
class Part:
    """A stretch of a bag: what the observer needs of it, and what is true, by joint."""

    recording: Recording
    known: dict[str, Known]


class Result(NamedTuple):
    """Error [rad/s], delay [s] and noise [rad/s] of an observer on one joint of a part.

    delay is nan where the motion does not tell it. published : the share of the samples with an
    estimate.
    """

    error: float
    delay: float
    noise: float
    published: float


Results = dict[str, Result]  # by joint


def measure(part: Part, observer: str, values: Mapping[str, Any], fast: bool) -> Results | None:
    """What an observer with these values makes of a part; None: they cannot work on it."""
    try:
        found = part.recording.run(observer, values, fast)
    except UserError:
        return None
    results = {}
    for joint, known in part.known.items():
        result = _result(found[joint], known) if joint in found else None
        if result is None:
            return None
        results[joint] = result
    return results


def _result(estimate: Estimate, known: Known) -> Result | None:
    elapsed = (known.stamps - known.stamps[0]) * 1e-9
    counted = elapsed >= min(SETTLING, 0.25 * elapsed[-1])
    at = np.minimum(np.searchsorted(known.stamps, estimate.stamps), len(known.stamps) - 1)
    same = known.stamps[at] == estimate.stamps
    rows, first = np.unique(at[same], return_index=True)
    velocity = estimate.velocity[same][first]
    velocity, rows = velocity[counted[rows]], rows[counted[rows]]
    if len(rows) < FEWEST:
        return None
    time, true = elapsed[rows], known.velocity[rows]
    error = velocity - true
    if not np.isfinite(error).all():
        return None
    width = averaged(time)
    slow = np.convolve(velocity, np.ones(width) / width, 'same')
    return Result(
        float(np.sqrt(np.mean(error**2))),
        delay(time, velocity, true),
        float(np.sqrt(np.mean((velocity - slow)[width:-width] ** 2))),
        float(len(rows) / np.count_nonzero(counted)),
    )


def cost(result: Result, known: Known, weights: Weights) -> float:
    """The weighted sum [rad/s]; samples without an estimate make it dearer.

    Where the delay cannot be told, the whole error may come from it.
    """
    late = abs(result.delay) * known.acceleration if math.isfinite(result.delay) else result.error
    total = weights.error * result.error + weights.noise * result.noise + weights.delay * late
    return total / max(result.published, 1e-3)


def costs(results: Results | None, part: Part, weights: Weights) -> dict[str, float]:
    """By joint; inf where the values cannot work."""
    if results is None:
        return dict.fromkeys(part.known, math.inf)
    return {joint: cost(result, part.known[joint], weights) for joint, result in results.items()}


def averaged(time: Array) -> int:
    """How many samples the mean is over that noise is told from."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    return max(1, min(max(AVERAGE_SAMPLES, round(AVERAGE / step)), len(time) // 4))


def mean(values: Sequence[float]) -> float:
    """The mean, inf where there is none."""
    return math.fsum(values) / len(values) if values else math.inf
