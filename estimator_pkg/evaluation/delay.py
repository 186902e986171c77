# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The delay of an estimate: the shift that minimises its error, finer than a sample.

A coarse search over integer samples (by FFT) finds the minimum nearest to zero. Around it the mean
square error is symmetric, and the middle of the two sides is the delay. The two sides are compared
an integer number of samples apart: interpolation smooths noise by an amount that depends on the
position between two samples, and this effect cancels in the difference. The asymmetry of the truth
itself within the record (a sine that is cut off, say) is subtracted.

The interval is that of a linear fit of the remaining error to the truth's slope over the two sides,
from blocks of time as in `evaluation.pairs`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation import pairs
from estimator_pkg.evaluation.signals import cubic, slopes

Array = NDArray[np.float64]

LONGEST_DELAY = 0.25  # largest delay of the search [s], or ten samples if that is longer
GAP_STEPS = 5.0  # longest gap for interpolation, in median sample times
NEAR_LEAST = 0.05  # minima within this fraction of the error's range above the best count as equal
RISE_PART = 0.1  # the two sides are compared where the error has risen by this fraction
CLEAR_RISE = 0.2  # the error must depend on the shift by this fraction, else there is no result
OVER_NOISE = 6.0  # and by this over the root of the number of samples: noise alone gives less
DELAY_TOLERANCE = 1e-9  # of the delay [s]
GRID_POINTS, PER_SAMPLE = 1 << 20, 64  # the search's grid: at most, and for each sample
MOTION = 2.0  # the truth's variance must exceed its noise power by this factor
VAGUE_STEPS = 2.0  # a delay within this many samples of zero may be less than its interval


class Delay(NamedTuple):
    """A delay and half of its 95 % interval [s]; nan where the signals do not determine them."""

    late: float
    half: float

    @property
    def known(self) -> Delay:
        """The same; both nan where the motion does not determine the delay."""
        return self if math.isfinite(self.half) else UNKNOWN_DELAY


UNKNOWN_DELAY = Delay(math.nan, math.nan)


def delay(time: Array, estimate: Array, truth: Array) -> float:
    """Return the lag [s] of `estimate` behind `truth`; nan if the signals do not determine it.

    Parameters
    ----------
    time : shape (n,), increasing [s].
    estimate, truth : shape (n,), at these times.
    """
    return measured(time, estimate, truth).late


def measured(time: Array, estimate: Array, truth: Array) -> Delay:
    """Return the lag with its interval.

    The motion does not determine the lag where half the interval exceeds both the lag and
    `VAGUE_STEPS` samples, nor where the smallest error is not midway between its two sides.

    Parameters
    ----------
    time, estimate, truth : shape (n,), as those of `delay`.
    """
    good = np.isfinite(estimate) & np.isfinite(truth)
    time, estimate, truth = time[good], estimate[good], truth[good]
    if len(time) < 8 or np.var(truth) <= MOTION * noise_power(truth):
        return UNKNOWN_DELAY
    steps = np.diff(time)
    step = float(np.median(steps))
    longest = max(LONGEST_DELAY, 10.0 * step)
    # long gaps are shortened: they contain no samples, and the grid need not span them
    steps = np.minimum(steps, 3.0 * longest)
    time = np.concatenate([[0.0], np.cumsum(steps)])
    level = float(np.mean(truth))
    estimate, truth = estimate - level, truth - level
    hole = steps > GAP_STEPS * step
    step = max(step, float(time[-1]) / (GRID_POINTS + PER_SAMPLE * len(time)))  # of stray stamps
    pair = _Pair(time, estimate, truth, hole, step)
    errors = _coarse(pair, int(min(longest, time[-1]) / step))
    best, rise = _nearest_minimum(
        errors,
        max(CLEAR_RISE, OVER_NOISE / len(time) ** 0.5),
        float(np.mean(truth * truth)) + level * level,
    )
    if rise == 0:
        return UNKNOWN_DELAY
    late, half = _middle(pair, best * step, rise * step)
    return Delay(late, half if half <= max(abs(late), VAGUE_STEPS * step) else math.nan)


def noise_power(values: Array) -> float:
    """Return the power of white noise with the third differences of `values`, shape (n,).

    Its unit is that of `values`, squared.
    """
    return float(np.mean(np.diff(values, 3) ** 2)) / 20.0


class _Pair(NamedTuple):
    """Estimate and truth at the same times, shape (n,); `hole`, shape (n - 1,): a gap follows.

    step : usual sample time [s].
    """

    time: Array
    estimate: Array
    truth: Array
    hole: NDArray[np.bool_]
    step: float

    def inside(self, *ways: float) -> NDArray[np.bool_]:
        """Return which times are in the record, and in no hole, after each of the ways [s]."""
        found = np.ones(len(self.time), bool)
        for way in ways:
            moved = self.time + way
            before = np.searchsorted(self.time, moved, side='right') - 1
            found &= (moved >= 0.0) & (moved <= self.time[-1])
            found &= ~self.hole[np.clip(before, 0, len(self.hole) - 1)]
        return found


