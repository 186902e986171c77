# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Cut a record of positions at its gaps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.compare.matching import pieces

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

HOLE = 0.2  # a longer gap [s] cuts the record, or, if that is longer, one of
HOLE_STEPS = 10.0  # this many median sample times
FEWEST = 12  # pieces with fewer readings are ignored
LOOSE = 1e6  # variance of speed and acceleration at the start of a piece


class Piece(NamedTuple):
    """Consecutive readings without a gap.

    rows : shape (n,), indices in the record. steps : shape (n,), since the previous reading [s];
    the first is 0. readings : shape (n,) [rad]; nan: none.
    """

    rows: NDArray[np.int64]
    steps: Array
    readings: Array

    def part(self, first: int, count: int) -> Piece:
        """Return at most `count` readings from the `first` on."""
        which = slice(first, first + count)
        return Piece(self.rows[which], self.steps[which], self.readings[which])


def cut(stamps: Stamps, position: Array) -> list[Piece]:
    """Return the pieces between gaps and clock jumps of positions [rad or m], shape (n,)."""
    found = []
    for run in pieces(stamps):
        steps = np.diff(stamps[run]) * 1e-9
        if not len(steps):
            continue
        longest = max(HOLE, HOLE_STEPS * float(np.median(steps)))
        for rows in np.split(run, np.flatnonzero(steps > longest) + 1):
            if len(rows) >= FEWEST:
                between = np.diff(stamps[rows], prepend=stamps[rows[0]]) * 1e-9
                found.append(Piece(rows, between, position[rows]))
    return found


def stretches(parts: list[Piece], length: int, most: int) -> list[Piece]:
    """Return all parts, or `most` stretches of `length` readings, evenly over the record."""
    found = [
        part.part(at, length)
        for part in parts
        for at in range(0, max(1, len(part.rows) - FEWEST), length)
    ]
    found = [part for part in found if np.isfinite(part.readings[0])]
    if len(found) <= most:
        return found
    return [found[round(at)] for at in np.linspace(0, len(found) - 1, most)]


def start(reading: float, variance: float) -> tuple[float, ...]:
    """Return the state before a piece: at its first reading, speed and acceleration unknown."""
    return (float(reading), 0.0, 0.0, 100.0 * variance, 0.0, 0.0, LOOSE, 0.0, LOOSE)
