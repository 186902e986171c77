# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Join what comes in several messages by stamp: joints, wheels, current and voltage."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any

from estimator_pkg.observers.maths.clarke import clarke
from estimator_pkg.observers.pmsm.drive import LARGEST_VECTOR

MOST_WAITING = 100  # largest number of samples that wait for their other parts
CURRENT, VOLTAGE = 0, 1
FORGETS = 0.999  # decay of the recent largest current, per sample
LEAST_CURRENT = 1e-9  # smallest value of the recent largest current [A]

AlphaBeta = tuple[float, float]


class Partial:
    """A sample whose parts come in several messages.

    Attributes
    ----------
    stamp_ns : the newest stamp of its parts. parts : their values.
    """

    def __init__(self, stamp_ns: int = 0) -> None:
        self.stamp_ns = stamp_ns
        self.parts: dict[int, Any] = {}


class Pairing:
    """Joins the parts of samples whose stamps differ by at most a tolerance.

    Parameters
    ----------
    count : number of parts of a sample.
    tolerance_ns : largest difference of the stamps of a sample; inf: the newest value of every part
        counts, whatever its stamp.

    Attributes
    ----------
    waiting : incomplete samples, in order of arrival.
    paired, unpaired : number of complete samples, and of those that never got all their parts.
    nearest_ns : smallest difference of stamps that did not join, since the last complete sample;
        None if there was nothing to compare.
    """

    def __init__(self, count: int, tolerance_ns: float = math.inf) -> None:
        self._count, self.tolerance_ns = count, tolerance_ns
        self.waiting: deque[Partial] = deque()
        self.paired = self.unpaired = 0
        self.nearest_ns: int | None = None

    def put(self, stamp_ns: int, parts: Mapping[int, Any]) -> Partial | None:
        """Take a message with these parts; return the sample that it completes."""
        found = self._partner(stamp_ns, parts)
        found.stamp_ns = max(found.stamp_ns, stamp_ns)
        found.parts.update(parts)
        if len(found.parts) < self._count:
            return None
        while self.waiting.popleft() is not found:
            self.unpaired += 1
        self.paired += 1
        self.nearest_ns = None
        return found

    def _partner(self, stamp_ns: int, parts: Mapping[int, Any]) -> Partial:
        """Return the waiting sample that the parts join, a new one if there is none."""
        for waiting in self.waiting:
            if math.isinf(self.tolerance_ns):
                return waiting
            if waiting.parts.keys().isdisjoint(parts):
                apart_ns = abs(waiting.stamp_ns - stamp_ns)
                if apart_ns <= self.tolerance_ns:
                    return waiting
                self.nearest_ns = min(apart_ns, self.nearest_ns or apart_ns)
        self.waiting.append(Partial(stamp_ns))
        if len(self.waiting) > MOST_WAITING:
            self.waiting.popleft()
            self.unpaired += 1
        return self.waiting[-1]


class CurrentsAndVoltages(Pairing):
    """Pairs the messages of the topics of currents and voltages."""

    def __init__(self, tolerance_ns: int) -> None:
        super().__init__(2, tolerance_ns)

    def take(
        self, kind: int, stamp_ns: int, vector: AlphaBeta
    ) -> tuple[int, tuple[float, ...]] | None:
        """Take a CURRENT or a VOLTAGE.

        Returns (stamp of the current [ns], (i alpha, i beta, u alpha, u beta)) of the pair that it
        completes, or None.
        """
        found = self.put(stamp_ns, {kind: (stamp_ns, vector)})
        if found is None:
            return None
        (stamp_ns, current), (_, voltage) = found.parts[CURRENT], found.parts[VOLTAGE]
        return stamp_ns, (*current, *voltage)


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
