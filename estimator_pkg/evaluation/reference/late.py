# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Recognise a truth that is late: the lag of a drive's own filter or clock.

Against it the estimates that are late by the same time would be best. The lag is removed only if it
is significant, the same on all joints, and the off-line smoother, which has none, finds it too. A
truth that is early is left alone: then the sensor is late, and so is every estimate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from estimator_pkg.bags.series import Series
from estimator_pkg.evaluation.delay import delay
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.reference.motion import motion
from estimator_pkg.evaluation.reference.reference import Reference

LEAST_LAG = 2e-4  # a shorter lag of the truth does not matter [s]
LAG_SURE = 3.0  # a lag is significant, and lags differ, from this many standard deviations on
LAGS_ALIKE = 0.1  # but not if they differ by less than this fraction
LAG_READINGS = 20_000  # readings that the smoother needs at most


class Lag(NamedTuple):
    """Lag of the truth behind the positions, and its standard deviation [s]."""

    lag: float
    stddev: float


def common_lag(references: Mapping[str, Reference]) -> Lag | None:
    """Return the lag of all joints; None if it is not significant or not the same."""
    found = [
        Lag(each.lag_s, max(each.lag_stddev, 1e-9))
        for each in references.values()
        if math.isfinite(each.lag_s)
    ]
    if not found:
        return None
    weights = [each.stddev**-2 for each in found]
    mean = sum(weight * each.lag for weight, each in zip(weights, found)) / sum(weights)
    stddev = sum(weights) ** -0.5
    same = all(
        abs(each.lag - mean) <= max(LAG_SURE * each.stddev, LAGS_ALIKE * abs(mean), 0.5 * LEAST_LAG)
        for each in found
    )
    return Lag(mean, stddev) if same and mean > max(LEAST_LAG, LAG_SURE * stddev) else None


def confirmed(lag: Lag, truth: Series, measurement: Series, period: float) -> bool:
    """Return True if the truth is as late behind the off-line smoother of the positions.

    Parameters
    ----------
    truth, measurement : of the same joint. period : wrap period [rad]; 0: none.
    """
    first = max(0, (len(measurement.stamps_ns) - LAG_READINGS) // 2)
    part = slice(first, first + LAG_READINGS)
    moved = motion(measurement.stamps_ns[part], measurement.position[part], period)
    if moved is None or moved.seldom or moved.constant:
        return False
    at = match(moved.stamps, truth.stamps_ns, truth.velocity, truth.velocity, 0.0)
    if not len(at.rows):
        return False
    velocity = np.where(moved.firm, moved.velocity, np.nan)[at.rows]
    early = delay(at.time, velocity, at.velocity)
    return abs(early + lag.lag) <= max(LAG_SURE * lag.stddev, LAGS_ALIKE * lag.lag, 0.5 * LEAST_LAG)
