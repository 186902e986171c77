# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The published standard deviation, and the speed that an unchanged reading allows.

The covariance times the mean square of the innovations; and more where a motion may have begun that
no reading has shown yet (docs/observers/edge_adaptive_theory.md, "Standard deviation").
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.circle import wrap
from estimator_pkg.estimate import Deviation
from estimator_pkg.observers.angle.edge.constants import LONGEST_MEMORY, SIGMAS
from estimator_pkg.observers.angle.edge.start import START_DURATION, start_variance, unknown_speed
from estimator_pkg.sensor.noise import Sensor


def fastest(sensor: Sensor) -> float:
    """Return the largest speed [rad/s] that an unchanged reading allows."""
    quantum = sensor.quantum
    way = (sensor.size if sensor.size > quantum else quantum) + 2.0 * SIGMAS * math.sqrt(
        sensor.noise
    )
    return way / sensor.since


def deviation(
    observer: Any, out: Deviation, state: Any, coefficients: Any, design: Any, scale: float
) -> None:
    """Set one standard deviation of position and velocity, the latter times `scale`."""
    motion, p, sensor = state.motion, state.p, state.sensor
    process, uncertainty = state.process_noise, state.uncertainty
    convention, quantum = state.convention, sensor.quantum
    dt, speed = coefficients.dt, motion.velocity
    if design.quantum == 0.0 and convention.low == convention.high:  # nothing moved: no quantum
        out.position = out.velocity = math.inf
        return
    starting = 0.0 < uncertainty.age < START_DURATION
    # at least half of P_11
    variance = p.p11 * (process.mean_nis if process.mean_nis > 0.5 else 0.5)
    if p.p11 <= 0.0:
        variance = unknown_speed(quantum, dt)
    else:
        variance = variance * design.of_speed + uncertainty.variance
    if process.cusum_positive > 0.0 or process.cusum_negative > 0.0:  # a motion may begin
        innovation = convention.last - motion.angle
        if innovation + innovation >= design.period or innovation + innovation < -design.period:
            innovation = wrap(innovation, design.period)
        rate = innovation / dt
        if starting or abs(rate) > abs(speed):  # it may have begun half a sample ago
            variance += (2.0 * rate) * (2.0 * rate)
    if starting:
        variance += start_variance(state, dt)
    # the shorter the density has been learnt since a manoeuvre, the less it is known
    learnt = 0.25 * LONGEST_MEMORY + process.time_since_manoeuvre
    variance += variance * LONGEST_MEMORY / learnt
    sigma = math.sqrt(variance)
    if sensor.since > 0.0:
        most = fastest(sensor)
        if abs(speed) > most:  # what the output cuts off, the joint may have lost again
            sigma += abs(speed) - most
        # a parabola that stays within a quantum ends at most four quanta in that time steeper
        sigma = min(sigma, 4.0 * most)
    floor = quantum * quantum / 12.0  # where in its count the encoder changes is not known
    out.position = math.sqrt(p.p00 * design.of_angle + floor if p.p00 > 0.0 else floor)
    out.velocity = scale * sigma
