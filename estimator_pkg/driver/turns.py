# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Whether a sensor counts turns, so that no change of its reading need be wrapped.

`wrap_period` is the angle after which a reading may repeat. On a circle, a change beyond half a
turn in one sample is ambiguous, and one beyond an eighth is doubtful. The readings of a sensor that
wraps never span more than a turn. If they do, the sensor counts turns, and the joint goes on
without a circle. If its counter begins anew (the reading jumps by whole turns), with one again.

Angles are in rad, stamps in ns. Only the samples decide, and those that are dropped count, too: so
blocks of samples give what single ones give.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.observers.circle import LARGEST, is_angle, wrap

SPAN = 1.25  # turns that readings which wrap never span, noise included
CONFIRMED = 8  # readings in a row beyond it: no outliers
NEAR = 0.125  # of a turn, from whole turns: a jump by so much is none of the shaft


class Turns(NamedTuple):
    """What the readings have shown so far.

    low, high : lowest and highest reading. beyond : newest readings in a row that would make the
    span too large. counts : the sensor counts turns. wraps : it does not, and never will.
    stamp_ns, reading, rate : newest sample and how fast it came [rad/ns], where it counts turns.
    """

    period: float
    low: float = math.inf
    high: float = -math.inf
    beyond: int = 0
    counts: bool = False
    wraps: bool = False
    stamp_ns: int = 0
    reading: float = math.nan
    rate: float = math.nan

    @property
    def usual(self) -> tuple[float, float]:
        """Lowest and highest reading with which `after` changes nothing; nan: there is none."""
        if self.wraps:
            return -math.inf, math.inf
        return (math.nan, math.nan) if self.counts or self.beyond else (self.low, self.high)

    def after(self, stamp_ns: int, reading: float) -> Turns:
        """Return what is known with one more sample, which its observer has not taken yet."""
        if self.wraps or not is_angle(reading):  # the guard drops it
            return self
        if self.counts:
            return self._counted(stamp_ns, reading)
        low, high = min(self.low, reading), max(self.high, reading)
        if high - low <= SPAN * self.period:
            return self._replace(low=low, high=high, beyond=0)
        counts = self.beyond + 1 == CONFIRMED
        return self._replace(
            beyond=self.beyond + 1, counts=counts, stamp_ns=stamp_ns, reading=reading
        )

    def _counted(self, stamp_ns: int, reading: float) -> Turns:
        passed, moved = stamp_ns - self.stamp_ns, reading - self.reading
        if passed <= 0:
            return self._replace(stamp_ns=stamp_ns, reading=reading, rate=math.nan)
        off, half = moved - self.rate * passed, 0.5 * self.period  # from where it was going
        if min(abs(off), abs(moved)) > half and abs(wrap(off, self.period)) < NEAR * self.period:
            return Turns(self.period, wraps=True)
        return self._replace(stamp_ns=stamp_ns, reading=reading, rate=moved / passed)

    def after_all(
        self, stamps: NDArray[np.int64], readings: NDArray[np.float64]
    ) -> tuple[Turns, int, Turns]:
        """Return what is known after samples of a block, their number, and what the next one shows.

        Parameters
        ----------
        stamps, readings : shape (n,), the block; all are taken but where `counts` changes next.
        """
        now, at, count = self, 0, len(readings)
        while at < count and not now.wraps:
            if now.counts:
                now, at = now._moving(stamps, readings, at)
            elif now.beyond == 0:
                now, at = now._within(readings, at)
            if at == count:
                break
            later = now.after(int(stamps[at]), float(readings[at]))
            if later.counts != now.counts:
                return now, at, later
            now, at = later, at + 1
        return now, count, now

    def _within(self, readings: NDArray[np.float64], at: int) -> tuple[Turns, int]:
        """Return what is known from row `at` on, to that with which the span is too large."""
        rest, row = readings[at:], len(readings)
        low, high = float(np.min(rest)), float(np.max(rest))
        if not (is_angle(low) and is_angle(high)):
            rest = np.where(np.abs(rest) < LARGEST, rest, math.nan)
            low, high = float(np.fmin.reduce(rest)), float(np.fmax.reduce(rest))
        low, high = min(self.low, low), max(self.high, high)
        if high - low > SPAN * self.period:
            lows = np.fmin(np.fmin.accumulate(rest), self.low)
            highs = np.fmax(np.fmax.accumulate(rest), self.high)
            first = int(np.argmax(highs - lows > SPAN * self.period))
            if first == 0:
                return self, at
            low, high, row = float(lows[first - 1]), float(highs[first - 1]), at + first
        return self._replace(low=low, high=high), row

    def _moving(
        self, stamps: NDArray[np.int64], readings: NDArray[np.float64], at: int
    ) -> tuple[Turns, int]:
        """Return the same, to the row of a jump by whole turns."""
        rest, half = readings[at:], 0.5 * self.period
        if abs(rest[0] - self.reading) < half and np.abs(np.diff(rest)).max(initial=0.0) < half:
            now = self  # no jump: only the last two samples count
            if len(rest) > 1:
                now = now._replace(stamp_ns=int(stamps[-2]), reading=float(rest[-2]), rate=math.nan)
            return now._counted(int(stamps[-1]), float(rest[-1])), len(readings)
        rows = at + np.flatnonzero(np.abs(rest) < LARGEST)
        times = np.append(self.stamp_ns, stamps[rows])
        angles = np.append(self.reading, readings[rows])
        passed, moved = np.diff(times), np.diff(angles)
        rates = np.divide(moved, passed, out=np.full(len(rows), math.nan), where=passed > 0)
        rates = np.append(self.rate, rates)
        off = np.where(passed > 0, moved - rates[:-1] * passed, 0.0)
        near = off - self.period * np.floor(off / self.period + 0.5)
        least = np.minimum(np.abs(off), np.abs(moved))
        jumps = (least > 0.5 * self.period) & (np.abs(near) < NEAR * self.period)
        last = int(np.argmax(jumps)) if jumps.any() else len(rows)
        now = self._replace(
            stamp_ns=int(times[last]), reading=float(angles[last]), rate=float(rates[last])
        )
        return now, int(rows[last]) if last < len(rows) else len(readings)
