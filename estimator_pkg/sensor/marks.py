# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The marks of a turn: when a shaft passed them, and what that shows of its sensor's errors.

See `sensor.map` for the equations. Angles are in rad, times in s; arrays of samples have shape
(n,).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.sensor.guard import AFTER_GAP, AFTER_STRAY_STAMP, USED
from estimator_pkg.sensor.ripple import SPAN, found, slower
from estimator_pkg.sensor.table import (
    BACKWARD,
    COARSE,
    FASTER,
    FINE,
    FORWARD,
    KEPT,
    LOOSE,
    UNKNOWN,
    USUAL,
    Array,
    Maps,
    Table,
    grid,
)

Errors = Callable[[Array, Array], Array]

NEWEST = 128  # samples that show the quantum, of a block
RESIDUE = 1e-9  # [rad] a smaller step is none
RING = 288  # times that are kept, at least two turns and a half
SLOWER = 0.7  # of the highest speed: a slower turn is not learnt from
STEADY = 0.1  # of a turn's time: its halves take the same time but for this
LOCAL = 12  # marks around one, over which a search takes the speed to be constant
SEARCHED = 2  # turns after which a period is found, once one has passed
ALIKE, STRIKING = 1.5, 0.7  # of mean squares: as small as the smallest; a smallest that is small
SMALLEST = 0.25  # of its usual time: a ripple makes no cell shorter
# of the angle within a sample: a smaller error cannot be attributed to the sensor. Edges are times,
# and have to be known better than by a sample before a filter may trust them more
RESOLVED, RESOLVED_EDGES = 0.5, 1.0
NOTHING = np.zeros(0)


