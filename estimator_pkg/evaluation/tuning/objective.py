# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The objective of the tuner: an observer's error, delay and noise on parts of recorded bags.

`measure` is of one set of gains; `compared` tests two on held-out data.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.recording import EstimateSeries, Recording
from estimator_pkg.bags.series import at_stamps
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation import pairs
from estimator_pkg.evaluation.delay import measured
from estimator_pkg.evaluation.ranking.verdict import chosen
from estimator_pkg.evaluation.signals import slopes
from estimator_pkg.evaluation.text import number

Array = NDArray[np.float64]

SETTLING_TIME = 0.5  # time at the beginning of a part that is ignored [s]
AVERAGE = 0.05  # moving-average window that separates noise from motion [s],
AVERAGE_SAMPLES = 11  # or at least this many samples
FEWEST_ESTIMATES = 10  # smallest number of estimates for a result


class Weights(NamedTuple):
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

    @property
    def time(self) -> Array:
        """Time since the first stamp, shape (n,) [s]."""
        return (self.stamps - self.stamps[0]) * 1e-9

    @property
    def settled(self) -> NDArray[np.bool_]:
        """True for each sample, shape (n,), after the settling of the part."""
        return self.time >= min(SETTLING_TIME, 0.25 * float(self.time[-1]))

    def common(self, *estimates: EstimateSeries | None) -> tuple[NDArray[np.int64], list[Array]]:
        """Return (rows, velocities) of the settled samples where all of these have an estimate.

        There are none if they are too few, or if a velocity is not finite.
        """
        columns = []
        for each in estimates:
            if each is None:
                return np.zeros(0, np.int64), []
            velocity = np.where(np.isfinite(each.velocity), each.velocity, math.inf)
            columns.append(at_stamps(self.stamps, each.stamps, velocity))  # nan: no estimate
        rows = np.flatnonzero(self.settled & ~np.isnan(columns).any(axis=0))
        found = [each[rows] for each in columns]
        enough = len(rows) >= FEWEST_ESTIMATES and np.isfinite(found).all()
        return (rows, found) if enough else (rows, [])


@dataclass(frozen=True)
class Dataset:
    """A part of a bag: the observer's input, and the truth by joint."""

    recording: Recording
    known: dict[str, JointTruth]


class Errors(NamedTuple):
    """Errors of an observer on one joint of a part, or their means.

    error : rms [rad/s]. delay_s : [s]; nan if no shift fits best. delay_95_s : half of its 95 %
    interval [s]; nan if the motion does not determine the delay. noise : [rad/s].
    published : fraction of the samples with an estimate. cost : weighted sum [rad/s].
    """

    error: float
    delay_s: float
    delay_95_s: float
    noise: float
    published: float
    cost: float = math.nan


ErrorsByJoint = dict[str, Errors]  # by joint; empty: the values do not work


def measure(
    part: Dataset, observer: str, values: Mapping[str, Any], weights: Weights
) -> ErrorsByJoint:
    """Return the errors of an observer with these values on a part; {} if they do not work."""
    try:
        found = part.recording.run(observer, values)
    except UserError:
        return {}
    results = {}
    for joint, known in part.known.items():
        rows, velocities = known.common(found.get(joint))
        if not velocities:
            return {}
        (velocity,) = velocities
        time, true = known.time[rows], known.velocity[rows]
        width = averaged(time)
        late = measured(time, velocity, true)
        errors = Errors(
            _rms(velocity - true),
            late.late,
            late.half,
            _rms((velocity - smooth(time, velocity))[width:-width]),
            float(len(rows) / np.count_nonzero(known.settled)),
        )
        results[joint] = errors._replace(cost=cost(errors, known.acceleration, weights))
    return results


def cost(errors: Errors, acceleration: float, weights: Weights) -> float:
    """Return the weighted sum [rad/s]; samples without an estimate increase it.

    An unknown delay counts as if it caused the whole error.
    """
    late = abs(errors.delay_s) * acceleration if math.isfinite(errors.delay_s) else errors.error
    total = weights.error * errors.error + weights.noise * errors.noise + weights.delay * late
    return total / max(errors.published, 1e-3)


def relative(results: Sequence[ErrorsByJoint], units: Sequence[ErrorsByJoint]) -> float:
    """Return the mean over parts and joints of the cost, each in units of its cost at `units`.

    inf if the values do not work on a part. Where `units` do not work, the unit is 1 rad/s.
    """
    if not results or not all(results):
        return math.inf
    return mean(
        [
            one.cost / (unit[joint].cost if joint in unit and unit[joint].cost > 0.0 else 1.0)
            for result, unit in zip(results, units)
            for joint, one in result.items()
        ]
    )


