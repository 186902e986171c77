# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The off-line reference: velocity from the measured position alone, with past and future samples.

A fixed-interval smoother for a motion driven by white jerk, at irregular stamps and on wrapped
angles. Counted readings are cells (`cells`), others are numbers with white noise; `noise` finds the
noise and the intensity of the jerk. The smoother computes its own standard deviation, which decides
whether it is good enough to evaluate an observer.

Limitations: it smears jumps of the acceleration (dry friction, square waves) over a few samples. It
treats a fast motion within a slow one, such as the chatter of a drive, as noise. In that case its
residual is not white, and the speed that this residual would be as motion is reported
(`unexplained`). Observers and reference use the same sensor, so their errors are not independent.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import LARGEST
from estimator_pkg.engine.calls import run
from estimator_pkg.evaluation.reference.smoother.noise import (
    HIDDEN_CELLS,
    Cells,
    ReadingNoise,
    in_cells,
    white,
)
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, cut, start
from estimator_pkg.evaluation.reference.smoother.residual import unexplained
from estimator_pkg.evaluation.reference.smoother.steps import SIZE, backward, forward
from estimator_pkg.evaluation.signals import wrapped

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

OUTLIER_SPREAD = 8.0  # readings beyond this many robust deviations from the smoothed are ignored
OUTLIER_QUANTA = 2.0  # if their error is at least this many quanta, and this many times that of
OUTLIER_ALONE = 3.0  # both neighbours: a jump of the acceleration affects neighbours too
FEWEST_CHANGES = 40  # smallest number of changes of a counted reading that shows the motion
LOOSER = 3.0  # a larger multiple of the median standard deviation marks the ends of a piece
CONTRADICTS = 5.0  # a fitted noise above this multiple of the readings' scatter is wrong
NO_NEWS = 1e-9  # a cell below this fraction of a reading's usual weight is ignored


class Smoothed(NamedTuple):
    """The reference, at the stamps of the readings that it uses.

    stamps : shape (n,), [ns], in the order of the record, without duplicates.
    position, velocity : shape (n,); the position is multi-turn within a piece.
    position_stddev, velocity_stddev : shape (n,), standard deviation of each.
    outliers : number of ignored readings.
    unexplained : rms speed of the residual that is not white noise [rad/s].
    changes : number of changes of a counted reading; -1 if readings are not counted.
    rows : shape (n,), indices of the readings in the record.
    scatter : standard deviation of white noise with the readings' third differences [rad].
    """

    stamps: Stamps
    position: Array
    velocity: Array
    position_stddev: Array
    velocity_stddev: Array
    noise: ReadingNoise
    outliers: int
    unexplained: float
    changes: int = -1
    rows: NDArray[np.int64] = np.zeros(0, np.int64)
    scatter: float = math.nan

    @property
    def firm(self) -> NDArray[np.bool_]:
        """True, shape (n,), where the stddev is about that of the middle: not at a piece's ends."""
        return self.velocity_stddev <= LOOSER * float(np.median(self.velocity_stddev))

    @property
    def seldom(self) -> bool:
        """True if the reading changes too rarely to show the motion."""
        return 0 <= self.changes < FEWEST_CHANGES

    @property
    def contradicted(self) -> bool:
        """True if the readings scatter far less than the noise that was fitted to them."""
        noise = self.noise
        return not noise.at_floor and noise.reading > CONTRADICTS * max(self.scatter, noise.quantum)

    @property
    def uncertainty(self) -> float:
        """Expected rms velocity error where `firm` [rad/s]; nan without any reading.

        Infinite if the reading changes too rarely to show the motion.
        """
        if not len(self.stamps):
            return math.nan
        if self.seldom:
            return math.inf
        variance = float(np.mean(self.velocity_stddev[self.firm] ** 2))
        return math.sqrt(variance + self.unexplained**2)


def smooth(
    stamps: Stamps, position: Array, period: float, *, noise: ReadingNoise | None = None
) -> Smoothed:
    """Return the smoothed motion of a record of positions.

    Parameters
    ----------
    stamps : shape (n,) [ns], as recorded; they are sorted and duplicates are dropped.
    position : shape (n,) [rad or m]; values outside the range of any encoder are ignored.
    period : wrap period [rad]; 0: none.
    noise : None: estimated by maximum likelihood.
    """
    good = np.flatnonzero((np.abs(position) < LARGEST) & (stamps > 0))
    parts = cut(stamps[good], position[good])
    found = noise or white(parts, position[good], period)
    if found is None:
        return _nothing()
    result = [_as_numbers(part, found, period) for part in parts]
    ignored = 0
    if noise is None:
        cleaned = [_without_outliers(part, out, found, period) for part, out in zip(parts, result)]
        ignored = sum(count for _, count in cleaned)
        if ignored:
            parts = [part for part, _ in cleaned]
            found = white(parts, position[good], period) or found
            result = [_as_numbers(part, found, period) for part in parts]
    rows = good[np.concatenate([part.rows for part in parts])]
    rest = [_rest(part, out, period) for part, out in zip(parts, result)]
    weights = [_weights(part, found) for part in parts]
    counted = 0.0 < found.reading < HIDDEN_CELLS * found.quantum
    if found.cells or (counted and noise is None):
        cells = [
            part._replace(readings=out[:, 0] + left) for part, out, left in zip(parts, result, rest)
        ]
        found = noise or in_cells(cells, found)
        met = [_as_cells(part, found) for part in cells]
        result = [out for out, _, _ in met]
        rest, weights = [left for _, left, _ in met], [weight for _, _, weight in met]
    columns = np.concatenate(result)
    return Smoothed(
        stamps[rows],
        columns[:, 0],
        columns[:, 1],
        columns[:, 2],
        columns[:, 3],
        found,
        ignored,
        unexplained(parts, rest, weights, found.quantised),
        _changes(parts, found.quantum),
        rows,
        _scatter(parts, period),
    )


