# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The measurement update: an interval meets the Gaussian of the prediction, and both laws listen.

The equations are those of docs/observers/edge_adaptive_theory.md, "What an edge shows" and "How the
bandwidth moves".
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.observers.angle.edge.bandwidth import Band, began, expect_manoeuvres, follow_band
from estimator_pkg.observers.angle.edge.constants import (
    ALARM,
    BLUR,
    CALM,
    PLAIN,
    SIGMAS,
    SLACK,
    STRAY,
)
from estimator_pkg.observers.angle.edge.covariance import add_manoeuvre, correct_covariance, widen
from estimator_pkg.observers.angle.edge.interval import HELD, INTERVAL, interval, within
from estimator_pkg.observers.angle.edge.preference import inform_other
from estimator_pkg.observers.angle.edge.start import doubt_overdue
from estimator_pkg.observers.maths.covariance import Covariance
from estimator_pkg.sensor.noise import Sensor, follow_noise, jerk_density, vibration

SLIGHT = 0.3  # a rise of the log density by less changes next to nothing of the update
LEAST_PART = 0.05  # of its variance an innovation has at least, were it to count in sigmas


def explain(
    p: Covariance,
    band: Band,
    sensor: Sensor,
    d: float,
    date: float,
    dt: float,
    flickers: bool,
    warm: bool,
) -> None:
    """Explain an innovation of `d` [rad] by a manoeuvre.

    Parameters
    ----------
    date : run time of the cumulative sum that raised the alarm [s].
    flickers : as of `update`. warm : the noise is known: the first motion is long ago.
    """
    quantum = sensor.quantum
    noisy = sensor.noise > PLAIN * quantum * quantum
    date = max(began(date, dt, noisy), sensor.pace)  # readings that come in bursts do not date it
    if flickers:
        if -STRAY * quantum < d < STRAY * quantum and p.p11 > 0.0:
            # flicker that begins again: it moved in all the time that is remembered
            date = max(date, math.sqrt(p.p00 / p.p11))
    elif warm:
        hidden = 0.5 * quantum + SIGMAS * math.sqrt(sensor.scatter)
        most = jerk_density(sensor.scatter + quantum * quantum, dt)
        # where edges are times the next manoeuvre is news anyway
        expect_manoeuvres(band, abs(d) - hidden if noisy else 0.0, date, most)
    add_manoeuvre(p, d, date)


def update(
    state: Any,
    design: Any,
    kind: int,
    centre: float,
    half: float,
    off: float,
    size: float,
    flickers: bool,
    dt: float,
) -> bool:
    """Take an informative reading; return False if it is not believed.

    Parameters
    ----------
    kind, centre, half : what the reading shows: centre less prediction, and half width [rad]; see
        `interval`.
    off, size : distance of the cell's centre from the predicted angle, and its size [rad].
    flickers : noise crosses an edge more often than the angle does.
    """
    motion, p, band, sensor = state.motion, state.p, state.band, state.sensor
    warm = state.reading.warm
    quantum, noise, held = sensor.quantum, sensor.noise, kind == HELD
    # the interval meets the Gaussian: S = P_00 + R, the mean d, f = 1 - left
    r = noise + 16.0 * BLUR * BLUR * half * half
    s = p.p00 + r
    d, left = within(centre, half, math.sqrt(s))
    f = 1.0 - left
    score = d * d / s - f
    z = d / math.sqrt(s * (f if f > LEAST_PART else LEAST_PART))
    beyond = z > ALARM or z < -ALARM
    if beyond:
        z = ALARM if z > 0.0 else -ALARM
    # slow law and fast law: the density is that of the longest memory, or of a vibration, at least
    least = CALM * (quantum * quantum + 12.0 * noise)
    if sensor.lasting > 0.0 and warm and not flickers:
        least = max(least, vibration(sensor))
    density, low, variance, squares = band.density, band.low, band.variance, band.squares
    growth, date, product = follow_band(band, z, f * p.p00 / s, motion.idle, least, SLACK)
    motion.idle = 0.0
    if beyond and date == 0.0 and (d > STRAY * quantum or d < -STRAY * quantum):
        # one sample alone: the sums and their dates alone keep it, for the next to confirm
        band.density, band.low, band.variance, band.squares = density, low, variance, squares
        return False
    if growth > 0.0:
        widen(p, growth)
    if date > 0.0:
        explain(p, band, sensor, d, date, dt, flickers, warm)
        # the whole cell is news to a prediction that is so vague now
        kind, half = INTERVAL, 0.5 * size
        r = noise + 16.0 * BLUR * BLUR * half * half
        d, left = within(off, half, math.sqrt(p.p00 + r))
    elif growth > SLIGHT:  # the same reading is worth more to a vaguer prediction
        ahead = state.reading.ahead
        kind, centre, half = interval(off, ahead, size, p.p00, noise, flickers)
        r = noise + 16.0 * BLUR * BLUR * half * half
        d, left = within(centre, half, math.sqrt(p.p00 + r))
    s = p.p00 + r
    # the noise follows the score: flicker shows it from either side alike; elsewhere what is
    # correlated is motion
    white = low * low < variance
    if white if flickers else kind != HELD and (score < 0.0 or product < 1.0):
        most = noise if flickers and sensor.scatter < noise else sensor.scatter
        sensor.noise = follow_noise(noise, score * noise / s, most, quantum)
    manoeuvre, measured = date > 0.0, kind != HELD  # that no edge came moves the estimate only
    ratio = d / s  # K d = P_.0 d/S
    if held:
        doubt_overdue(state.doubt, p.p01 * ratio)
    if design.ratio != 1.0:
        inform_other(state.other, p, s, d, left, measured, growth, manoeuvre, design.log_ratio)
    state.reading.off -= p.p00 * ratio
    motion.velocity += p.p01 * ratio
    motion.acceleration += p.p02 * ratio
    if measured:
        correct_covariance(p, r, left)
    return True
