# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Cut a record of positions at its gaps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.matching import pieces
from estimator_pkg.evaluation.reference.smoother.steps import SmootherState

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

HOLE_SECONDS = 0.2  # a longer gap [s] cuts the record, or, if that is longer, one of
HOLE_STEPS = 10.0  # this many median sample times
FEWEST_IN_PIECE = 12  # pieces with fewer readings are ignored
START_VARIANCE = 100.0  # variances at the start of a piece are this multiple of the usual ones
USUAL_SPEED = 0.9  # the usual speed of a piece is above this fraction of all its speeds
SPEED_STEPS = 10.0  # an acceleration changes the usual speed by as much in this many sample times


class Piece(NamedTuple):
    """Consecutive readings without a gap.

    rows : shape (n,), indices in the record. steps : shape (n,), since the previous reading [s];
    the first is 0. readings : shape (n,) [rad]; nan: none.
    """

    rows: NDArray[np.int64]
    steps: Array
    readings: Array

    @property
    def step(self) -> float:
        """Median sample time [s]."""
        return float(np.median(self.steps[1:]))

    @property
    def speed(self) -> float:
        """Usual speed from one reading to the next [rad/s]."""
        known = np.isfinite(self.readings)
        time = np.cumsum(self.steps)[known]
        speeds = np.abs(np.diff(self.readings[known]) / np.diff(time))
        return float(np.quantile(speeds, USUAL_SPEED)) if len(speeds) else 0.0

    def part(self, first: int, count: int) -> Piece:
        """Return at most `count` readings from the `first` on."""
        which = slice(first, first + count)
        steps = self.steps[which].copy()
        steps[:1] = 0.0
        return Piece(self.rows[which], steps, self.readings[which])


def cut(stamps: Stamps, position: Array) -> list[Piece]:
    """Return the pieces between gaps and clock jumps of positions [rad or m], shape (n,)."""
    found = []
    for run in pieces(stamps):
        steps = np.diff(stamps[run]) * 1e-9
        if not len(steps):
            continue
        longest = max(HOLE_SECONDS, HOLE_STEPS * float(np.median(steps)))
        for rows in np.split(run, np.flatnonzero(steps > longest) + 1):
            if len(rows) >= FEWEST_IN_PIECE:
                between = np.diff(stamps[rows], prepend=stamps[rows[0]]) * 1e-9
                found.append(Piece(rows, between, position[rows]))
    return found


def stretches(parts: list[Piece], length: int, most: int) -> list[Piece]:
    """Return all parts, or `most` stretches of `length` readings, evenly over the record."""
    found = [
        part.part(at, length)
        for part in parts
        for at in range(0, max(1, len(part.rows) - FEWEST_IN_PIECE), length)
    ]
    found = [part for part in found if np.isfinite(part.readings[0])]
    if len(found) <= most:
        return found
    return [found[round(at)] for at in np.linspace(0, len(found) - 1, most)]


def start(reading: float, variance: float, speed: float, step: float) -> SmootherState:
    """Return the state before a piece: near its first reading, speed and acceleration unknown.

    Its variances are in proportion to the readings, so their unit does not matter. Larger ones
    would cost digits, because the first corrections subtract numbers of that size.

    Parameters
    ----------
    variance : of a reading. speed, step : of the piece, see `Piece`.
    """
    fast = START_VARIANCE * (speed**2 + variance / step**2)
    change = fast / (SPEED_STEPS * step) ** 2
    x = SmootherState()
    x.q, x.p00, x.p11, x.p22 = float(reading), START_VARIANCE * variance, fast, change
    return x
