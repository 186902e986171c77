# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Estimate the noise of a record's readings and the jerk of its motion by maximum likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.calls import available, run
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.reference.smoother.cells import along, used
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, start, stretches
from estimator_pkg.evaluation.reference.smoother.steps import SIZE, forward

Array = NDArray[np.float64]

STRETCH_READINGS = 4000  # the likelihood is evaluated on stretches of this many readings,
STRETCHES = 12  # at most this many of them, evenly over the record
RATIOS = np.arange(-16.0, 7.0, 2.0)  # first of the search: log10 of qc h^5 / r
UNSETTLED = 6  # innovations at the start of a piece depend more on its start than on the noise
READING_ROUNDING = 1e-10  # rounding error of a large reading, as a fraction of it,
USUAL_PART = 0.99  # where large is the reading above this fraction of all, to ignore outliers
LEAST_VARIANCE = 1e-60  # variance of readings that are all 0
START_SPEED = 100.0  # speed at a start of the likelihood [standard deviations per sample time]
CELL_READINGS = 24_000  # the probability of cells is evaluated on about this many readings
PLAIN_READINGS = 3_000  # (without the engine), in stretches of
CELL_STRETCH = 1500  # this many readings or, if that is longer, with this many
CHANGES = 20  # changes of the reading; in a short record, it is
SHORT_STRETCH, PARTS = 400, 3  # at least this many readings or this fraction of the record
HIDDEN_CELLS = 4.0  # noise of more quanta than this hides the cells
BLURS = np.log10([0.01, 0.1, 0.3, 0.7, 1.5, HIDDEN_CELLS])  # of the cells' edges, in quanta, and
JERKS = np.arange(-8.0, 3.0, 2.0)  # of the jerk over that of white noise, where the search begins
SOME = 3  # which uses every third stretch
FIRST_STEP, NEAR_STEP, FINE = 0.5, 0.15, 0.05  # sizes of the simplex of a search [decades]
SWEEPS = 3  # forward and backward: the sites converge after two
AGAIN = 1  # passes from the sites of nearby values
OF_A_RUN = 15.0  # number of used cells in a run of equal readings, and its last,
DRIFT_QUANTA = 0.25  # or more, if the motion can drift by this many quanta between them


class ReadingNoise(NamedTuple):
    """The most likely noise of the readings and jerk of the motion.

    reading : one standard deviation of a reading [rad].
    jerk : intensity of the white jerk [rad^2/s^5].
    quantum : of the readings [rad]; 0: not quantised.
    at_floor : the quantisation explains all the noise.
    blur : standard deviation of the blur of the cells [rad]; nan: the readings are numbers with
        white noise.
    """

    reading: float
    jerk: float
    quantum: float
    at_floor: bool
    blur: float = math.nan

    @property
    def cells(self) -> bool:
        """True if the readings are cells."""
        return self.blur == self.blur

    @property
    def quantised(self) -> float:
        """Fraction of a reading's variance that the quantisation explains."""
        return min(1.0, self.quantum**2 / 12.0 / self.reading**2)


def white(parts: list[Piece], readings: Array, period: float) -> ReadingNoise | None:
    """Return noise and jerk intensity of readings, shape (n,), by maximum likelihood, or None.

    With all variances in units of the readings' one, the latter follows in closed form, so one
    search over the ratio of both is enough. If it is below that of the quantisation, it is fixed
    there and only the intensity is searched.
    """
    chosen = stretches(parts, STRETCH_READINGS, STRETCHES)
    if not chosen:
        return None
    step = float(np.median(np.concatenate([part.steps[1:] for part in chosen])))
    size = float(np.quantile(np.abs(readings), USUAL_PART)) if len(readings) else 0.0
    count = quantum(readings)
    floor = max(count * count / 12.0, (READING_ROUNDING * size) ** 2, LEAST_VARIANCE)
    longest = max(len(part.rows) for part in chosen)
    states, innovations = np.empty((longest, SIZE)), np.empty((longest, 2))

    def sums(ratio: float) -> tuple[float, float, int]:
        """Return the sums of log S and of e^2 / S over the innovations, and their number."""
        qc = floor * 10.0**ratio / step**5
        unit = floor + qc * step**5  # so the start is the same for every scale of the variances
        logs, squares, number = 0.0, 0.0, 0
        for part in chosen:
            first = start(part.readings[0], unit, START_SPEED * math.sqrt(unit) / step, step)
            weights = np.where(np.isfinite(part.readings), 1.0 / floor, 0.0)
            weights[0] = 0.0  # the start is the first reading
            columns = part.steps, part.readings, weights
            run(forward, first, len(part.rows), *columns, qc, period, states, innovations)
            e, g = innovations[UNSETTLED : len(part.rows)].T
            e, g = e[g > 0.0], g[g > 0.0]
            logs -= float(np.sum(np.log(g)))
            squares += float(np.sum(e * e / g))
            number += len(g)
        return logs, squares, max(number, 1)

    def free(ratio: float) -> float:
        logs, squares, number = sums(ratio)
        # scaling every variance by `squares / number` makes this the likelihood's maximum
        return logs + number * math.log(max(squares, 1e-300) / number)

    (best,) = _lowest(free, RATIOS)
    _, squares, number = sums(best)
    r = floor * squares / number
    if r > floor:
        return ReadingNoise(math.sqrt(r), r * 10.0**best / step**5, count, False)
    (best,) = _lowest(lambda ratio: sum(sums(ratio)[:2]), RATIOS)
    return ReadingNoise(math.sqrt(floor), floor * 10.0**best / step**5, count, True)


