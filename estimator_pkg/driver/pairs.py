# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Pair currents and voltages from two topics by their stamps."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from estimator_pkg.observers.maths.clarke import clarke
from estimator_pkg.observers.pmsm.drive import LARGEST_VECTOR

MOST_UNPAIRED = 100  # largest number of messages of each kind that wait for their partner
CURRENT, VOLTAGE = 0, 1
FORGETS = 0.999  # decay of the recent largest current, per sample
LEAST_CURRENT = 1e-9  # smallest value of the recent largest current [A]

AlphaBeta = tuple[float, float]


class PairedSample(NamedTuple):
    """A sample: current and voltage (alpha, beta) at the stamp of the current."""

    stamp_ns: int
    sample: tuple[float, float, float, float]


class Pairs:
    """Pairs the messages of two topics.

    Parameters
    ----------
    tolerance_ns : largest difference of the stamps of a pair.

    Attributes
    ----------
    unpaired : number of messages without a partner.
    nearest_ns : smallest difference of unpaired stamps since the last pair; None if there was
        nothing to compare.
    """

    def __init__(self, tolerance_ns: int) -> None:
        self._tolerance = tolerance_ns
        self._waiting: tuple[deque, deque] = (deque(), deque())
        self.paired = 0
        self.unpaired = 0
        self.nearest_ns: int | None = None

    def put(self, kind: int, stamp_ns: int, vector: AlphaBeta) -> list[PairedSample]:
        """Take a message of `kind`; return the completed pairs, usually one at most."""
        queue = self._waiting[kind]
        while queue and queue[-1][0] > stamp_ns:  # of a clock that jumped
            queue.pop()
            self.unpaired += 1
        queue.append((stamp_ns, vector))
        if len(queue) > MOST_UNPAIRED:
            queue.popleft()
            self.unpaired += 1
        return self._matches()

    def _matches(self) -> list[PairedSample]:
        currents, voltages = self._waiting
        found = []
        while currents and voltages:
            difference = currents[0][0] - voltages[0][0]
            if abs(difference) <= self._tolerance:
                stamp_ns, current = currents.popleft()
                voltage = voltages.popleft()[1]
                found.append(PairedSample(stamp_ns, (*current, *voltage)))
                self.paired += 1
                self.nearest_ns = None
                continue
            if self.nearest_ns is None or abs(difference) < self.nearest_ns:
                self.nearest_ns = abs(difference)
            (voltages if difference > 0 else currents).popleft()
            self.unpaired += 1
        return found


class Phases:
    """Converts three phase quantities to a vector; currents without a neutral must sum to zero.

    Parameters
    ----------
    tolerance : of the sum, over the recent largest phase current.

    Attributes
    ----------
    unbalanced : number of unused currents, whose sum was too large.
    worst : the largest such ratio.
    """

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self._largest = LEAST_CURRENT
        self.unbalanced = 0
        self.worst = 0.0

    def current(self, a: float, b: float, c: float) -> AlphaBeta | None:
        """Return (alpha, beta) [A]; None if the phases do not sum to zero."""
        largest = max(abs(a), abs(b), abs(c))
        if not largest < LARGEST_VECTOR:  # no current: the guard drops it
            return math.nan, math.nan
        self._largest = max(largest, FORGETS * self._largest)
        imbalance = abs(a + b + c) / self._largest
        if imbalance > self._tolerance:
            self.unbalanced += 1
            self.worst = max(self.worst, imbalance)
            return None
        return clarke(a, b, c)

    @staticmethod
    def voltage(a: float, b: float, c: float) -> AlphaBeta:
        """Return (alpha, beta) [V]; the zero-sequence component drives no current and cancels."""
        return clarke(a, b, c)
