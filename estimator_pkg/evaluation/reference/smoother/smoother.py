"""The off-line reference: velocity from the measured position alone, with hindsight.

A fixed-interval smoother for a motion driven by white jerk, at irregular stamps and on wrapped
angles. Counted readings are taken as cells (`smoother_cells`), others as numbers with white noise;
`smoother_noise` finds the noise and the intensity of the jerk. It gives its own standard deviation,
and with that it can say whether it is good enough to judge an observer.

What it cannot see: jumps of the acceleration (dry friction, square waves) are smeared over a few
samples. A fast motion within a slow one, as the chatter of a drive, is taken for noise; but then
what is left of the readings is not white, and the speed that it would be, were it motion, is told
beside the standard deviation (`unexplained`). Observers and reference read the same sensor, so that
their errors are not independent.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import compiled
from estimator_pkg.evaluation.reference.smoother.noise import COARSE, Noise, in_cells, white
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, cut, start
from estimator_pkg.evaluation.reference.smoother.rest import unexplained
from estimator_pkg.evaluation.reference.smoother.sites import find_sites
from estimator_pkg.evaluation.reference.smoother.steps import backward, forward
from estimator_pkg.observers.angle.core import LARGEST

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

CHUNK = 65536  # readings whose filter states are in memory at a time
BLOCK, MARGIN = 50_000, 5_000  # cells are met in blocks of readings, which overlap by a margin
OUTLIER = 8.0  # readings so many robust deviations from the smoothed are left out
COUNTS = 2.0  # if they are at least so many quanta off, and so many times farther than
ALONE = 3.0  # both neighbours: what a jump of the acceleration leaves is not alone
FEWEST_CHANGES = 40  # of a counted reading, below which nothing is said of the motion
LOOSER = 3.0  # times the median standard deviation: what is vaguer is an end
NO_NEWS = 1e-9  # of a reading's usual weight: a cell that tells so little is left out


class Smoothed(NamedTuple):
    """The reference, at the stamps of the readings it rests on.

    stamps : shape (n,), [ns], in the order of the record, without repeated ones.
    position, velocity : shape (n,); the position counts turns within a piece.
    position_stddev, velocity_stddev : shape (n,), one standard deviation of each.
    outliers : how many readings were left out.
    unexplained : rms speed of what is neither smooth motion nor white noise [rad/s].
    changes : how often a counted reading changes; -1 where readings are not counted.
    """

    stamps: Stamps
    position: Array
    velocity: Array
    position_stddev: Array
    velocity_stddev: Array
    noise: Noise
    outliers: int
    unexplained: float
    changes: int = -1

    @property
    def firm(self) -> NDArray[np.bool_]:
        """Where it knows about as much as in the middle: not at the ends of a piece."""
        return self.velocity_stddev <= LOOSER * float(np.median(self.velocity_stddev))

    @property
    def seldom(self) -> bool:
        """Whether the reading changes too seldom to tell how the joint moves."""
        return 0 <= self.changes < FEWEST_CHANGES

    @property
    def uncertainty(self) -> float:
        """The rms velocity error to be expected where it is firm [rad/s]; nan: nothing is known.

        Infinite where the reading changes too seldom to tell how the joint moves.
        """
        if not len(self.stamps):
            return math.nan
        if self.seldom:
            return math.inf
        variance = float(np.mean(self.velocity_stddev[self.firm] ** 2))
        return math.sqrt(variance + self.unexplained**2)


def smooth(
    stamps: Stamps,
    position: Array,
    period: float,
    *,
    noise: Noise | None = None,
    reading: float | None = None,
) -> Smoothed:
    """The smoothed motion behind a record of positions.

    Parameters
    ----------
    stamps : shape (n,) [ns], as recorded; repeated and late ones are put in order.
    position : shape (n,) [rad or m]; what is no reading of any encoder is left out.
    period : wrap period [rad]; 0: none.
    noise : None: found by maximum likelihood.
    reading : one standard deviation of a reading, where only the jerk is to be found.
    """
    good = np.flatnonzero((np.abs(position) < LARGEST) & (stamps > 0))
    parts = cut(stamps[good], position[good])
    found = noise or white(parts, position[good], period, reading)
    if found is None:
        return _nothing()
    result = [_as_numbers(part, found, period) for part in parts]
    outliers = 0
    if noise is None:
        cleaned = [_without_outliers(part, out, found, period) for part, out in zip(parts, result)]
        outliers = sum(count for _, count in cleaned)
        if outliers:
            parts = [part for part, _ in cleaned]
            found = white(parts, position[good], period, reading) or found
            result = [_as_numbers(part, found, period) for part in parts]
    rows = good[np.concatenate([part.rows for part in parts])]
    rest = [_rest(part, out, period) for part, out in zip(parts, result)]
    weights = [_weights(part, found) for part in parts]
    counted = 0.0 < found.reading < COARSE * found.quantum
    if found.cells or (counted and noise is None and reading is None):
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
        outliers,
        unexplained(parts, rest, weights, found.quantised),
        _changes(parts, found.quantum),
    )


def _weights(part: Piece, noise: Noise) -> Array:
    """One over the variance of each reading; 0 where there is none."""
    return np.where(np.isfinite(part.readings), 1.0 / noise.reading**2, 0.0)


def _as_numbers(part: Piece, noise: Noise, period: float) -> Array:
    """Shape (n, 4): see `smoother_steps.backward`; every reading has the same variance."""
    return _smooth(part, _weights(part, noise), noise, period)


def _as_cells(part: Piece, noise: Noise) -> tuple[Array, Array, Array]:
    """(as `_as_numbers`, what is left of the sites, their weights), of the middles of cells."""
    count = len(part.rows)
    sites = np.empty((count, 2))
    for at in range(0, count, BLOCK):
        first = max(0, at - MARGIN)
        stretch = part.part(first, at + BLOCK + MARGIN - first)
        found, _ = find_sites(stretch, noise.quantum, noise.blur, noise.jerk)
        sites[at : at + BLOCK] = found[at - first : at - first + BLOCK]
    weights = sites[:, 0]
    weights[weights < NO_NEWS / noise.reading**2] = 0.0
    known = weights > 0.0
    told = np.where(known, part.readings, np.nan)
    told[known] += sites[known, 1] / weights[known]
    smoothed = _smooth(part._replace(readings=told), weights, noise, 0.0)
    return smoothed, told - smoothed[:, 0], weights


def _smooth(part: Piece, weights: Array, noise: Noise, period: float) -> Array:
    """Forward once for the states at the beginning of each chunk; then backward chunk by chunk,
    each filtered again, so that memory does not grow with the record.
    """
    ahead, back = compiled(forward), compiled(backward)
    count = len(part.rows)
    starts = range(0, count, CHUNK)
    states, innovations = np.empty((min(CHUNK, count), 9)), np.empty((min(CHUNK, count), 2))
    known = np.flatnonzero(weights > 0.0)
    first = float(part.readings[known[0]]) if len(known) else 0.0
    entered = [start(first, noise.reading**2)]
    for at in starts[:-1]:
        here = slice(at, at + CHUNK)
        entered.append(
            ahead(
                entered[-1],
                part.steps[here],
                part.readings[here],
                weights[here],
                noise.jerk,
                period,
                states,
                innovations,
            )
        )
    smoothed = np.empty((count, 4))
    adjoint: tuple = (0.0,) * 9
    for at, state in zip(reversed(starts), reversed(entered)):
        here = slice(at, at + CHUNK)
        steps = part.steps[here]
        ahead(
            state,
            steps,
            part.readings[here],
            weights[here],
            noise.jerk,
            period,
            states,
            innovations,
        )
        adjoint = back(
            adjoint,
            steps,
            weights[here],
            states[: len(steps)],
            innovations[: len(steps)],
            smoothed[here],
        )
    return smoothed


def _without_outliers(
    part: Piece, smoothed: Array, noise: Noise, period: float
) -> tuple[Piece, int]:
    """The piece without readings that are far from the smoothed motion, and how many were."""
    rest = _rest(part, smoothed, period)
    spread = 1.4826 * float(np.nanmedian(np.abs(rest)))
    far = np.abs(rest) > max(OUTLIER * spread, COUNTS * noise.quantum, 1e-12)
    size = np.nan_to_num(np.abs(rest))
    far[1:-1] &= size[1:-1] > ALONE * np.maximum(size[:-2], size[2:])
    far[0] = False  # a piece starts from its first reading
    if not far.any() or np.mean(far) > 0.1:  # so many are no outliers
        return part, 0
    return part._replace(readings=np.where(far, np.nan, part.readings)), int(np.sum(far))


def _rest(part: Piece, smoothed: Array, period: float) -> Array:
    """What is left of the readings."""
    rest = part.readings - smoothed[:, 0]
    return rest - period * np.floor(rest / period + 0.5) if period > 0.0 else rest


def _changes(parts: list[Piece], quantum: float) -> int:
    """How often the reading changes; -1 where it is not counted (0 where it never changes)."""
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
        Noise(math.nan, math.nan, 0.0, False),
        0,
        math.nan,
    )