def _coarse(pair: _Pair, most: int) -> Array:
    """Return the mean square error at shifts of -most to most steps; inf for too few samples."""
    grid = np.arange(0.0, pair.time[-1] + 0.5 * pair.step, pair.step)
    e, r = (np.interp(grid, pair.time, each) for each in (pair.estimate, pair.truth))
    size = 1 << (len(grid) + most).bit_length()

    def spectrum(values: Array) -> NDArray[np.complex128]:
        return np.fft.rfft(values, size)

    ones = spectrum(np.ones(len(grid)))
    squares = np.fft.irfft(
        spectrum(e * e) * ones.conj()
        - 2.0 * spectrum(e) * spectrum(r).conj()
        + ones * spectrum(r * r).conj(),
        size,
    )
    shifts = np.arange(-most, most + 1)
    count = len(grid) - np.abs(shifts)
    return np.where(count > 0.5 * len(grid), squares[shifts] / np.maximum(count, 1), np.inf)


def _nearest_minimum(errors: Array, clear: float, scale: float) -> tuple[int, int]:
    """Return (shift in steps, steps to the sides where the error has risen; 0: no result)."""
    most = len(errors) // 2
    usable = np.isfinite(errors)
    low, high = float(np.min(errors[usable])), float(np.max(errors[usable]))
    if high - low <= clear * max(low, 0.0) + 1e-12 * scale:
        return 0, 0
    good = errors <= low + NEAR_LEAST * (high - low)
    away = np.abs(np.arange(len(errors)) - most)
    centre = int(np.argmin(np.where(good, away, len(errors))))
    worse = np.flatnonzero(~good)
    first = int(np.max(worse[worse < centre], initial=-1)) + 1
    last = int(np.min(worse[worse > centre], initial=len(errors))) - 1
    best = first + int(np.argmin(errors[first : last + 1]))
    if best in (0, len(errors) - 1):
        return 0, 0  # the minimum is outside the search
    side = np.arange(1, min(best, len(errors) - 1 - best) + 1)
    risen = np.minimum(errors[best - side], errors[best + side]) >= low + RISE_PART * (high - low)
    return best - most, int(side[np.argmax(risen) if risen.any() else -1])


def _middle(pair: _Pair, shift: float, side: float) -> Delay:
    """Return the shift whose two sides, `side` away, have equal errors.

    Its interval is nan if no shift within two samples has that property.
    """
    low, high = shift - 2.0 * pair.step, shift + 2.0 * pair.step
    inside = pair.inside(low - side, high + side, -side, side)
    if np.count_nonzero(inside) < 4:
        return UNKNOWN_DELAY
    at, wanted = pair.time[inside], pair.truth[inside]

    def difference(signal: Array, slope: Array, where: float) -> float:
        right = cubic(pair.time, signal, at + where + side, slope) - wanted
        left = cubic(pair.time, signal, at + where - side, slope) - wanted
        return float(np.mean(right * right) - np.mean(left * left))

    own = difference(pair.truth, slopes(pair.time, pair.truth), 0.0)
    of_estimate = slopes(pair.time, pair.estimate)

    def rise(where: float) -> float:
        return difference(pair.estimate, of_estimate, where) - own

    below, above = rise(low), rise(high)
    if below > 0.0 or above < 0.0:
        return Delay(shift, math.nan)
    # Between them it is nearly a straight line: regula falsi, in the Illinois variant, which halves
    # the value of an end that stays (Dahlquist and Bjorck, Numerical Methods, section 6.2.2)
    kept, at_zero = 0, 0.5 * (low + high)
    for _ in range(40):
        previous, at_zero = at_zero, (low * above - high * below) / (above - below or 1.0)
        value = rise(at_zero)
        if value < 0.0:
            low, below, above, kept = at_zero, value, above * (0.5 if kept < 0 else 1.0), -1
        else:
            high, above, below, kept = at_zero, value, below * (0.5 if kept > 0 else 1.0), 1
        if abs(at_zero - previous) < DELAY_TOLERANCE or high - low < DELAY_TOLERANCE:
            break
    return Delay(at_zero, _half(pair, at_zero, side))


def _half(pair: _Pair, late: float, side: float) -> float:
    """Return half of the delay's interval [s]; nan if a delay outside of it fits far better."""
    inside = pair.inside(-late - side, -late, side - late)
    if np.count_nonzero(inside) < 8:
        return math.nan
    at, estimate = pair.time[inside] - late, pair.estimate[inside]
    slope = slopes(pair.time, pair.truth)

    def behind(shift: float) -> Array:
        return cubic(pair.time, pair.truth, at - shift, slope)

    rise, rest = (behind(-side) - behind(side)) / (2.0 * side), estimate - behind(0.0)
    block = pairs.blocks(at)
    sums = np.bincount(block, (rest - np.mean(rest)) * rise)
    half = pairs.of_sums([sums], [np.bincount(block, rise * rise)]).half
    most = float(np.mean(rest * rest)) - NEAR_LEAST * float(np.var(pair.truth))
    for shift in (-1.0, 1.0):
        other = estimate - behind(shift * max(2.0 * half, pair.step))
        if not float(np.mean(other * other)) >= most:
            return math.nan
    return half
