"""Currents and voltages that come apart, paired by their stamps."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from estimator_pkg.models.motor import clarke

WAITING = 100  # of each kind at most wait for their partner
JUMP = 100_000_000  # stamps that go back by more begin anew [ns]
CURRENT, VOLTAGE = 0, 1
FORGETS = 0.999  # the largest current of late, per sample
LEAST = 1e-9  # A

Vector = tuple[float, float]


class Pair(NamedTuple):
    """A sample: current and voltage (alpha, beta) at the stamp of the current."""

    stamp_ns: int
    sample: tuple[float, float, float, float]


class Pairs:
    """Pairs what comes on two topics.

    Parameters
    ----------
    tolerance_ns : stamps of a pair differ by at most this.

    Attributes
    ----------
    unpaired : messages that never met their partner.
    apart_ns : how far the stamps nearest to each other were apart, since the last pair; None where
        nothing could be compared.
    """

    def __init__(self, tolerance_ns: int) -> None:
        self._tolerance = tolerance_ns
        self._waiting: tuple[deque, deque] = (deque(), deque())
        self.paired = 0
        self.unpaired = 0
        self.apart_ns: int | None = None

    def put(self, kind: int, stamp_ns: int, vector: Vector) -> list[Pair]:
        """A message of `kind` in; the pairs that are complete, at most one beyond a jump."""
        queue = self._waiting[kind]
        if queue and stamp_ns < queue[-1][0] - JUMP:
            for each in self._waiting:
                self.unpaired += len(each)
                each.clear()
        queue.append((stamp_ns, vector))
        if len(queue) > WAITING:
            queue.popleft()
            self.unpaired += 1
        return self._matches()

    def _matches(self) -> list[Pair]:
        currents, voltages = self._waiting
        found = []
        while currents and voltages:
            apart = currents[0][0] - voltages[0][0]
            if abs(apart) <= self._tolerance:
                stamp_ns, current = currents.popleft()
                voltage = voltages.popleft()[1]
                found.append(Pair(stamp_ns, (*current, *voltage)))
                self.paired += 1
                self.apart_ns = None
                continue
            if self.apart_ns is None or abs(apart) < self.apart_ns:
                self.apart_ns = abs(apart)
            (voltages if apart > 0 else currents).popleft()
            self.unpaired += 1
        return found


class Phases:
    """Three phase quantities as a vector; currents without a neutral must sum to zero.

    Parameters
    ----------
    tolerance : of the sum, relative to the largest phase current of late.

    Attributes
    ----------
    unbalanced : currents whose sum was too large; they are not used.
    worst : the largest such sum over that current.
    """

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self._largest = LEAST
        self.unbalanced = 0
        self.worst = 0.0

    def current(self, a: float, b: float, c: float) -> Vector | None:
        """(alpha, beta) [A]; None where the phases do not sum to zero."""
        largest = max(abs(a), abs(b), abs(c))
        self._largest = max(largest, FORGETS * self._largest)
        off = abs(a + b + c) / self._largest
        if off > self._tolerance:  # false for nan, which the guard finds
            self.unbalanced += 1
            self.worst = max(self.worst, off)
            return None
        return clarke(a, b, c)

    @staticmethod
    def voltage(a: float, b: float, c: float) -> Vector:
        """(alpha, beta) [V]; what all three have in common drives no current and drops out."""
        return clarke(a, b, c)
