# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The process noise: the density of the jerk, from the innovations alone.

Slow law. With the right process noise the innovations are white, whatever the measurement noise.
So each is multiplied by a low-passed version of those before it, with as long a memory as the
filter itself has: a positive product shows lag, a negative one that the filter follows noise. The
logarithm of the density moves with that product less a slack. A rise widens the covariance at once,
as its steady state goes with the density (P_ij ~ density^((1 + i + j)/6)); after a fall the
covariance narrows by itself.

Fast law. Two cumulative sums, one for each sign, of the innovation less a slack (Page, 1954). Their
run time dates a manoeuvre, and the covariance gets what a blow or a motor makes of the innovation
at hand over that time. Neither can be set off by one sample, which counts no more than the alarm.
Manoeuvres come in series (a ramp begins and ends), so in noise the density then expects the next
one, the more the less time has passed since the one before.

Velocity random walk. The motion beyond the prediction, times the change of the same from one sample
to the next: for the noise of any sensor, for the counts of any constant speed and for the right
process noise its mean is negative or zero. Where it is positive the speed changes at random from
sample to sample, and the covariance of the speed grows by it.

The mean square of the normalised innovations also scales the published standard deviation.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.observers.angle.edge.constants import (
    ADAPTATION_RATE,
    ALARM,
    NOISE_SAMPLES,
    NOISY_ABOVE,
    OUTLIER_QUANTA,
    SHARE,
    SIGMAS,
    SLACK,
)
from estimator_pkg.observers.angle.edge.covariance import add_manoeuvre
from estimator_pkg.record import record
from estimator_pkg.sensor.noise import jerk_density


@record
class ProcessNoise:
    """White jerk, and what the innovations show of its density."""

    density: float  # of the jerk [(rad/s^3)^2 s]
    filtered_innovation: float  # low-passed, normalised
    variance: float  # of that, were it white
    cusum_positive: float  # sum of innovations above the slack
    cusum_negative: float  # of those below its negative
    up_time: float  # run time of either [s]
    down_time: float
    mean_nis: float  # mean normalised innovation squared
    time_since_manoeuvre: float  # or since the start [s]


@record
class VelocityRandomWalk:
    """Whether the speed changes at random from sample to sample."""

    mean: float  # mean product of a deviation and the change of the one before [rad^2]
    last: float  # motion beyond the prediction [rad]
    before: float  # the same one sample before


def reset_process_noise(process: ProcessNoise, density: float) -> None:
    """Set the process noise of a start; density of the jerk [(rad/s^3)^2 s]."""
    process.density = density
    process.mean_nis = 1.0
    process.time_since_manoeuvre = 0.0
    reset_cusum(process)


def reset_cusum(process: ProcessNoise) -> None:
    """Forget the innovations so far, except for their mean square."""
    process.filtered_innovation, process.variance = 0.0, 1.0
    reset_sums(process)


def reset_sums(process: ProcessNoise) -> None:
    """Set both cumulative sums to zero."""
    process.cusum_positive = process.cusum_negative = process.up_time = process.down_time = 0.0


def reset_velocity_walk(walk: VelocityRandomWalk) -> None:
    """Forget the motion beyond the prediction."""
    walk.mean = walk.last = walk.before = 0.0


def update_cusum(process: ProcessNoise, z: float, idle: float) -> float:
    """Take an innovation of `z` standard deviations; return the date of a manoeuvre [s], or 0.

    Fast law (Page 1954): g = max(0, g + z - SIGMAS), alarm at g > ALARM.

    Parameters
    ----------
    idle : time since the last innovation [s].
    """
    process.time_since_manoeuvre += idle
    process.up_time += idle
    process.down_time += idle
    process.cusum_positive += z - SIGMAS
    process.cusum_negative -= z + SIGMAS
    date = 0.0
    if process.cusum_positive > ALARM:
        date = process.up_time
    elif process.cusum_negative > ALARM:
        date = process.down_time
    if process.cusum_positive <= 0.0 or date > 0.0:
        process.cusum_positive = process.up_time = 0.0
    if process.cusum_negative <= 0.0 or date > 0.0:
        process.cusum_negative = process.down_time = 0.0
    return date


