# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The error of the stamps, from the readings of a moving joint."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.series import Series
from estimator_pkg.evaluation.signals import slopes

ERROR_RATIO = 3.0  # an error is seen if it is this multiple of that at rest
LEAST_PART_SEEN = 1e-3  # and if it is more than this fraction of a sample time
FEWEST_MOVING = 200  # smallest number of readings in motion for an estimate
OPPOSED_PART = -0.4  # correlation of neighbouring third differences: -0.75 for wrong stamps
MOVING_PART = 0.1  # a joint moves above this fraction of its usual speed,
GROWS = 0.6  # and there the error grows with at least this power of the speed
SPACING_DEVIATIONS = 5.0  # the spacing disagrees with the motion by this many standard deviations
STAMP_OUTLIER = 10.0  # readings further from the line between their neighbours are ignored
VISIBLE = 0.5  # the effect of the spacing is at least this fraction of a quantum, in rms
SPEED_SIDE = 4  # samples on either side that show the speed
MOST_READINGS = 100_000  # readings that are enough


def line_error(series: Series, run: NDArray[np.int64], period: float, count: float) -> float:
    """Return the standard deviation of the stamps' error [s]; 0 if none is seen.

    Each reading is compared with the straight line between its neighbours. The effect of noise
    does not depend on the speed; that of a wrong stamp is the speed times its error. A vibration
    on a slow motion differs from both: its third differences do not alternate.

    Parameters
    ----------
    series : the readings. run : shape (k,), indices of consecutive ones, sorted by stamp.
    period : wrap period [rad]; 0: none. count : quantum [rad]; 0: none.
    """
    time = (series.stamps_ns[run] - series.stamps_ns[run[0]]) * 1e-9
    if len(time) < FEWEST_MOVING:
        return 0.0
    angle = series.position[run]
    if period > 0.0:
        angle = np.unwrap(angle, period=period).astype(np.float64)
    before, after = np.diff(time)[:-1], np.diff(time)[1:]
    usable = before + after <= 4.0 * float(np.median(before))
    part = before / (before + after)
    missed = angle[1:-1] - (1.0 - part) * angle[:-2] - part * angle[2:]
    gain = np.sqrt(1.0 + (1.0 - part) ** 2 + part**2)
    # the neighbours after next know the speed without the stamps in question
    speed = np.abs(slopes(time, angle))[1:-1]
    missed, speed = (missed / gain)[usable], speed[usable]
    bends = np.diff(missed)  # the effect of acceleration changes slowly
    speed = speed[1:]
    slow, fast = speed <= np.percentile(speed, 25), speed >= np.percentile(speed, 75)
    if not fast.any() or not slow.any():
        return 0.0

    # steady jitter on a straight line: the second difference has 1.22 times one stamp's deviation,
    # and neighbouring ones are correlated by -2/3
    def scale(which: NDArray[np.bool_]) -> float:
        return 1.4826 * float(np.median(np.abs(bends[which]))) / math.sqrt(2.0 * (1.0 + 2.0 / 3.0))

    floor = max(scale(slow), count / math.sqrt(12.0))
    high = scale(fast)
    top = float(np.median(speed[fast]))
    if high < ERROR_RATIO * floor or top <= 0.0:
        return 0.0
    error = math.sqrt(high * high - floor * floor) / top
    moving = speed > MOVING_PART * float(np.percentile(speed, 95))
    if np.count_nonzero(moving) < FEWEST_MOVING:
        return 0.0
    faster, bent = np.log(speed[moving]), np.log(np.abs(bends[moving]) + 0.1 * floor + 1e-12)
    if np.std(faster) > 0.2 and np.polyfit(faster, bent, 1)[0] < GROWS:
        return 0.0
    limit = 5.0 * high * math.sqrt(2.0 * (1.0 + 2.0 / 3.0))
    both = fast[1:] & fast[:-1]
    first, second = (np.clip(each[both], -limit, limit) for each in (bends[:-1], bends[1:]))
    power = float(np.sum(first * first + second * second))
    if power <= 0.0 or 2.0 * float(np.sum(first * second)) > OPPOSED_PART * power:
        return 0.0
    return error if error > LEAST_PART_SEEN * float(np.median(before)) else 0.0


def spacing_error(
    stamps_ns: NDArray[np.int64], position: NDArray[np.float64], period: float, count: float
) -> float:
    """Return the standard deviation of the stamps' error [s] if their spacing lies; else 0.

    A reading between two others lies off the middle of both by its speed times d, the distance of
    its stamp from the middle of their stamps. So the regression of one on the other has the slope
    1 for true stamps, and var(true d) / var(d) < 1 for others. This holds for any noise of the
    reading, and for stamps that change the order.

    Parameters
    ----------
    stamps_ns, position : shape (n,), in the order of arrival. period : wrap period [rad]; 0:
        none. count : quantum [rad]; 0: none.
    """
    time = (stamps_ns[:MOST_READINGS] - stamps_ns[0]) * 1e-9
    moves = np.diff(position[:MOST_READINGS])
    if period > 0.0:
        moves -= period * np.round(moves / period)
    steps = np.diff(time)
    step = float(np.median(steps))
    if len(steps) < FEWEST_MOVING or step <= 0.0:
        return 0.0
    around = slice(SPEED_SIDE - 1, -(SPEED_SIDE - 1))
    off = 0.5 * (moves[:-1] - moves[1:])[around]
    early = 0.5 * (steps[:-1] - steps[1:])[around]
    way, passed, longest = (
        np.lib.stride_tricks.sliding_window_view(each, 2 * SPEED_SIDE)
        for each in (moves, steps, np.abs(steps))
    )
    speed = way.sum(axis=1) / np.maximum(passed.sum(axis=1), SPEED_SIDE * step)
    near = longest.max(axis=1) < 5.0 * step
    near &= np.abs(off) <= STAMP_OUTLIER * 1.4826 * np.median(np.abs(off)) + np.abs(speed) * step
    near &= np.abs(speed) > MOVING_PART * float(np.percentile(np.abs(speed), 95))
    if np.count_nonzero(near) < FEWEST_MOVING:
        return 0.0
    off, shift, early = off[near], (speed * early)[near], early[near]
    power = float(np.sum(shift * shift))
    if power <= len(shift) * max(VISIBLE * count, 1e-12) ** 2:
        return 0.0  # the readings are too coarse to show it
    slope = float(np.sum(off * shift)) / power
    unsure = math.sqrt(float(np.sum((off - slope * shift) ** 2 * shift**2))) / power
    if 1.0 - slope < SPACING_DEVIATIONS * unsure:
        return 0.0
    return math.sqrt(min(1.0 - slope, 1.0) * float(np.mean(early * early)) / 1.5)
