# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sites of a stretch of cells: the cells to use, and the sweeps until the sites converge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import compiled
from estimator_pkg.evaluation.reference.smoother.cells import sweep, towards
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, start

Array = NDArray[np.float64]

SWEEPS = 3  # forward and backward: the sites converge after two
OF_A_RUN = 15  # number of used cells in a run of equal readings, and its last,
DRIFT = 0.25  # or more, if the motion can drift by this many quanta between them


def find_sites(
    part: Piece, quantum: float, blur: float, jerk: float, sweeps: int = SWEEPS
) -> tuple[Array, float]:
    """Return (sites, log of the probability) of a stretch of cells; see `smoother.cells.sweep`.

    In a run of equal readings only some cells are used: the first, the last, and as many between
    as are informative. More would count as independent although they are not.

    Parameters
    ----------
    part : its readings are the unwrapped middles of the cells; nan: none.
    quantum, blur : width of a cell, and standard deviation of its blur [rad].
    jerk : intensity of the white jerk [rad^2/s^5].
    """
    centres = np.where(used(part, quantum, jerk), part.readings, np.nan)
    known = np.flatnonzero(np.isfinite(centres))
    sites: Array = np.zeros((len(centres), 2))
    if not len(known):
        return sites, 0.0
    variance = quantum**2 / 12.0 + blur**2
    ways = (centres, centres[::-1].copy())
    steps = (part.steps, np.concatenate([[0.0], part.steps[:0:-1]]))
    starts = [start(centres[i], variance) for i in (known[0], known[-1])]
    sites[known, 0] = 1.0 / variance
    messages: Array = np.empty((len(sites), 9))
    sites = sites[::-1].copy()
    compiled(towards)(starts[1], steps[1], ways[1], jerk, sites, messages)
    along, log_z = compiled(sweep), 0.0
    for turn in range(2 * sweeps):  # each direction replaces the messages of the other
        way = turn % 2
        messages, sites = messages[::-1].copy(), sites[::-1].copy()
        log_z = along(
            starts[way], steps[way], ways[way], 0.5 * quantum, blur, jerk, messages, sites
        )
    return sites[::-1].copy(), log_z


def used(part: Piece, quantum: float, jerk: float) -> NDArray[np.bool_]:
    """Return which cells are used, shape (n,)."""
    count = len(part.readings)
    changed = ~(np.abs(np.diff(part.readings)) < 0.5 * quantum)
    firsts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    lengths = np.diff(firsts, append=count)
    step = float(np.median(part.steps[1:])) if count > 1 else 1.0
    # white jerk drifts by sqrt(jerk t^5 / 20) in a time t
    drift = (20.0 * (DRIFT * quantum) ** 2 / jerk) ** 0.2 / step
    every = np.maximum(1.0, np.minimum(lengths / OF_A_RUN, drift)).astype(np.int64)
    within = np.arange(count) - np.repeat(firsts, lengths)
    chosen = within % np.repeat(every, lengths) == 0
    chosen[firsts + lengths - 1] = True
    return chosen