def adapt_process_noise(
    process: ProcessNoise, z: float, gain: float, least: float
) -> tuple[float, float]:
    """Take an innovation of `z` standard deviations; return (growth of log density, product).

    Slow law: C = z m / sqrt(var m), log c += RATE b (C - SLACK), with b = weight.

    Parameters
    ----------
    gain : the part of the innovation by which the position is corrected.
    least : the density never falls below this.

    Returns
    -------
    The growth is 0 where the density fell.
    """
    process.mean_nis += (z * z - process.mean_nis) / NOISE_SAMPLES
    weight = SHARE * gain
    product = z * process.filtered_innovation / math.sqrt(process.variance)
    process.filtered_innovation += weight * (z - process.filtered_innovation)
    process.variance = (1.0 - weight) * (1.0 - weight) * process.variance + weight * weight
    move = ADAPTATION_RATE * weight * (product - SLACK)
    process.density *= math.exp(move)
    if process.density < least:
        process.density, move = least, 0.0
    return move if move > 0.0 else 0.0, product


def inflate_for_manoeuvre(state: Any, d: float, date: float, dt: float, flickers: bool) -> None:
    """Inflate the covariance for a manoeuvre that explains `d` [rad], and expect more of its kind.

    Without noise a deviation is large at once. In noise one that grows as the cube of time is
    `SIGMAS` large at n, if the excess over `SIGMAS` takes m samples more to sum up to the alarm:
    3 SIGMAS/n m^2/2 = ALARM. The two samples that it takes at least are no growth.

    What explains the manoeuvre is spread over the time since the last one.

    Parameters
    ----------
    date : run time of the cumulative sum that raised the alarm [s].
    flickers : noise crosses an edge more often than the angle does.
    """
    p, process, sensor = state.p, state.process_noise, state.sensor
    square = sensor.quantum * sensor.quantum
    noisy = sensor.noise > NOISY_ABOVE * square
    if noisy:
        date += 1.5 * SIGMAS / ALARM * (date / dt - 2.0) * date
    date += dt
    if flickers:
        most = OUTLIER_QUANTA * sensor.quantum
        if -most < d < most and p.p11 > 0.0:
            # flicker that begins again: it moved in all the time that is remembered
            date = max(date, math.sqrt(p.p00 / p.p11))
    elif state.reading.noise_known:
        # without what cell and noise may hide; where edges are times the next is news anyway
        hidden = 0.5 * sensor.quantum + SIGMAS * math.sqrt(sensor.noise_bound)
        beyond = abs(d) - hidden
        if noisy and beyond > 0.0:
            share = date / max(date, process.time_since_manoeuvre)
            explains = share * jerk_density(beyond * beyond, date)
            explains = min(explains, jerk_density(sensor.noise_bound + square, dt))
            process.density = max(process.density, explains)
        process.time_since_manoeuvre = 0.0
    add_manoeuvre(p, d, date)


def update_velocity_walk(
    walk: VelocityRandomWalk, unpredicted: float, most: float, believed: bool
) -> None:
    """Take a reading that moved by `unpredicted` [rad] beyond the prediction.

    Parameters
    ----------
    most : no product counts more than this, of either sign [rad^2].
    believed : so was the reading before. Else nothing is learnt from what moved since then.

    Notes
    -----
    With r the deviation, E[r (r' - r'')] of white noise of variance s^2 is -s^2. For a constant
    speed whose counts per sample differ by f from a whole number, 0 <= f <= 1/2, it is 0, and
    1 - 3 f where f is above 1/3 [counts^2]. For a speed that goes at random by u in a sample, and a
    filter that does not follow, it is u^2/2. In a mean over 32 samples white noise comes above
    2 s^2, five of its standard deviations away, by no chance to speak of; so less is not believed.
    """
    if not believed:
        walk.last = walk.before = 0.0
        return
    product = unpredicted * (walk.last - walk.before)
    product = most if product > most else -most if product < -most else product
    walk.mean += (product - walk.mean) / NOISE_SAMPLES
    walk.before, walk.last = walk.last, unpredicted
