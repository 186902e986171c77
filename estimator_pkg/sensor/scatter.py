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

from estimator_pkg.circle import wrap
from estimator_pkg.record import record

VARIANCE_MEMORY = 400.0  # most differences over which the square is averaged
LARGEST_OUTLIER = 25.0  # a square is clamped to this multiple of the mean: outliers are not noise
SAMPLE_TIME_RATIO = 2.0  # differences across sample times that differ by more are left out
LEAST_VARIANCE = 1e-14  # smallest variance [rad^2], finer than any encoder
ZERO = 1e-9  # a smaller third difference [rad] is rounding
INITIAL_VARIANCE = 1e-6  # initial variance, (1 mrad)^2


@record
class Scatter:
    """The variance, and the differences that the next sample continues."""

    variance: float  # [rad^2]
    count: float  # differences averaged
    last: float  # measurement [rad]
    rate: float  # [rad/s]
    acceleration: float  # last difference of rates [rad/s^2]
    before: float  # the last sample time [s]; 0: no such sample yet
    earlier: float  # the one before it [s]


def begin_scatter(scatter: Scatter, measurement: float) -> None:
    """Set the scatter after the first sample [rad]."""
    scatter.variance, scatter.count = INITIAL_VARIANCE, 1.0
    resume_scatter(scatter, measurement)


def resume_scatter(scatter: Scatter, measurement: float) -> None:
    """Continue after a gap: the variance is kept, the differences start again."""
    scatter.last = measurement
    scatter.rate = scatter.acceleration = scatter.before = scatter.earlier = 0.0


def follow_scatter(scatter: Scatter, measurement: float, dt: float, period: float) -> None:
    """Take one more sample [rad].

    Parameters
    ----------
    dt : time since the last sample [s].
    period : wrap period [rad].
    """
    change = measurement - scatter.last
    if change + change >= period or change + change < -period:
        change = wrap(change, period)
    newest, before, earlier = change / dt, scatter.before, scatter.earlier
    curve = 0.0
    if before != 0.0:
        curve = 2.0 * (newest - scatter.rate) / (dt + before)
        if earlier > 0.0 and dt < SAMPLE_TIME_RATIO * before and before < SAMPLE_TIME_RATIO * dt:
            third = (curve - scatter.acceleration) * dt * before * 3.0 * earlier
            third /= dt + before + earlier
            if not -ZERO < third < ZERO:
                average(scatter, 0.05 * third * third)  # 1 + 9 + 9 + 1 = 20 variances
    scatter.last, scatter.rate, scatter.acceleration = measurement, newest, curve
    scatter.earlier, scatter.before = before, dt


def average(scatter: Scatter, square: float) -> None:
    """Average the variance over one more square [rad^2]."""
    if square > LARGEST_OUTLIER * scatter.variance:
        square = LARGEST_OUTLIER * scatter.variance
    if scatter.count < VARIANCE_MEMORY:
        scatter.count += 1.0
    scatter.variance += (square - scatter.variance) / scatter.count
    if scatter.variance < LEAST_VARIANCE:
        scatter.variance = LEAST_VARIANCE
