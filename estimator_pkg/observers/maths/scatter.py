# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The noise variance of a measurement, estimated from its third differences.

A third difference removes position, speed and acceleration. So the estimate does not depend on a
filter's errors, as an estimate from the innovation would. The actual sample times are used.
Differences of zero are left out: at low speed a coarse encoder gives differences of 1, -2, 1 quanta
around each edge and zero between them. Their mean square over 20 is 0.1 quantum^2, near the correct
quantum^2/12.
"""

from __future__ import annotations

from estimator_pkg.observers.circle import wrap

MEMORY = 400.0  # most differences over which the square is averaged
OUTLIER = 25.0  # a square is clamped to this multiple of the mean: outliers are not noise
UNEVEN = 2.0  # differences across sample times that differ by more than this factor are left out
FINEST = 1e-14  # smallest variance [rad^2], finer than any encoder
ZERO = 1e-9  # a smaller third difference [rad] is rounding
FIRST = 1e-6  # initial variance, (1 mrad)^2

# (variance [rad^2], number of differences averaged, last measurement [rad], last rate [rad/s], last
# difference of rates [rad/s^2], the last two sample times [s]; 0: no such sample yet)
Scatter = tuple[float, float, float, float, float, float, float]


def begin_scatter(measurement: float) -> Scatter:
    """Return the scatter after the first sample [rad]."""
    return (FIRST, 1.0, measurement, 0.0, 0.0, 0.0, 0.0)


def resume_scatter(scatter: Scatter, measurement: float) -> Scatter:
    """Return the scatter after a gap: the variance is kept, the differences start again."""
    variance, count, _, _, _, _, _ = scatter
    return (variance, count, measurement, 0.0, 0.0, 0.0, 0.0)


def follow_scatter(scatter: Scatter, measurement: float, dt: float, period: float) -> Scatter:
    """Return the scatter after one more sample [rad].

    Parameters
    ----------
    dt : time since the last sample [s].
    period : wrap period [rad].
    """
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
