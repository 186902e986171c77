"""Sites of a stretch of cells: which cells are met, and the sweeps until the sites stay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import compiled
from estimator_pkg.evaluation.reference.smoother.cells import sweep, towards
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, start

Array = NDArray[np.float64]

SWEEPS = 3  # there and back: the sites stay after two
OF_A_RUN = 15  # so many cells of a run of equal readings are met, and its last
DRIFT = 0.25  # but more, where the motion may drift by so many quanta between them


def find_sites(
    part: Piece, quantum: float, blur: float, jerk: float, sweeps: int = SWEEPS
) -> tuple[Array, float]:
    """(sites, log of the probability) of a stretch of cells; see `smoother_cells.sweep`.

    Of a run of equal readings only some are met: the first, the last, and as many between as say
    something new. Cells that say the same again and again would be counted as if they did not.

    Parameters
    ----------
    part : its readings are the middles of the cells, turns counted; nan: none.
    quantum, blur : width of a cell, and one standard deviation of what blurs it [rad].
    jerk : intensity of the white jerk [rad^2/s^5].
    """
    centres = np.where(met(part, quantum, jerk), part.readings, np.nan)
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
    for turn in range(2 * sweeps):  # each way fills the messages that the other has used
        way = turn % 2
        messages, sites = messages[::-1].copy(), sites[::-1].copy()
        log_z = along(
            starts[way], steps[way], ways[way], 0.5 * quantum, blur, jerk, messages, sites
        )
    return sites[::-1].copy(), log_z


def met(part: Piece, quantum: float, jerk: float) -> NDArray[np.bool_]:
    """Shape (n,): which cells are met."""
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
