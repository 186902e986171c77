# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Estimate the noise of a record's readings and the jerk of its motion by maximum likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.calls import available, run
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, start, stretches
from estimator_pkg.evaluation.reference.smoother.sites import Stretch
from estimator_pkg.evaluation.reference.smoother.steps import LikelihoodSums, likelihood

Array = NDArray[np.float64]

STRETCH_READINGS = 4000  # the likelihood is evaluated on stretches of this many readings,
STRETCHES = 12  # at most this many of them, evenly over the record
RATIOS = (-16.0, 6.0)  # search range of log10 of qc h^5 / r
READING_ROUNDING = 1e-10  # rounding error of a large reading, as a fraction of it,
USUAL_PART = 0.99  # where large is the reading above this fraction of all, to ignore outliers
LEAST_VARIANCE = 1e-60  # variance of readings that are all 0
START_SPEED = 100.0  # speed at a start of the likelihood [standard deviations per sample time]
CELL_READINGS = 24_000  # the probability of cells is evaluated on about this many readings
PLAIN_READINGS = 3_000  # (without the engine), in stretches of
CELL_STRETCH = 1500  # this many readings or, if that is longer, with this many
CHANGES = 20  # changes of the reading; in a short record, it is
SHORT_STRETCH, PARTS = 400, 3  # at least this many readings or this fraction of the record
LIKELY = 2  # this many blurs of the rough search are compared again
SOME = 3  # the first coarse search uses every third stretch, not only the first
HIDDEN_CELLS = 4.0  # noise of more quanta than this hides the cells
SHARP = 0.01  # smallest blur of the cells' edges, in quanta
BLURS = (SHARP, 0.1, 0.3, 0.7, 1.5, HIDDEN_CELLS)
GOLDEN_WIDTH = 0.15  # width of the golden section that a parabola ends [decades]
FIRST_STEP, LAST_STEP = 0.3, 0.1  # differences of the searches for both [decades]
MOST_STEPS, LEAST_GAIN = 8, 0.5  # steps of it, and the smallest gain that is worth another one,
NEAR_GAIN = 2.0  # or that a step promises
FARTHEST = 0.6  # longest step [decades]
STEEP = 9  # the search for the jerk covers this many decades below that of white noise


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

    def sums(r: float, qc: float) -> tuple[float, float, int]:
        found = LikelihoodSums()
        unit = r + qc * step**5  # so the start is the same for every scale of the variances
        for part in chosen:
            first = start(part.readings[0], unit, START_SPEED * math.sqrt(unit) / step, step)
            columns = part.steps, part.readings
            run(likelihood, found, first, len(part.rows), *columns, r, qc, period)
        return found.logs, found.squares, found.count

    @lru_cache
    def at_floor(ratio: float) -> tuple[float, float, int]:
        return sums(floor, floor * 10.0**ratio / step**5)

    def free(ratio: float) -> float:
        logs, squares, number = at_floor(ratio)
        # scaling every variance by `squares / number` makes this the likelihood's maximum
        return logs + number * math.log(max(squares, 1e-300) / max(number, 1))

    best = _lowest(free, *RATIOS, GOLDEN_WIDTH)
    _, squares, number = at_floor(best)
    r = floor * squares / max(number, 1)
    if r > floor:
        return ReadingNoise(math.sqrt(r), r * 10.0**best / step**5, count, False)

    def held(ratio: float) -> float:
        logs, squares, _ = at_floor(ratio)
        return logs + squares

    best = _lowest(held, *RATIOS, GOLDEN_WIDTH)
    return ReadingNoise(math.sqrt(floor), floor * 10.0**best / step**5, count, True)


