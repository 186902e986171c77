"""The published position keeps the convention of the measurement.

Multi-turn in, multi-turn out; wrapped in, wrapped out in the same interval. Which one it is, is
learnt from the stream: a jump of about one period tells that it wraps, a range beyond one period
that it is multi-turn. Until either was seen, the estimate is held at the edge rather than shown
past it, which is right in both cases to within the innovation.
"""

from __future__ import annotations

from estimator_pkg.observers.circle import wrap

SLACK = 1e-6  # part of a turn: atan2 gives +pi too, and float32 numbers lie beside their edges

# (last measurement, lowest, highest, wraps seen, turns counted from the first sample)
Convention = tuple[float, float, float, float, float]


def begin(measurement: float) -> Convention:
    """The convention after the first sample [rad or m]."""
    return (measurement, measurement, measurement, 0.0, 0.0)


def follow(convention: Convention, measurement: float, period: float) -> Convention:
    """The convention one sample [rad or m] further."""
    last, low, high, wraps, turns = convention
    if low <= measurement <= high and -0.5 * period <= measurement - last < 0.5 * period:
        return (measurement, low, high, wraps, turns)
    if measurement < low:
        low = measurement
    if measurement > high:
        high = measurement
    if period > 0.0:
        change = measurement - last
        whole = (wrap(change, period) - change) / period  # turns that the reading jumped by
        if whole > 0.5 or whole < -0.5:
            wraps += 1.0
            turns += float(round(whole))
    return (measurement, low, high, wraps, turns)


def present(convention: Convention, position: float, period: float, unwrap: float) -> float:
    """The estimated `position` [rad or m] as the measurement would be written.

    Parameters
    ----------
    convention : as of the measurement that made this estimate.
    position : the estimate, any turn.
    period : wrap period [rad]; 0: no circle, the position is published as it is.
    unwrap : 1.0 to count turns from the first sample, else 0.0.
    """
    if period <= 0.0:
        return position
    last, low, high, wraps, turns = convention
    half = 0.5 * period
    shown = position
    if not -half <= position - last < half:
        shown = last + wrap(position - last, period)
    if unwrap > 0.0:
        return shown + turns * period
    if low <= shown <= high:
        return shown  # readings have been there, so it is written as they are
    slack = SLACK * period
    if low < -half - slack or high >= period + slack or (low < -slack and high >= half + slack):
        return shown  # beyond any single interval: multi-turn
    if wraps > 0.0:
        if low < -slack:
            return wrap(shown, period)
        return wrap(shown - half, period) + half
    # Not known yet which edge is the wrap: do not show an estimate past one the shaft has not left.
    for edge in (-half, 0.0, half, period):
        if low >= -slack or edge != 0.0:
            if last < edge <= shown:
                return edge - 1e-9 * period
            if shown < edge <= last:
                return edge
    return shown
