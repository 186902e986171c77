# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Which samples of a joint show its sensor's errors: in blocks, and only while it turns round.

See `sensor.map` for the equations. It costs about 0.3 us a sample then. Where nothing is proven in
`TRIED` turns the learner sleeps for many. What it does depends on the samples alone, so live equals
replay. Angles are in rad, times in s, stamps in ns; arrays of samples have shape (n,).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.sensor.guard import DUPLICATE, USED
from estimator_pkg.sensor.marks import NOTHING, Shaft
from estimator_pkg.sensor.table import COARSE, Array

LOOK = 128  # samples between two looks at a joint that does not turn
BLOCK, EDGES = 128, 256  # samples of a block; of a coarse sensor
DENSE, FAR = 128, 8  # samples of a turn that are enough for a fine sensor; largest stride
BLOCKS, PAUSE = 4, 16  # blocks until learning a settled map pauses, and for how many
TRIED, REST, LONGEST_REST = 12.0, 64.0, 1024.0  # turns: learnt from in vain; until the next try
IDLE = 30.0  # [s] without a whole turn: it turns no longer


class Learner:
    """Learns the errors of the sensor of one joint.

    Parameters
    ----------
    period : wrap period [rad]. quantum : as given [rad]; 0: not known.
    foresees : look for a ripple of the speed.

    Attributes
    ----------
    shaft : what the samples show. left : samples that are not needed now.
    applied : the joint takes maps out of its readings.
    """

    def __init__(self, period: float, quantum: float, foresees: bool) -> None:
        self._rest, self._pause = 0.0, REST  # turns until the next try, and after it
        self.applied = False
        self._sleep(Shaft(period, quantum, foresees))

    def _sleep(self, shaft: Shaft) -> None:
        """Wait until the joint turns round again, and go on with this shaft."""
        self.shaft = shaft
        self.awake, self.left = False, LOOK  # samples until the next look
        self._turned = self._looked = 0.0
        self._stamps: list[int] = []
        self._readings: list[float] = []
        self._paused = False  # the next sample is far from the last one
        self._stride, self._blocks = 1, 0  # every stride-th sample is used; blocks since a pause
        self._block = BLOCK
        self._base = 0  # what times are relative to [ns]

    def look(self, stamps: Sequence[int], velocities: Sequence[float]) -> int:
        """Look whether the joint turns round, at samples with `LOOK` others between them.

        Returns
        -------
        count : of the samples until it does, or of all.
        """
        looked, turned, rest = self._looked, self._turned, self._rest
        period = self.shaft.period
        count, self.left = 0, LOOK
        for stamp_ns, velocity in zip(stamps, velocities):
            now, count = 1e-9 * stamp_ns, count + 1
            known = looked > 0.0 and math.isfinite(velocity)
            step = velocity * (now - looked) if known else 0.0
            looked = now
            turned = step + turned if turned * step > 0.0 else step
            rest -= abs(step) / period
            if abs(turned) > period and rest <= 0.0:
                self.awake, self.left, self._base = True, 0, stamp_ns
                self._stamps, self._readings = [], []
                break
        self._looked, self._turned, self._rest = looked, turned, rest
        return count

    def note(self, stamp_ns: int, reading: float, verdict: int) -> bool:
        """Take a sample that was used; return True if what is taken out of the readings changes."""
        changed = False
        if self._readings and (self._paused or verdict != USED):
            before = self._readings[-1]
            changed = self.learn()
            self.shaft.passes_over(verdict, before, reading, 1e-9 * (stamp_ns - self._base))
            self._stamps, self._readings, self._paused = [], [], False
        self._stamps.append(stamp_ns)
        self._readings.append(reading)
        self.left = self._stride - 1
        return (len(self._stamps) > self._block and self.learn()) or changed

    def follow(
        self,
        stamps: NDArray[np.int64],
        readings: Array,
        verdicts: NDArray[np.int8],
        velocities: Array,
    ) -> int:
        """Take those samples that were used, as `look` and `note` do, until `note` is True.

        Returns
        -------
        count : of the samples up to then; 0: it never was.
        """
        used = verdicts < DUPLICATE
        if not used.all():
            kept = np.flatnonzero(used)
            count = self.follow(stamps[kept], readings[kept], verdicts[kept], velocities[kept])
            return int(kept[count - 1]) + 1 if count else 0
        at, count = 0, len(stamps)
        events = NOTHING
        while at < count:
            first = at + self.left
            if not self.awake:
                if first >= count:
                    self.left = first - count
                    break
                due = slice(first, count, LOOK + 1)
                looks = self.look(stamps[due].tolist(), velocities[due].tolist())
                at = first + 1 + (looks - 1) * (LOOK + 1)
                continue
            if not len(events):
                events = np.append(np.flatnonzero(verdicts != USED), count)
            event = int(events[np.searchsorted(events, at)])
            if self._paused and first < event:
                event = first
            rows = np.arange(first, event, self._stride)[: self._block + 1 - len(self._stamps)]
            if len(rows):
                self._stamps += stamps[rows].tolist()
                self._readings += readings[rows].tolist()
                at, self.left = int(rows[-1]) + 1, self._stride - 1
                changed = len(self._stamps) > self._block and self.learn()
            elif event >= count:
                self.left -= count - at
                break
            else:
                at = event + 1
                changed = self.note(
                    int(stamps[event]), float(readings[event]), int(verdicts[event])
                )
            if changed:
                return at
        return 0

    def learn(self) -> bool:
        """Learn from the samples; return True if what is taken out of the readings changes."""
        shaft, before = self.shaft, self.shaft.travelled
        times, readings = 1e-9 * (np.array(self._stamps) - self._base), np.array(self._readings)
        shaft.take(times, readings)
        # the newest sample is the first one of the next block
        self._stamps, self._readings = self._stamps[-1:], self._readings[-1:]
        self._block = EDGES if shaft.kind == COARSE else BLOCK
        if shaft.kind != COARSE:
            turns = max(shaft.travelled - before, 1e-3)
            self._stride = min(max(int(self._stride * len(times) / (turns * DENSE)), 1), FAR)
        self._blocks += 1
        if shaft.active or shaft.settled:
            shaft.travelled = 0.0
            if shaft.settled and self._blocks >= BLOCKS:
                self._blocks, self._paused, self.left = 0, True, PAUSE * self._block * self._stride
        elif shaft.travelled > TRIED:
            self._rest, self._pause = self._pause, min(2.0 * self._pause, LONGEST_REST)
            self._sleep(shaft.forgotten())
        elif times[-1] - shaft.since > IDLE:
            self._sleep(shaft.forgotten())
        return self.shaft.active or self.applied

    @property
    def room(self) -> int:
        """Samples until a block is complete, at least."""
        return self.left + 1 + (self._block - len(self._stamps)) * self._stride
