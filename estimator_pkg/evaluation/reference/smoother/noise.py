# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Estimate the noise of a record's readings and the jerk of its motion by maximum likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import available, compiled
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, start, stretches
from estimator_pkg.evaluation.reference.smoother.sites import SWEEPS, find_sites
from estimator_pkg.evaluation.reference.smoother.steps import likelihood

Array = NDArray[np.float64]

STRETCH = 4000  # the likelihood is evaluated on stretches of this many readings,
STRETCHES = 12  # at most this many of them, evenly over the record
RATIOS = (-16.0, 6.0)  # search range of log10 of qc h^5 / r
TINY = 1e-10  # rounding error of a large reading, as a fraction of it,
USUAL = 0.99  # where large is the reading above this fraction of all, to ignore outliers
CELL_READINGS = 24_000  # the probability of cells is evaluated on about this many readings
PLAIN_READINGS = 3_000  # (without compilation), in stretches of
CELL_STRETCH = 1500  # this many readings or, if that is longer, with this many
CHANGES = 20  # changes of the reading
SOME = 3  # the first coarse search uses every third stretch
COARSE = 4.0  # noise of more quanta than this hides the cells
SHARP = 0.01  # smallest blur of the cells' edges, in quanta
BLURS = (SHARP, 0.1, 0.3, 0.7, 1.5, COARSE)
STEEP = 9  # the search for the jerk covers this many decades below that of white noise


class Noise(NamedTuple):
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


def white(
    parts: list[Piece], readings: Array, period: float, reading: float | None = None
) -> Noise | None:
    """Return reading noise and jerk intensity by maximum innovation likelihood, or None.

    With all variances in units of the readings' one, the latter follows in closed form, so one
    search over the ratio of both is enough. If it is below that of the quantisation, it is fixed
    there and only the intensity is searched; a given `reading` is fixed likewise.
    """
    chosen = stretches(parts, STRETCH, STRETCHES)
    if not chosen:
        return None
    step = float(np.median(np.concatenate([part.steps[1:] for part in chosen])))
    size = float(np.quantile(np.abs(readings), USUAL)) if len(readings) else 0.0
    count = quantum(readings)
    floor = max(count * count / 12.0, (TINY * max(size, 1.0)) ** 2)
    if reading is not None:
        floor = reading * reading
    judge = compiled(likelihood)

    def sums(r: float, qc: float) -> tuple[float, float, int]:
        logs, squares, number = 0.0, 0.0, 0
        for part in chosen:
            found = judge(start(part.readings[0], r), part.steps, part.readings, r, qc, period)
            logs, squares, number = logs + found[0], squares + found[1], number + found[2]
        return logs, squares, number

    def free(ratio: float) -> float:
        logs, squares, number = sums(floor, floor * 10.0**ratio / step**5)
        # scaling every variance by `squares / number` makes this the likelihood's maximum
        return logs + number * math.log(max(squares, 1e-300) / max(number, 1))

    if reading is None:
        best = _lowest(free, *RATIOS, 0.02)
        _, squares, number = sums(floor, floor * 10.0**best / step**5)
        r = floor * squares / max(number, 1)
        if r > floor:
            return Noise(math.sqrt(r), r * 10.0**best / step**5, count, False)

    def held(ratio: float) -> float:
        logs, squares, _ = sums(floor, floor * 10.0**ratio / step**5)
        return logs + squares

    best = _lowest(held, *RATIOS, 0.02)
    return Noise(math.sqrt(floor), floor * 10.0**best / step**5, count, True)


def in_cells(parts: list[Piece], rough: Noise) -> Noise:
    """Return the same for readings as cells: the most probable blur and jerk.

    Parameters
    ----------
    parts : with the unwrapped middles of the cells as readings.
    rough : the result of `white`.
    """
    count = rough.quantum
    chosen = _telling(parts, count)
    some = chosen[::SOME]

    def unlikely(among: list[Piece], blur: float, jerk: float, sweeps: int = SWEEPS) -> float:
        return -sum(find_sites(part, count, blur, jerk, sweeps)[1] for part in among)

    middle = math.log10(rough.jerk)
    grid = []
    for part in BLURS:
        seen = [
            (unlikely(some, part * count, 10.0 ** (middle + up), 1), part, middle + up)
            for up in range(STEEP + 1)
        ]
        while seen[0] <= min(seen[:2]):  # the lowest value is the last one: go on downwards
            power = seen[0][2] - 1.0
            if power < middle - STEEP:
                break
            seen.insert(0, (unlikely(some, part * count, 10.0**power, 1), part, power))
        grid += seen
    _, part, power = min(grid)
    power = _lowest(
        lambda at: unlikely(chosen, part * count, 10.0**at), power - 1.0, power + 1.0, 0.1
    )
    size = _lowest(
        lambda at: unlikely(chosen, count * 10.0**at, 10.0**power),
        max(math.log10(SHARP), math.log10(part) - 0.5),
        math.log10(part) + 0.5,
        0.05,
    )
    blur = count * 10.0**size
    power = _lowest(lambda at: unlikely(chosen, blur, 10.0**at), power - 1.0, power + 1.0, 0.05)
    return Noise(
        math.sqrt(count * count / 12.0 + blur * blur), 10.0**power, count, blur < 0.1 * count, blur
    )


def _telling(parts: list[Piece], count: float) -> list[Piece]:
    """Return stretches long enough to contain changes of the reading."""
    changes = sum(
        int(np.count_nonzero(np.abs(np.diff(part.readings)) > 0.5 * count)) for part in parts
    )
    total = sum(len(part.rows) for part in parts)
    length = max(CELL_STRETCH, round(CHANGES * total / max(changes, 1)))
    readings = CELL_READINGS if available() else PLAIN_READINGS
    return stretches(parts, min(length, readings // 2), max(2, readings // length))


def _lowest(function: Callable[[float], float], low: float, high: float, fine: float) -> float:
    """Return the argument of the minimum of `function`: a grid, then golden section."""
    grid = np.arange(low, high + 0.5, 1.0)
    values = [function(float(at)) for at in grid]
    best = float(grid[int(np.argmin(values))])
    low, high = max(low, best - 1.0), min(high, best + 1.0)
    part = (math.sqrt(5.0) - 1.0) / 2.0
    left, right = high - part * (high - low), low + part * (high - low)
    at_left, at_right = function(left), function(right)
    while high - low > fine:
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - part * (high - low)
            at_left = function(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + part * (high - low)
            at_right = function(right)
    return 0.5 * (low + high)
