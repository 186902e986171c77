# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sites of a stretch of cells: the cells to use, and the sweeps until the sites converge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.calls import run
from estimator_pkg.evaluation.reference.smoother.cells import along, filtered, used
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, start

Array = NDArray[np.float64]

SWEEPS = 3  # forward and backward: the sites converge after two
OF_A_RUN = 15.0  # number of used cells in a run of equal readings, and its last,
DRIFT_QUANTA = 0.25  # or more, if the motion can drift by this many quanta between them


class Stretch:
    """A stretch of cells, and the sites that were found last.

    In a run of equal readings only some cells are used (`cells.used`). More would count as
    independent although they are not.

    Parameters
    ----------
    part : its readings are the unwrapped middles of the cells; nan: none.
    quantum : width of a cell [rad].
    """

    def __init__(self, part: Piece, quantum: float) -> None:
        self._part, self._quantum = part, quantum
        count = len(part.readings)
        self._step = part.step if count > 1 else 1.0
        self._speed = part.speed
        self._rows, self._gaps = np.empty(count, np.int64), np.empty(count + 1)
        self._messages = np.empty((count, 9))
        self._sites, self._guessed = np.zeros((count, 2)), np.empty((count, 2))
        nothing = np.zeros(0)
        self._chosen = np.zeros(0, np.int64), nothing, nothing
        self._of = self._chosen[0]  # rows of the newest sites, which are
        self._newest = np.zeros((0, 2))
        self._drift = np.nan
        runs = np.flatnonzero(np.abs(np.diff(part.readings)) >= 0.5 * quantum)
        self._longest = float(np.max(np.diff(runs, prepend=-1, append=count))) / OF_A_RUN

    def _choose(self, jerk: float) -> tuple[NDArray[np.int64], Array, Array]:
        """Return (rows, gaps, centres) of the cells that are used."""
        # white jerk drifts by sqrt(jerk t^5 / 20) in a time t
        drift = (20.0 * (DRIFT_QUANTA * self._quantum) ** 2 / jerk) ** 0.2 / self._step
        drift = min(drift, self._longest)  # above it, it does not matter
        if drift != self._drift:
            self._drift = drift
            part = self._part
            columns = part.readings, part.steps
            found = self._rows, self._gaps
            count = run(used, len(part.rows), *columns, self._quantum, drift, OF_A_RUN, *found)
            if not np.array_equal(self._rows[:count], self._chosen[0]):
                rows = self._rows[:count].copy()
                self._chosen = rows, self._gaps[: count + 1].copy(), part.readings[rows]
        return self._chosen

    def guess(self, blur: float, jerk: float) -> float:
        """Return the log of the probability of the readings, roughly, in one pass.

        Parameters
        ----------
        blur, jerk : standard deviation of the cells' blur [rad], intensity of the white jerk
            [rad^2/s^5].
        """
        rows, gaps, centres = self._choose(jerk)
        if not len(rows):
            return 0.0
        half = 0.5 * self._quantum
        x = start(centres[0], half * half / 3.0 + blur * blur, self._speed, self._step)
        sites = self._guessed[: len(rows)]
        return float(run(filtered, x, len(rows), gaps, centres, half, blur, jerk, sites))

    def probability(self, blur: float, jerk: float, sweeps: int | None = None) -> float:
        """Return the same with the sites that `sweeps` forward and backward find.

        None: those of the last call are the start. One direction is enough then, or three if other
        cells are used now.
        """
        rows, gaps, centres = self._choose(jerk)
        count = len(rows)
        if not count:
            return 0.0
        half = 0.5 * self._quantum
        variance = half * half / 3.0 + blur * blur
        passes = 1
        if sweeps is not None or not len(self._of):
            passes = 2 * (sweeps or SWEEPS)
            self._sites[:] = 1.0 / variance, 0.0
            self._newest = self._sites[rows]
        elif rows is not self._of:
            passes = 3
            self._sites[self._of] = self._newest
            self._newest = self._sites[rows]
        self._of = rows
        log_z = run(
            along,
            start(0.0, variance, self._speed, self._step),
            count,
            gaps,
            centres,
            half,
            blur,
            jerk,
            self._newest,
            self._messages[:count],
            passes + 1,
        )
        return float(log_z)

    def sites(self) -> Array:
        """Return the sites that were found last; shape (n, 2), 0 for cells that are not used."""
        result = np.zeros((len(self._part.readings), 2))
        result[self._of] = self._newest
        return result


def find_sites(part: Piece, quantum: float, blur: float, jerk: float) -> tuple[Array, float]:
    """Return (sites, log of the probability) of a stretch of n cells; see `smoother.cells.sweep`.

    The sites have shape (n, 2) [1/rad^2, 1/rad]; they are 0 for cells that are not used.

    Parameters
    ----------
    part : its readings are the unwrapped middles of the cells; nan: none.
    quantum, blur : width of a cell, and standard deviation of its blur [rad].
    jerk : intensity of the white jerk [rad^2/s^5].
    """
    stretch = Stretch(part, quantum)
    log_z = stretch.probability(blur, jerk, SWEEPS)
    return stretch.sites(), log_z
