# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find readings that are older than their stamps: repeated ones, and those of a sensor that sticks.

Both show the joint where it was, while it moves on. The reference must not follow them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.signals import wrapped

Array = NDArray[np.float64]

SPEED_OVER = 10  # the speed at a reading is taken over this many readings to either side
MOVING_COUNTS = 3.0  # quanta per reading that count as motion
REPEATED_PART = 0.2  # fraction of equal readings in motion that is not chance
FEWEST_IN_MOTION = 50  # smallest number of readings in motion
STUCK_RUN = 4  # shortest run of equal readings that may be a sensor that sticks
TRAVELLED = 4.0  # quanta that the joint must travel during the run, by the speed on both sides
ABRUPT = 2.0  # the jump after the run is more than this multiple of the moves on both sides
CAUGHT_UP = 0.5  # the jump after the run is this fraction of the travel at least, 1 / this at most


class Fresh(NamedTuple):
    """Which readings are new.

    new : shape (n,), True for a reading that is not older than its stamp.
    stale : fraction of equal readings in motion.
    stuck : (time [s] since the first reading, duration [s]) of each time that the sensor stuck.
    """

    new: NDArray[np.bool_]
    stale: float
    stuck: tuple[tuple[float, float], ...]


def fresh(time: Array, readings: Array, period: float, quantum: float) -> Fresh:
    """Return which readings are new.

    Parameters
    ----------
    time : shape (n,), increasing [s]. readings : shape (n,) [rad], finite.
    period : wrap period [rad]; 0: none. quantum : of the readings [rad]; 0: none.
    """
    count = len(readings)
    new = np.ones(count, bool)
    if count < 4 * SPEED_OVER:
        return Fresh(new, 0.0, ())
    moves = wrapped(np.diff(readings, prepend=readings[0]), period)
    small = max(quantum, 1e-9)
    moving = np.zeros(count, bool)
    travelled = np.cumsum(moves)
    far = np.abs(travelled[2 * SPEED_OVER :] - travelled[: -2 * SPEED_OVER])
    moving[SPEED_OVER:-SPEED_OVER] = far > MOVING_COUNTS * 2 * SPEED_OVER * small
    same = moves == 0.0
    same[0] = False
    stale = float(np.mean(same[moving])) if np.count_nonzero(moving) > FEWEST_IN_MOTION else 0.0
    if stale > REPEATED_PART:
        slower = np.ones(count, bool)
        slower[SPEED_OVER:-SPEED_OVER] = far <= 2 * SPEED_OVER * small
        return Fresh(~same | slower, stale, ())
    stuck = _stuck(time, moves, same, small)
    for first, last in stuck:
        new[first + 1 : last + 1] = False
    spans = tuple((float(time[a] - time[0]), float(time[b] - time[a])) for a, b in stuck)
    return Fresh(new, stale, spans)


def _stuck(
    time: Array, moves: Array, same: NDArray[np.bool_], small: float
) -> list[tuple[int, int]]:
    """Return (first, last) reading of each run of equal readings that ends in a jump.

    The joint moved on at about the speed before and after the run, so the jump is about its travel,
    and far more than from any reading to the next. A joint that stops and starts does not jump.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    firsts, lasts = edges[::2] - 1, edges[1::2] - 1  # readings first .. last are equal
    usable = (
        (lasts - firsts >= STUCK_RUN)
        & (firsts >= SPEED_OVER)
        & (lasts + 1 + SPEED_OVER < len(moves))
    )
    firsts, lasts = firsts[usable], lasts[usable]
    jumped = np.abs(moves[lasts + 1]) >= CAUGHT_UP * TRAVELLED * small
    found = []
    for first, last in zip(firsts[jumped].tolist(), lasts[jumped].tolist()):
        sides = moves[first - SPEED_OVER + 1 : first + 1], moves[last + 2 : last + 2 + SPEED_OVER]
        speeds = (
            np.sum(sides[0]) / (time[first] - time[first - SPEED_OVER]),
            np.sum(sides[1]) / (time[last + 1 + SPEED_OVER] - time[last + 1]),
        )
        travel = float(np.mean(speeds) * (time[last + 1] - time[first]))
        jump = float(moves[last + 1])
        if (
            jump * travel > 0.0
            and abs(travel) > TRAVELLED * small
            and CAUGHT_UP <= jump / travel <= 1.0 / CAUGHT_UP
            and abs(jump) > ABRUPT * np.max(np.abs(sides))
        ):
            found.append((first, last))
    return found