class Shaft:
    """A shaft that passes the marks of its sensor, and the errors and ripple that it shows.

    Parameters
    ----------
    period : wrap period [rad]. quantum : as given [rad]; 0: not known.
    foresees : look for a ripple of the speed.
    moves : a faster turn has shown a motion that repeats each turn.

    Attributes
    ----------
    at : where it is [marks]. reading : the newest one. heading : 1 or -1; 0: not known.
    travelled : turns since something was proven.
    since : time of the newest turn that was learnt [s].
    """

    def __init__(self, period: float, quantum: float, foresees: bool, moves: bool = False) -> None:
        self.period, self.given, self.foresees, self.moves = period, quantum, foresees, moves
        self.quantum = quantum if quantum > 0.0 else math.inf
        self.bottom, self.top = -math.inf, math.inf  # interval of readings that wrap
        self.reading = 0.0
        self._begin(UNKNOWN, USUAL)

    def forgotten(self) -> Shaft:
        """Return the same shaft, of which only is known whether its motion repeats each turn."""
        return Shaft(self.period, self.given, self.foresees, self.moves)

    def _begin(self, kind: int, turn: int) -> None:
        """Begin with other marks. Those of counts lie between two readings."""
        self.kind, self.turn, self.size = kind, turn, self.period / turn
        self.at = 0.5 if kind in (UNKNOWN, LOOSE) else 0.5 * self.quantum / self.size  # [cells]
        self.marks = turn if kind in (FINE, LOOSE) else 0  # after which errors repeat; 0: not known
        self._make_tables()
        self.unit = self.speed = self.open = 0.0  # [marks/s], and what a sample leaves open [rad]
        self.lag, self.share = 0, 0.0  # of a ripple: its period [marks], and how much is foreseen
        self.foreseen = 0  # period of the last ripple
        self.squares, self.count = np.zeros(turn + 1), 0
        self.travelled = self.since = 0.0
        self.heading = 0
        self._interrupt()

    def _make_tables(self) -> None:
        fine = self.kind in (FINE, LOOSE)
        self.tables = [Table(self.marks, fine, self.moves) for _ in (FORWARD, BACKWARD)]

    def _interrupt(self) -> None:
        self.times, self.cells, self.pairs = NOTHING, NOTHING, NOTHING
        self.share = 0.0

    @property
    def active(self) -> bool:
        """True if something is to be taken out of the readings."""
        return self.share > 0.0 or any(table.in_use for table in self.tables)

    @property
    def settled(self) -> bool:
        """True if more turns of this speed change little: the map is proven, or not believed."""
        table = self.tables[0]
        return (table.sure and table.good > KEPT) or table.withheld

    def passes_over(self, verdict: int, before: float, reading: float, now: float) -> None:
        """Pass over samples that were not seen; after a new start the map is proven again.

        Parameters
        ----------
        verdict : the guard's, on the sample after them. before, reading : around them [rad].
        now : time of that sample [s].
        """
        step = reading - before
        self._interrupt()
        self.heading = 0
        self.at += (step - self.period * round(step / self.period)) / self.size
        if verdict not in (USED, AFTER_GAP, AFTER_STRAY_STAMP):
            self.foreseen = 0
            for table in self.tables:
                table.in_use, table.good = False, table.required - 1
            if self.marks and self.turn % self.marks:  # turns may be lost, and count
                self._begin(self.kind, self.turn)
        self.reading, self.since = reading, now

    def take(self, times: Array, readings: Array) -> None:
        """Take samples in a row, of which the first one was where the shaft is known to be."""
        self.reading = float(readings[-1])
        steps = readings[1:] - readings[:-1]
        if not len(steps):
            return
        turns = np.rint(steps / self.period)
        steps -= self.period * turns
        if self.top == math.inf and turns.any():
            least = float(readings.min())
            for bottom in (-0.5 * self.period, 0.0):
                if abs(least - bottom) < 0.1 * self.period:
                    self.bottom, self.top = bottom, bottom + self.period
        self._refine(steps[-NEWEST:])
        if self.kind != UNKNOWN:
            moved = self.at + np.append(0.0, np.cumsum(steps)) / self.size
            self.at = float(moved[-1])
            self._marks(times, moved)

    def _refine(self, steps: Array) -> None:
        """Begin with other marks if the steps show that these do not fit the quantum."""
        if self.kind != LOOSE:
            moved = np.abs(steps)
            moved = moved[moved > RESIDUE]
            steps = np.concatenate((moved, np.abs(moved[1:] - moved[:-1]), (self.quantum,)))
            self.quantum = float(steps[steps > RESIDUE].min())
        kind, turn = grid(self.period, self.given if self.given > 0.0 else self.quantum)
        if (kind, turn) != (self.kind, self.turn):
            self._begin(kind, turn)

    def _marks(self, times: Array, moved: Array) -> None:
        """Take the marks that the shaft passed on a way, in cells."""
        net = float(moved[-1] - moved[0])
        slack = 0.5 if self.kind == COARSE else 1.0  # noise may cross a mark
        heading = self.heading if abs(net) < slack and self.heading else int(np.sign(net))
        if heading == 0:
            return
        along = heading * moved
        highest = np.maximum.accumulate(along)
        broken = highest - along > slack
        broken[1:] |= along[1:] - along[:-1] >= 0.25 * self.turn  # no motion between two readings
        if heading != self.heading or broken.any():
            if heading != self.heading and self.kind == COARSE:
                table, other = (0, 1) if heading > 0 else (1, 0)
                if not self.tables[table].learnt and self.tables[other].in_use:
                    self.tables[table] = self.tables[other].copied()
            self.heading = heading
            self._interrupt()
            first = int(np.flatnonzero(broken)[-1]) if broken.any() else 0
            times, along = times[first:], along[first:]
            highest = np.maximum.accumulate(along)
            self.front = math.floor(highest[0])  # newest mark, counted along the heading
        front = max(math.floor(highest[-1]), self.front)
        new = front - self.front
        if new:
            passed = np.interp(np.arange(self.front + 1, front + 1), highest, times)
            self.times = np.append(self.times, passed)[-max(RING, new + 2 * self.turn) :]
            self.front = front
            some = min(len(self.times) - 1, self.turn // 4)
            if some > 0:
                self.speed = some / max(self.times[-1] - self.times[-1 - some], 1e-9)
            dt = (times[-1] - times[0]) / (len(times) - 1)
            self.open = self.quantum
            if self.kind != LOOSE:
                self.open = min(self.open, self.speed * self.size * dt)
            (self._turns if self.marks else self._search)(new)
            self.travelled += new / self.turn
            if self.kind == COARSE and self.foresees and self.marks:
                self._foresee(new)

    # ---- errors of the sensor

    def _turns(self, new: int) -> None:
        """Learn from whole turns, of which the newest marks are the ends."""
        marks, times = self.marks, self.times
        half, new = marks // 2, min(new, len(times) - marks)
        if new <= 0:
            return
        ends = np.arange(len(times) - new, len(times))
        whole, middle = times[ends] - times[ends - marks], times[ends - half]
        steady = np.abs(times[ends] - middle - whole * half / marks) < STEADY * whole
        cells = (times[ends - half + 1] - middle) * marks / whole - 1.0
        if not steady.all():
            self.cells, cells = NOTHING, cells[np.flatnonzero(~steady)[-1] + 1 :]
        if len(cells):
            self.speed = marks / float(whole[-1])
        cells = np.append(self.cells, cells)
        table = self._table(self.heading)
        while len(cells) >= marks:
            first = self.front - half + 1 - len(cells)
            turn = np.empty(marks)
            turn[self._lower(np.arange(first, first + marks)) % marks] = cells[:marks]
            cells = cells[marks:]
            self.unit = self.unit or self.speed
            self.since = float(times[-1])
            turn -= turn.mean()
            error = self.size * (np.cumsum(turn) - turn)
            error -= error.mean()
            if self.speed > SLOWER * table.fastest:
                table.fastest = max(self.speed, table.fastest)
                speed = self._relative_speed()
                least = self.open * (RESOLVED_EDGES if self.kind == COARSE else RESOLVED)
                table.learn(error, self.speed, speed, least)
                self.moves = table.moves
            else:  # a torque ripples more than before
                table.compare(error, self.speed)
        self.cells = cells

    def _table(self, heading: int) -> Table:
        """Return what is learnt in this direction; a fine sensor has one table for both."""
        return self.tables[1 if self.kind == COARSE and heading < 0 else 0]

    def _relative_speed(self) -> float:
        """Return what `b` of a table is multiplied by; a fine sensor has no late edges."""
        return self.speed / self.unit - 1.0 if self.kind == COARSE else 0.0

    def _lower(self, along: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the cells that begin at marks counted along the heading."""
        return along if self.heading > 0 else -along - 1

    def _search(self, new: int) -> None:
        """Look for the number of marks after which the errors of a coarse sensor repeat.

        It need not be the turn of the joint: those of a motor behind a gear repeat with its own
        turn. It is the smallest lag over which pairs of cells are as alike as over any (of pairs,
        because the edges of Hall sensors come late by turns).
        """
        times, turn, new = self.times, self.turn, min(new, len(self.times) - LOCAL)
        if new <= 0:
            return
        ends = np.arange(len(times) - new, len(times))
        start, middle, end = times[ends - LOCAL], ends - LOCAL // 2, times[ends]
        steady = np.abs(2.0 * times[middle] - start - end) < STEADY * (end - start)
        pairs = 0.5 * LOCAL * (times[middle + 1] - times[middle - 1]) / (end - start)
        if not steady.all():
            self.pairs, pairs = NOTHING, pairs[np.flatnonzero(~steady)[-1] + 1 :]
        old = len(self.pairs)
        pairs = np.append(self.pairs, pairs)
        lags = np.arange(turn, 1, -(2 - turn % 2))  # an even number of edges comes in pairs
        fresh = np.arange(max(old, turn), len(pairs))
        differences = pairs[fresh, None] - pairs[fresh[:, None] - lags]
        self.squares[lags] += np.sum(differences * differences, axis=0)
        self.count += len(fresh)
        self.pairs = pairs[-turn:]
        if self.count < SEARCHED * turn:
            return
        squares = self.squares[lags]
        self.marks = turn
        if squares.min() < STRIKING * squares.mean():
            self.marks = int(lags[squares <= ALIKE * squares.min()].min())
        self._make_tables()
        self.travelled = 0.0

    def _errors(self, heading: int) -> Array:
        """Return what is taken out at each mark [rad], shape (n,)."""
        table, other = self._table(heading), self._table(-heading)
        if table.in_use:
            known = not table.doubtful(self.speed)
            return table.taken_out(self._relative_speed()) if known else np.zeros(self.marks)
        if self.kind == COARSE and not table.learnt and other.in_use:
            return other.a.copy()
        return np.zeros(len(table.a))

    def _foresee(self, new: int) -> None:
        """Look for a ripple of the speed in slower turns than those that were learnt."""
        self.lag = 0
        if self.speed < SLOWER * self.tables[self.heading < 0].fastest:
            cells = self._lower(np.arange(self.front - SPAN, self.front)) % self.marks
            rises = self._rises(self.heading)[cells]
            self.lag = found(self.times, self.marks, rises, 0.5 * self.open / self.size)
        self.share = min(self.share + new / self.lag, 1.0) if self.lag else 0.0
        if self.share == 1.0:
            self.foreseen = self.lag

    def _rises(self, heading: int) -> Array:
        """Return by how much the errors make each cell larger, over its size; shape (n,)."""
        errors = self._errors(heading)
        return (np.roll(errors, -1) - errors) / self.size

    # ---- result

    def maps(self) -> Maps:
        """Return what is taken out of the readings now."""
        forward, backward = self._errors(1), self._errors(-1)
        rises = motions = np.zeros(self.marks)
        if self.share > 0.0:
            first, ripple = slower(self.times, self.lag)
            here = np.zeros(self.lag)
            starts = self.front + 1 - len(self.times) + first
            here[self._lower(np.arange(starts, starts + len(ripple))) % self.lag] = ripple
            here = np.tile(here, self.marks // self.lag)
            # edges that come late by turns make cells long and short by turns: that is no motion
            smooth = 0.5 * here + 0.25 * (np.roll(here, 1) + np.roll(here, -1))
            rises = np.maximum(self.share * (here - self._rises(self.heading)), SMALLEST - 1.0)
            motions = np.maximum(self.share * smooth, SMALLEST - 1.0)
        return Maps(
            self.kind == COARSE,
            self.size,
            self.quantum if self.quantum < math.inf else 0.0,
            0.0 if self.kind == COARSE or self.tables[0].sure else 1.0,
            self.heading if self.share > 0.0 else 0,
            np.stack((forward, backward, rises, motions)),
        )

    def errors(self, heading: int) -> Errors:
        """Return the errors known now: (angles as read, speeds) -> those of the marks [rad].

        Both are arrays of shape (n,) [rad, rad/s], and so is what the function returns: the error
        of the mark next to each angle.
        """
        table = self._table(heading)
        a, b, used = table.taken_out(0.0).copy(), table.b.copy(), table.in_use
        size, unit, here, reading = self.size, self.size * self.unit, self.at, self.reading

        def errors(angles: Array, speeds: Array) -> Array:
            if not used:
                return np.zeros(len(angles))
            at = np.rint((angles - reading) / size + here).astype(np.int64) % len(a)
            return a[at] + (np.abs(speeds) / unit - 1.0) * b[at]

        return errors

    def text(self) -> str:
        """Return what the status of a joint reports of its sensor; '' if nothing is corrected."""
        ripple = ''
        if self.foreseen:
            period = math.degrees(self.size * self.foreseen)
            ripple = f'a ripple of the speed that repeats each {period:.4g} deg is foreseen'
        errors = np.maximum(np.abs(self._errors(1)), np.abs(self._errors(-1)))
        if not errors.any():
            return ripple
        at = self.reading + (float(np.argmax(errors)) - self.at) * self.size
        at = math.degrees(at % (self.size * self.marks))
        turn = f'{math.degrees(self.size * self.marks):.4g} deg'
        # coarsely, because a status that changes is published and logged
        largest = float(f'{math.degrees(errors.max()):.1g}')
        taken = (
            f'sensor errors of up to {largest:g} deg that repeat each '
            f'{"turn" if self.marks == self.turn else turn} are taken out '
            f'(largest near {10.0 * round(0.1 * at):.0f} deg)'
        )
        if self.kind != COARSE and not self.tables[0].sure:
            taken += f', or motion: turns {FASTER} times as fast will show it'
        return f'{taken}; {ripple}' if ripple else taken