class Cells:
    """A stretch of readings as cells, and the sites that were found last, shape (n, 2).

    In a run of equal readings only some cells are used (`cells.used`). More would count as
    independent although they are not. The sites of the others are 0.

    Parameters
    ----------
    part : its readings are the unwrapped middles of the cells; nan: none.
    quantum : width of a cell [rad].
    """

    def __init__(self, part: Piece, quantum: float) -> None:
        self._part, self._quantum = part, quantum
        self._step, self._speed = part.step, part.speed
        self._passes = 2 * SWEEPS
        self.sites = np.zeros((len(part.readings), 2))

    def probability(self, blur: float, jerk: float) -> float:
        """Return the log of the probability of the readings; the sites are those that give it.

        Parameters
        ----------
        blur, jerk : standard deviation of the cells' blur [rad], intensity of the white jerk
            [rad^2/s^5].
        """
        # white jerk drifts by sqrt(jerk t^5 / 20) in a time t
        drift = (20.0 * (DRIFT_QUANTA * self._quantum) ** 2 / jerk) ** 0.2 / self._step
        count = len(self._part.rows)
        rows, gaps = np.empty(count, np.int64), np.empty(count + 1)
        columns = self._part.readings, self._part.steps
        drift = min(drift, float(count))
        count = run(used, count, *columns, self._quantum, drift, OF_A_RUN, rows, gaps)
        if not count:
            return 0.0
        rows, gaps = rows[:count], gaps[: count + 1]
        half = 0.5 * self._quantum
        variance = half * half / 3.0 + blur * blur
        sites = self.sites[rows]
        new = sites[:, 0] == 0.0
        sites[new] = 1.0 / variance, 0.0
        first = start(0.0, variance, self._speed, self._step)
        centres, messages = self._part.readings[rows], np.empty((count, SIZE))
        values = gaps, centres, half, blur, jerk, sites, messages, self._passes + 1
        log_z = run(along, first, count, *values)
        self.sites[:] = 0.0
        self.sites[rows] = sites
        self._passes = AGAIN
        return float(log_z)


def in_cells(parts: list[Piece], rough: ReadingNoise) -> ReadingNoise:
    """Return the same for readings as cells: the most probable blur and jerk.

    Parameters
    ----------
    parts : with the unwrapped middles of the cells as readings.
    rough : the result of `white`.
    """
    count, middle = rough.quantum, math.log10(rough.jerk)
    chosen = _telling(parts, count)

    def rarity(among: Sequence[Piece]) -> Callable[[float, float], float]:
        cells = [Cells(part, count) for part in among]

        def of(size: float, power: float) -> float:
            blur, jerk = count * 10.0**size, 10.0 ** (middle + power)
            return -sum(each.probability(blur, jerk) for each in cells)

        return of

    some = chosen[(len(chosen) - 1) // 2 % SOME :: SOME]
    rough_ = _lowest(rarity(some), BLURS, JERKS)
    size, power = _lowest(rarity(chosen), BLURS, JERKS, near=rough_)
    blur = count * 10.0**size
    reading = math.sqrt(count * count / 12.0 + blur * blur)
    return ReadingNoise(reading, 10.0 ** (middle + power), count, blur < 0.1 * count, blur)


def _telling(parts: list[Piece], count: float) -> list[Piece]:
    """Return stretches long enough to contain changes of the reading."""
    changes = sum(
        int(np.count_nonzero(np.abs(np.diff(part.readings)) > 0.5 * count)) for part in parts
    )
    total = sum(len(part.rows) for part in parts)
    length = min(CELL_STRETCH, max(SHORT_STRETCH, -(-total // PARTS)))
    length = max(length, round(CHANGES * total / max(changes, 1)))
    readings = CELL_READINGS if available() else PLAIN_READINGS
    return stretches(parts, min(length, readings // 2), max(2, readings // length))


def _lowest(
    function: Callable[..., float], *axes: Array, near: tuple[float, ...] = ()
) -> tuple[float, ...]:
    """Return where `function` has a minimum, within the ends of the axes.

    The simplex search of Nelder and Mead, The Computer Journal 7 (1965), until its points are
    within `FINE` of the best.

    Parameters
    ----------
    axes : for each argument, increasing; the search begins at the best point of their grid.
    near : it begins here instead, with smaller steps.
    """
    low, high = (np.array([axis[end] for axis in axes]) for end in (0, -1))

    def at(point: Array | tuple[float, ...]) -> tuple[float, tuple[float, ...]]:
        inside = tuple(np.clip(point, low, high).tolist())
        return function(*inside), inside

    first = at(near) if near else min(map(at, product(*axes)))
    step = NEAR_STEP if near else FIRST_STEP
    sides = step * np.diag(np.where(np.add(first[1], step) > high, -1.0, 1.0))
    found = sorted([first, *(at(first[1] + side) for side in sides)])
    while np.max(np.abs(np.subtract([each for _, each in found], found[0][1]))) > FINE:
        centre = np.mean([each for _, each in found[:-1]], axis=0)
        away = centre - found[-1][1]
        tried = at(centre + away)
        if tried < found[0]:
            tried = min(tried, at(centre + 2.0 * away))
        elif tried >= found[-2]:
            tried = min(tried, at(centre + (0.5 if tried < found[-1] else -0.5) * away))
        if tried < found[-1]:
            found[-1] = tried
        else:  # shrink to the best
            found[1:] = [at(0.5 * np.add(each, found[0][1])) for _, each in found[1:]]
        found.sort()
    return found[0][1]