def averaged_errors(errors: Sequence[Errors]) -> Errors:
    """Return the means of these errors: rms of error and noise, delays where they are known."""
    known = [each for each in errors if math.isfinite(each.delay_95_s)]
    halves = [each.delay_95_s for each in known]
    return Errors(
        math.sqrt(mean([each.error**2 for each in errors])),
        mean([each.delay_s for each in known]) if known else math.nan,
        math.hypot(*halves) / len(known) if known else math.nan,
        math.sqrt(mean([each.noise**2 for each in errors])),
        mean([each.published for each in errors]),
        mean([each.cost for each in errors]),
    )


class Compared(NamedTuple):
    """The tuned gains against the defaults.

    sign : 1: the tuned gains are better (95 %), -1: worse, 0: not known. difference : by how much
    the weighted error of the defaults is larger [%]; resolution : the smallest difference that
    would be declared [%].
    events : parts of the records that make half of the difference, if they are few; else 0.
    """

    sign: int
    difference: float
    resolution: float
    events: int = 0

    @property
    def used(self) -> bool:
        """True if the tuned gains are used, by the rule of `chosen`."""
        errors = {'defaults': 1.0 + self.difference / 100.0, 'tuned': 1.0}
        return chosen(errors, ('defaults',), lambda *_: self.sign) == 'tuned'

    def text(self, tuned: str = 'the tuned set', default: str = 'the default set') -> str:
        """Return the result in words, with the names of both."""
        smaller = number(100.0 - 100.0 / (1.0 + max(self.difference, 0.0) / 100.0), 2)
        if self.sign > 0:
            return f'{tuned} is better than {default} (95 %): its error is smaller by {smaller} %'
        if self.sign < 0:
            return f'{default} is better than {tuned} (95 %)'
        if self.used:
            return (
                f'{tuned} has less error than {default}, by {smaller} %, which is not significant'
            )
        within = number(abs(self.difference) + self.resolution, 2)
        return f'{tuned} and {default} cannot be distinguished: within {within} %'


def compared(
    parts: Sequence[Dataset],
    observer: str,
    gains: Mapping[str, Any],
    weights: Weights,
    other: str = '',
) -> Compared | None:
    """Return the comparison over these parts; None if the gains or the defaults do not work.

    The squared errors are weighted as the costs, and every joint counts in units of its defaults.
    Both references must agree where there are two.

    Parameters
    ----------
    other : the observer whose defaults are compared; '': the same.
    """
    sums: list[list[Array]] = [[], []]  # against each reference, by part and joint
    counts: list[NDArray] = []
    for part in parts:
        try:
            ran = [part.recording.run(observer, gains), part.recording.run(other or observer, {})]
        except UserError:
            return None
        for joint, known in part.known.items():
            rows, velocities = known.common(*(each.get(joint) for each in ran))
            if not velocities:
                return None
            time = known.time[rows]
            block = pairs.blocks(time)
            counts.append(np.bincount(block))
            for reference, of in zip((known.velocity, known.plain), sums):
                true = (known.velocity if reference is None else reference)[rows]
                tuned, default = (_score(time, each, true, weights, block) for each in velocities)
                unit = max(float(np.sum(default)), 1e-300) / len(time)
                of.append((tuned - default) / unit)
    found = pairs.agreed(sums, counts)
    mean_ = min(max(found.mean, -0.999999), 1e6)  # of the squares: -1 if no error is left
    return Compared(
        found.sign,
        100.0 * ((1.0 + mean_) ** -0.5 - 1.0),
        50.0 * found.half,
        len(pairs.events(np.concatenate(sums[0]))),
    )


def _score(
    time: Array, velocity: Array, truth: Array, weights: Weights, block: NDArray[np.int64]
) -> Array:
    """Return the weighted sum of squares by block: error, its part by delay, and noise.

    The part by delay is the projection of the error on the acceleration.
    """
    error = velocity - truth
    width = averaged(time)
    inside = slice(width, -width)  # the average is wrong at the ends
    noise, turns = np.zeros(len(time)), np.zeros(len(time))
    noise[inside] = (velocity - smooth(time, velocity))[inside]
    turns[inside] = slopes(time, smooth(time, truth))[inside]
    delayed = np.bincount(block, error * turns) ** 2 / np.maximum(
        np.bincount(block, turns**2), 1e-300
    )
    sums = (np.bincount(block, error**2), delayed, np.bincount(block, noise**2))
    return np.asarray(sum(weight**2 * each for weight, each in zip(weights, sums)))


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


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
