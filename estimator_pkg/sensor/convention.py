# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The published position keeps the convention of the measurement.

If the measurement is multi-turn, so is the estimate; if it is wrapped, the estimate is wrapped to
the same interval. The convention is learnt from the stream: a jump of about one period shows that
the measurement wraps, a range of more than one period that it is multi-turn. Until one of them has
occurred, the estimate is clamped to the edge of the interval, which changes it by at most the
innovation.
"""

from __future__ import annotations

from estimator_pkg.circle import wrap
from estimator_pkg.record import record

EDGE_SLACK = 1e-6  # of a turn: atan2 returns +pi too, and float32 values miss the edges by rounding


@record
class Convention:
    """What the measurements have shown of their convention."""

    last: float  # the last measurement [rad or m]
    low: float  # the lowest
    high: float  # the highest
    wraps: float  # wraps seen
    turns: float  # turns counted from the first sample


def begin_convention(convention: Convention, measurement: float) -> None:
    """Set the convention after the first sample [rad or m]."""
    convention.last = convention.low = convention.high = measurement
    convention.wraps = convention.turns = 0.0


def follow_convention(convention: Convention, measurement: float, period: float) -> None:
    """Take one more sample [rad or m]."""
    change = measurement - convention.last
    convention.last = measurement
    if convention.low <= measurement <= convention.high and -0.5 * period <= change < 0.5 * period:
        return
    if measurement < convention.low:
        convention.low = measurement
    if measurement > convention.high:
        convention.high = measurement
    if period > 0.0:
        whole = (wrap(change, period) - change) / period  # turns by which the measurement jumped
        if whole > 0.5 or whole < -0.5:
            convention.wraps += 1.0
            convention.turns += float(round(whole))


def present(convention: Convention, position: float, period: float, unwrap: bool) -> float:
    """Return the estimated `position` [rad or m] in the convention of the measurement.

    Parameters
    ----------
    convention : the convention after the measurement of this estimate.
    position : the estimate, on any turn.
    period : wrap period [rad]; 0: no wrap, the position is returned unchanged.
    unwrap : count turns from the first sample.
    """
    if period <= 0.0:
        return position
    last, low, high = convention.last, convention.low, convention.high
    half = 0.5 * period
    shown = position
    if not -half <= position - last < half:
        shown = last + wrap(position - last, period)
    if unwrap:
        return shown + convention.turns * period
    if low <= shown <= high:
        return shown  # within the measured range, so it has the measurement's convention
    slack = EDGE_SLACK * period
    if low < -half - slack or high >= period + slack or (low < -slack and high >= half + slack):
        return shown  # the range exceeds every interval of one period: multi-turn
    if convention.wraps > 0.0:
        if low < -slack:
            return wrap(shown, period)
        return wrap(shown - half, period) + half
    # The wrapping edge is not known yet: do not return an estimate beyond an edge that the
    # measurement has not crossed.
    for edge in (-half, 0.0, half, period):
        if low >= -slack or edge != 0.0:
            if last < edge <= shown:
                return edge - 1e-9 * period
            if shown < edge <= last:
                return edge
    return shown
