# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The published standard deviation, and the speed that an unchanged reading allows.

The covariance times the mean square of the innovations; and more where a motion may have begun that
no reading has shown yet (docs/observers/edge_adaptive_theory.md, "The standard deviation").
"""

from __future__ import annotations

import math
from collections.abc import Callable

from estimator_pkg.observers.angle.edge.constants import SIGMAS
from estimator_pkg.observers.angle.edge.sensor import Sensor
from estimator_pkg.observers.angle.edge.start import RECENT, doubted, unseen
from estimator_pkg.observers.circle import wrap


def fastest(sensor: Sensor, excess: float) -> float:
    """Return the largest speed [rad/s] that an unchanged reading allows.

    Parameters
    ----------
    excess : by how much the present cell reaches further than a quantum, and to which side [rad].
    """
    quantum, noise, _, _, _, _, change, since, _, _, _ = sensor
    way = (change if change > quantum else quantum) + 2.0 * SIGMAS * math.sqrt(noise)
    return (way + abs(excess)) / since


def make_stddev(
    period: float,
) -> tuple[Callable[..., tuple[float, float]], Callable[..., tuple[float, float]]]:
    """Return `stddev` and `scaled` of the contract's functions, for this wrap period [rad]."""

    def stddev(state: tuple, coefficients: tuple, design: tuple) -> tuple[float, float]:
        return scaled(state, coefficients, design, 1.0)

    def scaled(
        state: tuple, coefficients: tuple, design: tuple, scale: float
    ) -> tuple[float, float]:
        (x, v, a, _), p, band, sensor, _, convention, _, _, doubt, _, _ = state
        p00, _, _, p11, _, _ = p
        _, _, _, up, down, _, _, squares, _ = band
        quantum, noise, _, _, _, _, _, unchanged, _, _, _ = sensor
        reading, low, high, _, _ = convention
        of_doubt, _, _, age, _, _ = doubt
        dt, _, _, _, _, _ = coefficients
        given, _, of_angle, of_speed = design
        starting = 0.0 < age < RECENT
        floor = quantum * quantum / 12.0  # where in its count the encoder changes is not known
        if given == 0.0 and low == high:  # nothing moved: no quantum is known
            return math.inf, math.inf
        variance = p11 * (squares if squares > 0.5 else 0.5)  # at least half of P_11
        if p11 <= 0.0:
            variance, _, _, _, _, _ = doubted(quantum, dt, period, 0.0, 0.0)
        else:
            variance = variance * of_speed + of_doubt
        if up > 0.0 or down > 0.0:  # the cumulative sums doubt it: a motion may begin
            deviation = reading - x
            if deviation + deviation >= period or deviation + deviation < -period:
                deviation = wrap(deviation, period)
            rate = deviation / dt
            if starting or abs(rate) > abs(v):  # it may have begun in the last quarter of a sample
                variance += 16.0 * rate * rate
        if starting:
            variance += unseen(a, quantum, noise, dt, age)
        sigma = math.sqrt(variance)
        if unchanged > 0.0:
            most = fastest(sensor, 0.0)
            if abs(v) > most:  # what the output cuts off, the joint may have lost again
                sigma += abs(v) - most
            sigma = most if sigma > most else sigma
        return math.sqrt(p00 * of_angle + floor if p00 > 0.0 else floor), scale * sigma

    return stddev, scaled
