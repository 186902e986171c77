"""What the tuner minimises: an observer's error, delay and noise on parts of recorded bags."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import registry
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.guard import DUPLICATE
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.delay import delay
from estimator_pkg.evaluation.interpolation import slopes
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.sources import measured
from estimator_pkg.evaluation.truth import truth
from estimator_pkg.observers.contract import COASTING, TRACKING

Array = NDArray[np.float64]

SETTLING = 0.5      # [s] at the beginning of a part that do not count
SHORTEST = 100      # samples of a part, below which it says nothing
AVERAGE = 0.05      # [s] noise is what changes faster than the mean over so long,
AVERAGE_SAMPLES = 11  # or over so many samples


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


PREFERENCES = {'smooth': Weights(1.0, 0.0, 1.0), 'balanced': Weights(1.0, 0.1, 0.1),
               'fast': Weights(1.0, 1.0, 0.0)}


@dataclass(frozen=True)
class Part:
    """A stretch of one joint in one bag, with what is true at its samples.

    velocity : shape (n,); nan where nothing is known.
    acceleration : rms [rad/s^2].
    """

    bag: str
    joint: str
    stamps: NDArray[np.int64]
    position: Array
    velocity: Array
    acceleration: float
    wrap_period: float


class Result(NamedTuple):
    """Error [rad/s], delay [s] and noise [rad/s] of an observer on a part.

    published : the share of the samples with an estimate.
    """

    error: float
    delay: float
    noise: float
    published: float


@dataclass(frozen=True)
class Record:
    """A joint of a bag: what the gains are sought on, and what they are judged on.

    uncertainty : what the reference itself may be wrong by [rad/s].
    origin : 'sensor' or 'smoother'.
    """

    bag: str
    joint: str
    seen: Part
    held_out: Part | None
    uncertainty: float
    origin: str


def records(path: str, options: Options, held_out: float, joints: Sequence[str] = ()
            ) -> list[Record]:
    """The joints of a bag that can be tuned on.

    Parameters
    ----------
    held_out : part of each record, at its end, that the search does not see.
    joints : these alone; empty: all that have a truth.

    Raises
    ------
    UserError : no measurement, no truth and too little to make a reference from.
    """
    with open_bag(path) as bag:
        measurement = measured(bag, options)
        if not measurement:
            raise UserError(f'{path}: no measured positions to tune on')
        for name in joints:
            if name not in measurement:
                raise UserError(f"{path}: no joint '{name}'; it has "
                                f'{", ".join(sorted(measurement))}')
        true = truth(bag, path, measurement, options)
    found = []
    for joint, series in measurement.items():
        if joint not in true.series or (joints and joint not in joints):
            continue
        known = true.series[joint]
        good = np.isfinite(series.position)
        stamps, position = series.stamps_ns[good], series.position[good]
        at = match(stamps, known.stamps_ns, known.velocity, known.position, options.wrap_period)
        velocity = np.full(len(stamps), np.nan)
        velocity[at.rows] = at.velocity
        cut = len(stamps) - round(held_out * len(stamps))
        parts = [_part(path, joint, stamps[part], position[part], velocity[part],
                       options.wrap_period) for part in (slice(cut), slice(cut, None))]
        if parts[0] is None:
            continue
        found.append(Record(path, joint, parts[0], parts[1], true.references[joint].noise,
                            true.references[joint].origin))
    if not found:
        raise UserError(f'{path}: too few samples with a truth to tune on')
    return found


def _part(path: str, joint: str, stamps: NDArray[np.int64], position: Array, velocity: Array,
          period: float) -> Part | None:
    known = np.isfinite(velocity)
    if np.count_nonzero(known) < SHORTEST:
        return None
    time = (stamps[known] - stamps[known][0]) * 1e-9
    order = np.unique(time, return_index=True)[1]
    time, speed = time[order], velocity[known][order]
    width = _width(time)
    smooth = np.convolve(speed, np.ones(width) / width, 'valid')
    turns = slopes(time[:len(smooth)], smooth) if len(smooth) > 2 else np.zeros(1)
    return Part(path, joint, stamps, position, velocity, float(np.sqrt(np.mean(turns ** 2))),
                period)


def measure(part: Part, observer: str, values: Mapping[str, Any], fast: bool) -> Result | None:
    """What an observer with these values makes of a part; None: they cannot work at its rate."""
    found = registry.find(registry.OBSERVERS, observer)
    try:
        configuration = Configuration(found, {**values, 'wrap_period': part.wrap_period})
        joint = Joint(found, *configuration.for_joint(''))
    except UsageError:
        return None
    steps = np.diff(part.stamps)
    if joint.functions.limits(float(np.median(steps[steps > 0])) * 1e-9) is not None:
        return None
    out = joint.run(part.stamps, part.position, fast=fast)
    elapsed = (part.stamps - part.stamps[0]) * 1e-9
    counted = np.isfinite(part.velocity) & (elapsed >= min(SETTLING, 0.25 * elapsed[-1]))
    shown = counted & (out.verdict < DUPLICATE) & (
        (out.status == TRACKING) | (out.status == COASTING))
    if np.count_nonzero(shown) < 10:
        return None
    time, order = np.unique(elapsed[shown], return_index=True)
    estimate, true = out.velocity[shown][order], part.velocity[shown][order]
    error = estimate - true
    if not np.isfinite(error).all():
        return None
    width = _width(time)
    slow = np.convolve(estimate, np.ones(width) / width, 'same')
    late = delay(time, estimate, true)
    return Result(float(np.sqrt(np.mean(error ** 2))), late if late == late else 0.0,
                  float(np.sqrt(np.mean((estimate - slow)[width:-width] ** 2))),
                  float(np.count_nonzero(shown) / np.count_nonzero(counted)))


def cost(result: Result, part: Part, weights: Weights) -> float:
    """The weighted sum [rad/s]; samples without an estimate make it dearer."""
    total = (weights.error * result.error + weights.noise * result.noise
             + weights.delay * abs(result.delay) * part.acceleration)
    return total / max(result.published, 1e-3)


def _width(time: Array) -> int:
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    return max(1, min(max(AVERAGE_SAMPLES, round(AVERAGE / step)), len(time) // 4))


def mean(values: Sequence[float]) -> float:
    """The mean, inf where one is missing."""
    return math.fsum(values) / len(values) if values else math.inf
