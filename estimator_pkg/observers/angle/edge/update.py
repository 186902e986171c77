# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The measurement update: an interval meets the Gaussian of the prediction; both laws adapt.

The equations are those of docs/observers/edge_adaptive_theory.md, "Measurement update" and "Process
noise".
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.observers.angle.edge import bandwidth, covariance, preference
from estimator_pkg.observers.angle.edge import interval as cells
from estimator_pkg.observers.angle.edge.constants import (
    ALARM,
    LEAST_JERK_DENSITY,
    NOISY_ABOVE,
    OUTLIER_QUANTA,
)
from estimator_pkg.observers.angle.edge.start import inflate_for_missing_edge
from estimator_pkg.sensor.noise import follow_noise, vibration


def update(state: Any, design: Any, flickers: bool, dt: float) -> bool:
    """Update by what a reading shows of the angle; return False if it is not believed.

    Parameters
    ----------
    flickers : noise crosses an edge more often than the angle does.
    """
    motion, p, process, sensor = state.motion, state.p, state.process_noise, state.sensor
    quantum, noise = sensor.quantum, sensor.noise
    innovation, unpredicted = state.reading.innovation, state.reading.unpredicted_motion
    kind, centre, half = cells.interval(innovation, unpredicted, quantum, p.p00, noise, flickers)
    if kind == cells.NO_INFORMATION:
        return True
    held = kind == cells.MISSING_EDGE
    # the interval, either end of which may be wrong, meets the Gaussian: S = P_00 + R, mean d
    r = noise + NOISY_ABOVE * (2.0 * half) * (2.0 * half)
    s = p.p00 + r
    d, left = cells.within(centre, half, math.sqrt(s))
    f = 1.0 - left
    score = d * d / s - f
    z = d / math.sqrt(s * (f if f > cells.THIN else cells.THIN))
    beyond = z > ALARM or z < -ALARM
    if beyond:
        z = ALARM if z > 0.0 else -ALARM
    date = bandwidth.update_cusum(process, z, motion.idle)
    motion.idle = 0.0
    if beyond and date == 0.0 and abs(d) > OUTLIER_QUANTA * quantum:
        return False  # one sample alone: the next one decides
    white = process.filtered_innovation * process.filtered_innovation < process.variance
    # the density is that of the longest memory, or of a vibration, at least
    least = LEAST_JERK_DENSITY * (quantum * quantum + 12.0 * noise)
    if sensor.vibration_power > 0.0 and state.reading.noise_known and not flickers:
        least = max(least, vibration(sensor))
    growth, product = bandwidth.adapt_process_noise(process, z, f * p.p00 / s, least)
    if growth > 0.0:
        covariance.widen(p, growth)
    if date > 0.0:  # the same reading is worth more to a vaguer prediction
        bandwidth.inflate_for_manoeuvre(state, d, date, dt, flickers)
        kind, centre, half = cells.MEASURED, innovation, 0.5 * quantum  # the whole cell
        r = noise + NOISY_ABOVE * (2.0 * half) * (2.0 * half)
        d, left = cells.within(centre, half, math.sqrt(p.p00 + r))
    s = p.p00 + r
    # the noise follows the score: flicker shows it from either side alike; elsewhere what is
    # correlated is motion
    if white if flickers else kind != cells.MISSING_EDGE and (score < 0.0 or product < 1.0):
        most = noise if flickers and sensor.noise_bound < noise else sensor.noise_bound
        sensor.noise = follow_noise(noise, score * noise / s, most, quantum)
    measured = kind != cells.MISSING_EDGE  # that no edge came moves the estimate only
    ratio = d / s  # K d = P_.0 d/S
    if held:
        inflate_for_missing_edge(state.uncertainty, p.p01 * ratio)
    if design.ratio != 1.0:
        preference.correct_second_filter(state, design, s, d, left, measured, growth, date > 0.0)
    state.reading.innovation -= p.p00 * ratio
    motion.velocity += p.p01 * ratio
    motion.acceleration += p.p02 * ratio
    if measured:
        covariance.correct_covariance(p, r, left)
    return True
