"""The noise of a measurement, seen in its third differences whatever the motion.

A third difference removes position, speed and acceleration, so that the estimate does not feed on
a filter's own errors, as one from the innovation would. It is divided by the true sample times.
Differences of zero are left out: a coarse encoder at creep shows 1, -2, 1 quanta around each edge
and nothing between, and the mean square of these over 20 is 0.1 quantum^2, near the 1/12 that is
right.
"""

from __future__ import annotations

from estimator_pkg.observers.circle import wrap

MEMORY = 400.0  # differences that the mean square averages at most
OUTLIER = 25.0  # a square counts at most so many times the mean: an outlier is no noise
UNEVEN = 2.0  # sample times that differ by more than this factor are left out
FINEST = 1e-14  # the least variance [rad^2], finer than any encoder
ZERO = 1e-9  # a third difference below it [rad] is rounding
FIRST = 1e-6  # before anything was seen: (1 mrad)^2

# (variance [rad^2], differences it averages, last measurement [rad], last rate [rad/s], last
# difference of rates [rad/s^2], the two sample times before [s]; a time of 0: not yet)
Scatter = tuple[float, float, float, float, float, float, float]


def begin_scatter(measurement: float) -> Scatter:
    """Return the scatter after the first sample [rad]."""
    return (FIRST, 1.0, measurement, 0.0, 0.0, 0.0, 0.0)


def resume_scatter(scatter: Scatter, measurement: float) -> Scatter:
    """Return the scatter after a gap: what is known is kept, the differences start again."""
    variance, count, _, _, _, _, _ = scatter
    return (variance, count, measurement, 0.0, 0.0, 0.0, 0.0)


def follow_scatter(scatter: Scatter, measurement: float, dt: float, period: float) -> Scatter:
    """Return the scatter one sample [rad] and dt [s] further, on a circle of `period` [rad]."""
    variance, count, last, rate, bend, before, earlier = scatter
    change = measurement - last
    if change + change >= period or change + change < -period:
        change = wrap(change, period)
    newest = change / dt
    if before == 0.0:
        return (variance, count, measurement, newest, 0.0, dt, 0.0)
    curve = 2.0 * (newest - rate) / (dt + before)
    if earlier > 0.0 and dt < UNEVEN * before and before < UNEVEN * dt:
        third = (curve - bend) * dt * before * 3.0 * earlier / (dt + before + earlier)
        if not -ZERO < third < ZERO:
            square = 0.05 * third * third  # 1 + 9 + 9 + 1 = 20 variances
            if square > OUTLIER * variance:
                square = OUTLIER * variance
            if count < MEMORY:
                count += 1.0
            variance += (square - variance) / count
            if variance < FINEST:
                variance = FINEST
    return (variance, count, measurement, newest, curve, dt, before)
