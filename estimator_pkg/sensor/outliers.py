# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Readings that are not those of the shaft: glitches, and flips of a symmetric sensor.

A reading is not believed if it is much further from the expected one than innovations were of late,
and no joint changes its speed so much within a sample. The expected reading is taken in its place,
and the standard deviation covers both. The next reading is believed, so that a sensor that slips on
its shaft costs one sample. An impact, which stops a joint or turns its speed round, is believed at
once. A second reading that is off by half a turn is a pose of a symmetric set of markers that
flipped, or a magnet read upside down: the half turn is taken out.
"""

from __future__ import annotations

from estimator_pkg.circle import wrap
from estimator_pkg.record import record

OUTLIER_GATE = 400.0  # (20)^2: times the power of recent innovations; a reading beyond is doubted
BOUNCE = 2.0  # times the way expected within the sample: an impact turns the speed round at most
LARGEST_SPEED_CHANGE = 30.0  # [rad/s] no joint is faster by more, one sample later
PATIENCE = 0.1  # [s] for which a doubted reading that repeats is waited for


@record
class Outliers:
    """Whether the newest readings are as expected."""

    far: int  # how many in a row were not; the first of them is not believed
    off: float  # how far the last of them was from the expected one [rad]
    reading: float  # the last of them [rad]
    waited: float  # for which it has repeated [s]


def believed(
    doubt: Outliers,
    measurement: float,
    expected: float,
    ahead: float,
    dt: float,
    power: float,
    period: float,
) -> float:
    """Return the reading [rad], or what is to be taken in its place.

    Parameters
    ----------
    expected : reading [rad]; `ahead` of it is the way since the last sample.
    dt : that time [s].
    power : of an innovation that is no surprise [rad^2].
    period : wrap period [rad]; 0: none.
    """
    off = wrap(measurement - expected, period)
    square = off * off
    least = LARGEST_SPEED_CHANGE * dt + (BOUNCE * abs(ahead) if off * ahead < 0.0 else 0.0)
    if square <= OUTLIER_GATE * power or -least <= off <= least:
        doubt.far = 0
        return measurement
    repeats = doubt.far > 0 and measurement == doubt.reading
    if repeats and ahead * ahead > power and doubt.waited < PATIENCE:
        doubt.waited += dt
        return expected  # an equal reading of a joint that moves confirms nothing
    doubt.far += 1
    doubt.off, doubt.reading, doubt.waited = off, measurement, 0.0
    if doubt.far == 1:
        return expected
    if period > 0.0:
        flipped = wrap(off + 0.5 * period, period)
        if flipped * flipped <= OUTLIER_GATE * power:
            return expected + flipped
    return measurement
