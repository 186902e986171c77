# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Errors of the marks of a turn as they are learnt, and the proof that they help.

See `sensor.map` for the equations. Angles are in rad, speeds in marks/s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST = 128  # counts of a turn of a coarse sensor, at most
FEWEST, USUAL = 32, 64  # marks of a fine sensor's turn: at least; at most, and usually
LEAST = 6  # counts of a turn, at least
WHOLE = 0.01  # as close is a number of counts to a whole one
BETTER, WORSE = 0.5, 0.8  # mean squared error with the map, over that without it
TURNS, LONGEST = 3, 64  # in a row that have to be better, at first and at most
SLOWLY = 4.0  # turns over which these errors are averaged
WILD = 4.0  # times its mean: a mean squared error counts no more
KEPT = 12.0  # turns over which the map is averaged
# another speed, times; a turn there that leaves less of its squared error shows the sensor's. That
# of a motion which falls with the square of the speed leaves 0.24 or more, and 0.92 if faster
FASTER, SURE = 1.4, 0.2
LARGEST = 0.06  # [rad] what exceeds it at one speed is rather a motion: 3.4 deg of a fine sensor
FEW = 2  # harmonics of a fine sensor's turn that are taken out before another speed has shown more
# kinds: not known yet; marks are edges; marks are edges of some counts; marks are no edges
UNKNOWN, COARSE, FINE, LOOSE = 0, 1, 2, 3


class Maps(NamedTuple):
    """What is taken out of the readings.

    coarse : the marks are edges. size : of a cell between two marks [rad]. quantum : [rad]; 0: not
    known. doubt : 1: it may be motion, no other speed has shown it yet; 0: it is the sensor's.
    way : direction in which a ripple is foreseen; 0: none. tables : shape (4, n), one array because
    compiled code counts its users at each sample. Rows `FORWARD` and `BACKWARD`: error of each mark
    [rad]. `RISES` and `MOTIONS`: by how much longer than usual the shaft takes for each cell: all
    of it but the sensor's errors, and its motion alone.
    """

    coarse: bool
    size: float
    quantum: float
    doubt: float
    way: int
    tables: Array


FORWARD, BACKWARD, RISES, MOTIONS = range(4)  # rows of the tables


def few(errors: Array) -> Array:
    """Return the first harmonics of errors over a turn, shape (marks,)."""
    spectrum = np.fft.rfft(errors)
    spectrum[FEW + 1 :] = 0.0
    return np.fft.irfft(spectrum, len(errors))


def mean_square(errors: Array) -> float:
    """Return the mean square of errors, shape (marks,)."""
    return float(np.mean(errors * errors))


class Table:
    """Errors of the marks as learnt in one direction, and the proof that they help.

    Parameters
    ----------
    marks : of a turn. fine : they are no edges, and the errors may be motion.
    moves : a faster turn has shown a motion that repeats each turn.
    """

    def __init__(self, marks: int, fine: bool, moves: bool = False) -> None:
        self.fine, self.moves = fine, moves
        self.a, self.b = np.zeros(marks), np.zeros(marks)  # error = a + b (speed - 1)
        self.learnt = 0  # turns
        self.without, self.within = 0.0, 0.0  # mean squared errors without and with the map
        self.good, self.required = 0, TURNS  # turns in a row that are better, and how many must be
        self.in_use = self.withheld = False  # withheld: it predicts turns, and is not believed
        self.fastest = 0.0  # highest speed [marks/s]
        self.pace = 0.0  # mean speed of the turns that the map is from [marks/s]
        self.sure = self.all_sure = False  # few harmonics, and the others, are the sensor's

    def learn(self, error: Array, pace: float, speed: float, left: float) -> None:
        """Learn from the errors of one turn, and decide whether the map is used.

        Parameters
        ----------
        error : shape (marks,), of each mark [rad].
        pace : speed [marks/s].
        speed : in its unit, less 1; 0: b is not learnt.
        left : mean error that cannot be attributed to the sensor [rad].
        """
        self.compare(error, pace)
        missed = error - self.a - speed * self.b
        without, within = mean_square(error), mean_square(error - self.taken_out(speed))
        share = 1.0 / (min(self.learnt + 1.0, KEPT) * (1.0 + speed * speed))
        if self.learnt > 1 and within > self.within:  # less steady than other turns: counts less
            share *= self.within / within
        self.a += share * missed
        self.b += share * speed * missed
        self.pace += share * (pace - self.pace)
        self.learnt += 1
        if self.learnt == 1:
            return
        weight = 1.0 / min(self.learnt - 1.0, SLOWLY)
        if self.learnt > 2 and within > WILD * self.within:
            weight *= WILD * self.within / within
        self.without += weight * (without - self.without)
        self.within += weight * (within - self.within)
        self.good = self.good + 1 if within < BETTER * without and without > left * left else 0
        if not self.in_use:
            better = self.good >= self.required and self.within < BETTER * self.without
            believed = not self.fine or self.sure or self._may_be_the_sensors()
            self.in_use, self.withheld = better and believed, better and not believed
        elif self.within > WORSE * self.without:
            self.moves |= self.doubtful(pace)
            self.in_use, self.sure, self.all_sure, self.learnt = False, False, False, 1
            self.required = min(2 * self.required, LONGEST)

    def compare(self, error: Array, pace: float) -> None:
        """Decide by a turn at another speed whether these are errors of the sensor, or a motion.

        Parameters
        ----------
        error : shape (marks,), as in `learn`. pace : speed [marks/s].
        """
        if not self.fine or self.learnt < TURNS or 1.0 / FASTER <= pace / self.pace <= FASTER:
            return
        missed = error - self.a
        shown, left_over = few(error), few(missed)
        self.sure |= mean_square(left_over) < SURE * mean_square(shown)
        self.all_sure |= mean_square(missed - left_over) < SURE * mean_square(error - shown)

    def _may_be_the_sensors(self) -> bool:
        """Whether errors that only one speed has shown are believed to be a fine sensor's."""
        return not self.moves and float(np.abs(few(self.a)).max()) < LARGEST

    def taken_out(self, speed: float) -> Array:
        """Return what is taken out [rad], shape (marks,); `speed` as in `learn`."""
        if not self.fine:
            return self.a + speed * self.b
        return self.a if self.all_sure else few(self.a)

    def doubtful(self, pace: float) -> bool:
        """Whether at this speed [marks/s] the errors may be of a motion that is none there."""
        return self.fine and not self.sure and pace > FASTER * self.pace

    def copied(self) -> Table:
        """Return a table of the other direction that begins with the errors of this one."""
        other = Table(len(self.a), self.fine)
        vars(other).update(vars(self), a=self.a.copy(), b=np.zeros(len(self.a)), learnt=1)
        return other


def grid(period: float, quantum: float) -> tuple[int, int]:
    """Return (kind, marks of a turn) of a sensor with this quantum [rad]; inf: not known."""
    if quantum == math.inf:
        return UNKNOWN, USUAL
    counts = period / quantum
    whole = math.floor(counts + 0.5) if counts < 1e6 else 0
    if LEAST <= whole <= MOST and abs(counts - whole) < WHOLE:
        return COARSE, whole
    if whole > MOST and abs(counts - whole) < WHOLE:
        for turn in range(USUAL, FEWEST - 1, -1):
            if whole % turn == 0:
                return FINE, turn
    return LOOSE, USUAL