def in_cells(parts: list[Piece], rough: ReadingNoise) -> ReadingNoise:
    """Return the same for readings as cells: the most probable blur and jerk.

    Parameters
    ----------
    parts : with the unwrapped middles of the cells as readings.
    rough : the result of `white`.
    """
    count = rough.quantum
    chosen = [Stretch(part, count) for part in _telling(parts, count)]
    some = chosen[(len(chosen) - 1) // 2 % SOME :: SOME]

    def guessed(part: float, power: float) -> float:
        return -sum(each.guess(part * count, 10.0**power) for each in some)

    def seldom(part: float, power: float) -> float:
        return -sum(each.probability(part * count, 10.0**power, 1) for each in some)

    def rarity(among: list[Stretch], power: float, size: float) -> float:
        return -sum(each.probability(count * 10.0**size, 10.0**power) for each in among)

    middle = math.log10(rough.jerk)

    @lru_cache
    def rough_of(part: float, up: int) -> float:
        return guessed(part, middle + up)

    ups: dict[float, int] = {}
    up, first = 0, range(0, STEEP + 1, 2)
    for part in BLURS:
        up = ups[part] = _downhill(partial(rough_of, part), first)
        first = range(up, up + 1)  # the next blur's jerk is near

    def start_of(part: float) -> tuple[float, float, float]:
        """Return (rarity in the rough search, blur in quanta, log10 of the jerk)."""
        near: dict[float, float] = {}
        _downhill(lambda up: near.setdefault(middle + up, seldom(part, middle + up)), [ups[part]])
        return min(near.values()), part, vertex(near)

    likely = sorted(BLURS, key=lambda part: rough_of(part, ups[part]))[:LIKELY]
    _, part, power = min(map(start_of, likely))
    size, least = math.log10(part), math.log10(SHARP)
    for among, step in (
        (some, FIRST_STEP),
        (chosen, LAST_STEP),
    ):  # a third of the stretches is enough far from the optimum
        power, size = _newton(partial(rarity, among), power, size, least, step)
    blur = count * 10.0**size
    return ReadingNoise(
        math.sqrt(count * count / 12.0 + blur * blur), 10.0**power, count, blur < 0.1 * count, blur
    )


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


def _downhill(function: Callable[[int], float], first: Iterable[int]) -> int:
    """Return the integer from `-STEEP` on at which `function` has a minimum.

    From the best of the `first` ones it steps to the lower neighbour.
    """
    value = lru_cache(function)
    last, best = max(first), min(first, key=value)
    while True:
        near = [at for at in (best, best - 1, best + 1) if -STEEP <= at <= max(last, STEEP)]
        lower = min(near, key=value)
        if lower == best:
            return best
        best = lower


def _lowest(function: Callable[[float], float], low: float, high: float, fine: float) -> float:
    """Return the argument of the minimum of `function`: a grid, golden section, and a parabola."""
    seen = {float(at): function(float(at)) for at in np.arange(low, high + 0.5, 2.0)}
    for near in (-1.0, 1.0):
        at = min(seen, key=lambda at: seen[at]) + near
        if low <= at <= high and at not in seen:
            seen[at] = function(at)
    best = min(seen, key=lambda at: seen[at])
    low, high = max(low, best - 1.0), min(high, best + 1.0)
    part = (math.sqrt(5.0) - 1.0) / 2.0
    left, right = high - part * (high - low), low + part * (high - low)
    seen[left], seen[right] = function(left), function(right)
    while high - low > fine:
        if seen[left] < seen[right]:
            high, right = right, left
            left = high - part * (high - low)
            seen[left] = function(left)
        else:
            low, left = left, right
            right = low + part * (high - low)
            seen[right] = function(right)
    return vertex(seen)


def _newton(
    function: Callable[[float, float], float], x: float, y: float, least: float, step: float
) -> tuple[float, float]:
    """Return the minimum (x, y), y >= `least`, near a start: Newton with differences of `step`.

    The search ends where a step promises little: half the product of the gradient and the step.
    """
    before, most = (math.inf, x, y), FARTHEST / step
    for _ in range(MOST_STEPS):
        y = least if y < least + 0.5 * step else max(y, least + step)
        here = function(x, y)
        if here > before[0]:  # too far: half the way
            x, y = 0.5 * (x + before[1]), 0.5 * (y + before[2])
            continue
        east, west, north = (function(x + step, y), function(x - step, y), function(x, y + step))
        gx, hxx = 0.5 * (east - west), max(east + west - 2.0 * here, 0.0)
        gy = north - here
        if y == least:
            dx, dy = _bounded(-gx, hxx, most), step if gy < 0.0 else 0.0
        else:
            south, both = function(x, y - step), function(x + step, y + step)
            gy, hyy = 0.5 * (north - south), max(north + south - 2.0 * here, 0.0)
            hxy = both - east - north + here
            det = hxx * hyy - hxy * hxy
            if det > 0.01 * hxx * hyy:
                dx = _bounded(hxy * gy - hyy * gx, det, most)
                dy = _bounded(hxy * gx - hxx * gy, det, most)
            else:
                dx, dy = _bounded(-gx, hxx, most), _bounded(-gy, hyy, most)
        near = max(abs(dx), abs(dy)) < 1.0 or -0.5 * (gx * dx + gy * dy) < NEAR_GAIN
        slow = here > before[0] - LEAST_GAIN
        before = here, x, y
        if near or not slow:
            x, y = x + step * dx, y + step * dy
        if near or slow:
            break
    return x, max(y, least)


def _bounded(over: float, under: float, most: float) -> float:
    """Return the ratio within -`most` and `most`; 2 with the right sign for no positive `under`."""
    return min(max(over / under, -most), most) if under > 0.0 else math.copysign(2.0, over)


def vertex(seen: Mapping[float, float]) -> float:
    """Return the lowest point of the parabola through the lowest of these values and neighbours."""
    at = sorted(seen)
    i = min(range(len(at)), key=lambda i: seen[at[i]])
    if i in (0, len(at) - 1):
        return at[i]
    left, right = at[i] - at[i - 1], at[i + 1] - at[i]
    down, up = seen[at[i - 1]] - seen[at[i]], seen[at[i + 1]] - seen[at[i]]
    bend = left * up + right * down
    return at[i] + 0.5 * (left * left * up - right * right * down) / bend if bend else at[i]