def _weights(part: Piece, noise: ReadingNoise) -> Array:
    """Return one over the variance of each reading; 0 without a reading."""
    return np.where(np.isfinite(part.readings), 1.0 / noise.reading**2, 0.0)


def _as_numbers(part: Piece, noise: ReadingNoise, period: float) -> Array:
    """Return shape (n, 4), see `steps.backward`; every reading has the same variance."""
    return _smooth(part, _weights(part, noise), noise, period)


def _as_cells(part: Piece, noise: ReadingNoise) -> tuple[Array, Array, Array]:
    """Return (as `_as_numbers`, residuals of the sites, their weights) for cells."""
    cells = Cells(part, noise.quantum)
    cells.probability(noise.blur, noise.jerk)
    weights = cells.sites[:, 0]
    weights[weights < NO_NEWS / noise.reading**2] = 0.0
    known = weights > 0.0
    equivalent = np.where(known, part.readings, np.nan)
    equivalent[known] += cells.sites[known, 1] / weights[known]
    smoothed = _smooth(part._replace(readings=equivalent), weights, noise, 0.0)
    return smoothed, equivalent - smoothed[:, 0], weights


def _smooth(part: Piece, weights: Array, noise: ReadingNoise, period: float) -> Array:
    count = len(part.rows)
    known = np.flatnonzero(weights > 0.0)
    first = float(part.readings[known[0]]) if len(known) else 0.0
    begin = start(first, noise.reading**2, part.speed, part.step)
    states, innovations, smoothed = (np.empty((count, size)) for size in (SIZE, 2, 4))
    readings = part.readings, weights, noise.jerk, period
    run(forward, begin, count, part.steps, *readings, states, innovations)
    run(backward, count, part.steps, weights, states, innovations, smoothed)
    return smoothed


def _without_outliers(
    part: Piece, smoothed: Array, noise: ReadingNoise, period: float
) -> tuple[Piece, int]:
    """Return the piece without outliers, and their number."""
    far = outliers(_rest(part, smoothed, period), noise.quantum)
    far[0] = False  # a piece starts from its first reading
    if not far.any() or np.mean(far) > 0.1:  # a tenth of all readings are not outliers
        return part, 0
    return part._replace(readings=np.where(far, np.nan, part.readings)), int(np.sum(far))


def outliers(rest: Array, quantum: float) -> NDArray[np.bool_]:
    """Return True, shape (n,), for single readings far from the smoothed position.

    Parameters
    ----------
    rest : shape (n,), readings minus smoothed positions [rad]; nan: none. quantum : [rad].
    """
    spread = 1.4826 * float(np.nanmedian(np.abs(rest)))
    size = np.nan_to_num(np.abs(rest))
    far = size > max(OUTLIER_SPREAD * spread, OUTLIER_QUANTA * quantum, 1e-12)
    far[1:-1] &= size[1:-1] > OUTLIER_ALONE * np.maximum(size[:-2], size[2:])
    return far


def _rest(part: Piece, smoothed: Array, period: float) -> Array:
    """Return the readings minus the smoothed positions, wrapped."""
    return wrapped(part.readings - smoothed[:, 0], period)


def _scatter(parts: list[Piece], period: float) -> float:
    """Return the standard deviation of white noise with the readings' third differences [rad].

    A motion only adds to it.
    """
    third = [
        np.diff(wrapped(np.diff(part.readings), period) / part.steps[1:], 2) * part.step
        for part in parts
    ]
    return math.sqrt(float(np.nanmean(np.concatenate(third) ** 2)) / 20.0)


def _changes(parts: list[Piece], quantum: float) -> int:
    """Return how often the reading changes; -1 if it is not counted (0 if it never changes)."""
    moves = np.concatenate([np.diff(part.readings) for part in parts])
    count = int(np.count_nonzero(np.abs(moves) > 0.5 * quantum))
    return count if quantum or not count else -1


def _nothing() -> Smoothed:
    none = np.zeros(0)
    return Smoothed(
        np.zeros(0, np.int64),
        none,
        none,
        none,
        none,
        ReadingNoise(math.nan, math.nan, 0.0, False),
        0,
        math.nan,
    )
