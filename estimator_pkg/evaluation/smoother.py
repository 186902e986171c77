"""The off-line reference: velocity from the measured position alone, with hindsight.

A fixed-interval smoother for a motion driven by white jerk, at irregular stamps and on wrapped
angles. The variance of the readings and the intensity of the jerk are those that make the readings
most likely; the former is never below that of the quantisation (quantum^2 / 12). It gives its own
standard deviation, and with that it can say whether it is good enough to judge an observer.

What it cannot see: jumps of the acceleration (dry friction, square waves) are smeared over a few
samples, and the error of a quantiser that moves less than a count per sample is not white, as it
assumes. A fast motion within a slow one, as the chatter of a drive, is taken for noise; but then
what is left of the readings is not white, and the speed that it would be, were it motion, is told
beside the standard deviation (`unexplained`). Observers and reference read the same sensor, so that
their errors are not independent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import compiled
from estimator_pkg.evaluation.matching import pieces
from estimator_pkg.evaluation.quantum import quantum
from estimator_pkg.evaluation.smoother_steps import backward, forward, likelihood

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

HOLE = 0.2              # a longer hole [s], or one of
HOLE_STEPS = 10.0       # so many median sample times if that is longer, parts the record
FEWEST = 12             # readings in a piece, below which it is left out
STRETCH = 4000          # the likelihood is judged on stretches of so many readings,
STRETCHES = 12          # at most so many of them, spread over the record
CHUNK = 65536           # readings whose filter states are in memory at a time
LOOSE = 1e6             # variance of speed and acceleration at the start of a piece
RATIOS = (-16.0, 6.0)   # log10 of qc h^5 / r is sought between these
OUTLIER = 8.0           # readings so many robust deviations from the smoothed are left out
COUNTS = 2.0            # if they are at least so many quanta off, and so many times farther than
ALONE = 3.0             # both neighbours: what a jump of the acceleration leaves is not alone
WINDOW = 128            # readings of a window of the spectrum of what is left of them
CLEAR = 2.0             # of white noise, the spectrum stays below so many times its level
QUANTISER = 1.2         # times quantum^2 / 12 is what a quantiser may leave
LOOSER = 3.0            # times the median standard deviation: what is vaguer is an end
TINY = 1e-10            # part of the largest reading that its rounding may be


class Noise(NamedTuple):
    """What the readings are most likely to have come from.

    reading : one standard deviation of a reading [rad].
    jerk : intensity of the white jerk [rad^2/s^5].
    quantum : of the readings [rad]; 0: none seen.
    at_floor : the quantisation explains all the noise there is.
    """

    reading: float
    jerk: float
    quantum: float
    at_floor: bool


class Smoothed(NamedTuple):
    """The reference, at the stamps of the readings it rests on.

    stamps : shape (n,), [ns], in the order of the record, without repeated ones.
    position, velocity : shape (n,); the position counts turns within a piece.
    position_stddev, velocity_stddev : shape (n,), one standard deviation of each.
    outliers : how many readings were left out.
    unexplained : rms speed of what is neither smooth motion nor white noise [rad/s].
    """

    stamps: Stamps
    position: Array
    velocity: Array
    position_stddev: Array
    velocity_stddev: Array
    noise: Noise
    outliers: int
    unexplained: float

    @property
    def firm(self) -> NDArray[np.bool_]:
        """Where it knows about as much as in the middle: not at the ends of a piece."""
        return self.velocity_stddev <= LOOSER * float(np.median(self.velocity_stddev))

    @property
    def uncertainty(self) -> float:
        """The rms velocity error to be expected where it is firm [rad/s]; nan: nothing is known."""
        if not len(self.stamps):
            return math.nan
        variance = float(np.mean(self.velocity_stddev[self.firm] ** 2))
        return math.sqrt(variance + self.unexplained ** 2)


class _Piece(NamedTuple):
    """Readings in a row without a hole."""

    rows: NDArray[np.int64]
    steps: Array
    readings: Array


def smooth(stamps: Stamps, position: Array, period: float, *, noise: Noise | None = None,
           reading: float | None = None) -> Smoothed:
    """The smoothed motion behind a record of positions.

    Parameters
    ----------
    stamps : shape (n,) [ns], as recorded; repeated and late ones are put in order.
    position : shape (n,) [rad or m]; nan is left out.
    period : wrap period [rad]; 0: none.
    noise : None: found by maximum likelihood.
    reading : one standard deviation of a reading, where only the jerk is to be found.
    """
    good = np.flatnonzero(np.isfinite(position) & (stamps > 0))
    parts = _pieces(stamps[good], position[good])
    found = noise or most_likely(parts, position[good], period, reading)
    if found is None:
        return _nothing()
    result = [_smooth(part, found, period) for part in parts]
    outliers = 0
    if noise is None:
        cleaned = [_without_outliers(part, out, found, period) for part, out in zip(parts, result)]
        outliers = sum(count for _, count in cleaned)
        if outliers:
            parts = [part for part, _ in cleaned]
            found = most_likely(parts, position[good], period, reading) or found
            result = [_smooth(part, found, period) for part in parts]
    rows = good[np.concatenate([part.rows for part in parts])]
    columns = np.concatenate(result)
    rest = [_rest(part, out, period) for part, out in zip(parts, result)]
    return Smoothed(stamps[rows], columns[:, 0], columns[:, 1], columns[:, 2], columns[:, 3],
                    found, outliers, _unexplained(parts, rest, found))


def most_likely(parts: list[_Piece], readings: Array, period: float,
                reading: float | None = None) -> Noise | None:
    """Noise of the readings and intensity of the jerk by maximum innovation likelihood.

    With all variances in units of that of the readings, the latter follows in closed form, so that
    one search over the ratio of both is enough. Where it comes out below what the quantisation
    gives, it is held there and the intensity alone is sought; a given `reading` is held likewise.
    """
    stretches = _stretches(parts)
    if not stretches:
        return None
    step = float(np.median(np.concatenate([part.steps[1:] for part in stretches])))
    size = float(np.max(np.abs(readings))) if len(readings) else 0.0
    count = quantum(readings)
    floor = max(count * count / 12.0, (TINY * max(size, 1.0)) ** 2)
    if reading is not None:
        floor = reading * reading
    judge = compiled(likelihood)

    def sums(r: float, qc: float) -> tuple[float, float, int]:
        logs, squares, number = 0.0, 0.0, 0
        for part in stretches:
            found = judge(_start(part, r), part.steps, part.readings, r, qc, period)
            logs, squares, number = logs + found[0], squares + found[1], number + found[2]
        return logs, squares, number

    def free(ratio: float) -> float:
        logs, squares, number = sums(floor, floor * 10.0 ** ratio / step ** 5)
        # scaling every variance by `squares / number` makes this the likelihood's maximum
        return logs + number * math.log(max(squares, 1e-300) / max(number, 1))

    if reading is None:
        best = _lowest(free, *RATIOS)
        _, squares, number = sums(floor, floor * 10.0 ** best / step ** 5)
        r = floor * squares / max(number, 1)
        if r > floor:
            return Noise(math.sqrt(r), r * 10.0 ** best / step ** 5, count, False)

    def held(ratio: float) -> float:
        logs, squares, _ = sums(floor, floor * 10.0 ** ratio / step ** 5)
        return logs + squares

    best = _lowest(held, *RATIOS)
    return Noise(math.sqrt(floor), floor * 10.0 ** best / step ** 5, count, True)


def _pieces(stamps: Stamps, position: Array) -> list[_Piece]:
    """The record between holes and clock jumps."""
    found = []
    for run in pieces(stamps):
        steps = np.diff(stamps[run]) * 1e-9
        if not len(steps):
            continue
        longest = max(HOLE, HOLE_STEPS * float(np.median(steps)))
        for rows in np.split(run, np.flatnonzero(steps > longest) + 1):
            if len(rows) >= FEWEST:
                between = np.diff(stamps[rows], prepend=stamps[rows[0]]) * 1e-9
                found.append(_Piece(rows, between, position[rows]))
    return found


def _stretches(parts: list[_Piece]) -> list[_Piece]:
    """What the likelihood is judged on: everything, or stretches spread evenly over the record."""
    cut = [_Piece(part.rows[at:at + STRETCH], part.steps[at:at + STRETCH],
                  part.readings[at:at + STRETCH])
           for part in parts for at in range(0, max(1, len(part.rows) - FEWEST), STRETCH)]
    cut = [part for part in cut if np.isfinite(part.readings[0])]
    if len(cut) <= STRETCHES:
        return cut
    return [cut[round(at)] for at in np.linspace(0, len(cut) - 1, STRETCHES)]


def _start(part: _Piece, r: float) -> tuple[float, ...]:
    """The state before a piece: where its first reading is, speed and acceleration open."""
    return (float(part.readings[0]), 0.0, 0.0, 100.0 * r, 0.0, 0.0, LOOSE, 0.0, LOOSE)


def _smooth(part: _Piece, noise: Noise, period: float) -> Array:
    """Shape (n, 4): see `smoother_steps.backward`.

    Forward once for the states at the beginning of each chunk; then backward chunk by chunk, each
    filtered again, so that memory does not grow with the record.
    """
    ahead, back = compiled(forward), compiled(backward)
    r, count = noise.reading * noise.reading, len(part.rows)
    starts = range(0, count, CHUNK)
    states, innovations = np.empty((min(CHUNK, count), 9)), np.empty((min(CHUNK, count), 2))
    entered = [_start(part, r)]
    for at in starts[:-1]:
        entered.append(ahead(entered[-1], part.steps[at:at + CHUNK], part.readings[at:at + CHUNK],
                             r, noise.jerk, period, states, innovations))
    smoothed = np.empty((count, 4))
    adjoint: tuple = (0.0,) * 9
    for at, state in zip(reversed(starts), reversed(entered)):
        steps, readings = part.steps[at:at + CHUNK], part.readings[at:at + CHUNK]
        ahead(state, steps, readings, r, noise.jerk, period, states, innovations)
        adjoint = back(adjoint, steps, r, states[:len(steps)], innovations[:len(steps)],
                       smoothed[at:at + CHUNK])
    return smoothed


def _without_outliers(part: _Piece, smoothed: Array, noise: Noise, period: float
                      ) -> tuple[_Piece, int]:
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


def _rest(part: _Piece, smoothed: Array, period: float) -> Array:
    """What is left of the readings."""
    rest = part.readings - smoothed[:, 0]
    return rest - period * np.floor(rest / period + 0.5) if period > 0.0 else rest


def _unexplained(parts: list[_Piece], rest: list[Array], noise: Noise) -> float:
    """The rms speed of the part of `rest` that stands out of white noise [rad/s].

    Power spectral density over half-overlapping windows; what exceeds `CLEAR` times the white level
    (the median, but at least that of the quantisation) is held to be motion, as far as there is
    more in `rest` than a quantiser leaves: its error alone need not be white.
    """
    step = float(np.median(np.concatenate([part.steps[1:] for part in parts])))
    window = np.hanning(WINDOW)
    power, count = np.zeros(WINDOW // 2 + 1), 0
    for values in rest:
        values = np.where(np.isfinite(values), values, 0.0)
        for at in range(0, len(values) - WINDOW + 1, WINDOW // 2):
            piece = values[at:at + WINDOW]
            power += np.abs(np.fft.rfft(window * (piece - np.mean(piece)))) ** 2
            count += 1
    if not count:
        return 0.0
    power *= 2.0 * step / (count * float(np.sum(window * window)))
    frequency = np.fft.rfftfreq(WINDOW, step)
    white = max(noise.quantum ** 2 / 6.0 * step, float(np.median(power)))
    excess = np.maximum(power - CLEAR * white, 0.0)
    colour = float(np.sum(excess)) * frequency[1]
    if colour <= 0.0:
        return 0.0
    known = np.concatenate(rest)
    surplus = float(np.nanmean(known * known)) - QUANTISER * noise.quantum ** 2 / 12.0
    speed = float(np.sum((2.0 * math.pi * frequency) ** 2 * excess)) * frequency[1]
    return math.sqrt(speed * min(1.0, max(0.0, surplus / colour)))


def _lowest(function: Callable[[float], float], low: float, high: float) -> float:
    """Where `function` is lowest: a coarse look, then golden section."""
    grid = np.arange(low, high + 0.5, 1.0)
    values = [function(float(at)) for at in grid]
    best = float(grid[int(np.argmin(values))])
    low, high = max(low, best - 1.0), min(high, best + 1.0)
    part = (math.sqrt(5.0) - 1.0) / 2.0
    left, right = high - part * (high - low), low + part * (high - low)
    at_left, at_right = function(left), function(right)
    while high - low > 0.02:
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - part * (high - low)
            at_left = function(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + part * (high - low)
            at_right = function(right)
    return 0.5 * (low + high)


def _nothing() -> Smoothed:
    none = np.zeros(0)
    return Smoothed(np.zeros(0, np.int64), none, none, none, none,
                    Noise(math.nan, math.nan, 0.0, False), 0, math.nan)
