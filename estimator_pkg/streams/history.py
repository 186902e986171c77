# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The time of a joint in each status."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import STATUS_NAMES
from estimator_pkg.sensor.guard import (
    AFTER_CLOCK_JUMP,
    AFTER_GAP,
    AFTER_OUTAGE,
    AFTER_STRAY_STAMP,
    DUPLICATE,
)

GAP = 'gap'  # time without samples, listed with the statuses
CHUNK = 4096  # number of single samples that are counted together


@dataclass
class History:
    """Time of one joint by status [s], from its samples in order of arrival."""

    _seconds: dict[str, float] = field(default_factory=dict)
    _last_ns: int | None = None  # stamp of the last used sample
    _last_gap: float = 0.0  # length of the gap before the last used sample [s]; 0: none
    _used: int = 0
    _single: list[tuple[int, int, int]] = field(default_factory=list)
    _noted: list[tuple[NDArray[np.int64], NDArray[np.int8]]] = field(default_factory=list)

    def note(self, joint: Joint) -> None:
        """Count the joint's newest sample, once, if it was used."""
        if joint.used == self._used:
            return
        self._used = joint.used
        self._single.append((joint.stamp_ns, joint.estimate()[3], joint.verdict))
        if len(self._single) >= CHUNK:
            self._flush()

    def seconds(self) -> dict[str, float]:
        """Return the seconds by status."""
        self._flush()
        return self._seconds

    def _flush(self) -> None:
        if self._single:
            stamps, status, verdict = zip(*self._single)
            self._single.clear()
            columns = np.array(stamps), np.array(status, np.int8)
            self._noted.append(columns)
            self.add(*columns, np.array(verdict, np.int8))

    def noted(self) -> tuple[NDArray[np.int64], NDArray[np.int8]]:
        """Return stamps [ns] and statuses of the samples noted one by one, each of shape (n,)."""
        self._flush()
        if not self._noted:
            return np.zeros(0, np.int64), np.zeros(0, np.int8)
        stamps, status = zip(*self._noted)
        return np.concatenate(stamps), np.concatenate(status)

    def add(
        self, stamps_ns: NDArray[np.int64], status: NDArray[np.int8], verdict: NDArray[np.int8]
    ) -> None:
        """Count samples: stamps [ns], statuses after them and verdicts, each of shape (n,)."""
        used = verdict < DUPLICATE
        if not used.any():
            return
        times, status, verdict = stamps_ns[used], status[used], verdict[used]
        first = times[0] if self._last_ns is None else self._last_ns
        passed = np.diff(times, prepend=first) * 1e-9
        for row in np.flatnonzero(verdict == AFTER_STRAY_STAMP).tolist():
            self._take_back(passed, row)
        passed[(verdict == AFTER_CLOCK_JUMP) | (passed < 0.0)] = 0.0
        gap = (verdict == AFTER_GAP) | (verdict == AFTER_OUTAGE)
        self._last_gap = float(passed[-1]) if gap[-1] else 0.0
        for kind in np.unique(status).tolist():
            self._count(STATUS_NAMES[kind], passed[(status == kind) & ~gap])
        self._count(GAP, passed[gap])
        self._last_ns = int(times[-1])

    def _take_back(self, passed: NDArray[np.float64], row: int) -> None:
        """Subtract the gap before a stray stamp: its sample continues from before it."""
        before = passed[row - 1] if row else self._last_gap
        passed[row] += before
        if row:
            passed[row - 1] = 0.0
        else:
            self._count(GAP, np.array([-before]))

    def _count(self, name: str, seconds: NDArray[np.float64]) -> None:
        if len(seconds):
            self._seconds[name] = self._seconds.get(name, 0.0) + float(seconds.sum())
