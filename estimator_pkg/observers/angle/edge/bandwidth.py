# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How fast the observer listens: the density of the jerk, from the innovations alone.

Slow law. The innovations of a filter that listens at the right rate are white, whatever the noise.
So each is multiplied by a low-passed version of those before it, as long a memory as the filter
itself has: positive says it lags, negative that it follows noise. The logarithm of the density
moves with that product less a slack. A rise widens the covariance at once, as its steady state
goes with the density (P_ij ~ density^((1 + i + j)/6)); after a fall the covariance narrows by
itself.

Fast law. Two cumulative sums, one for each sign, of the innovation less a slack (Page, 1954). Their
run time dates a manoeuvre, and the covariance gets what a blow or a motor makes of the innovation
at hand over that time. Neither can be set off by one sample, which counts no more than the alarm.
Manoeuvres come in series (a ramp begins and ends), so in noise the density then expects the next
one, the more the less time has passed since the one before.

Sway. What the readings moved by beyond the prediction, times the change of the same from one sample
to the next: for the noise of any sensor, for the counts of any constant speed and for a filter that
listens at the right rate its mean is negative or nothing. Where it is positive the speed changes at
random from sample to sample, and that is what the covariance of the speed gets.

The mean square of the normalised innovations also scales the published standard deviation.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.observers.angle.edge.constants import (
    ALARM,
    NOISE_SAMPLES,
    PLAIN,
    RATE,
    SHARE,
    SIGMAS,
    SLACK,
    STRAY,
)
from estimator_pkg.observers.angle.edge.covariance import add_manoeuvre
from estimator_pkg.record import record
from estimator_pkg.sensor.noise import jerk_density


@record
class Band:
    """How fast the observer listens."""

    density: float  # of the jerk [(rad/s^3)^2 s]
    low: float  # low-passed innovation
    variance: float  # of that, were it white
    up: float  # cumulative sum of positive innovations
    down: float  # of negative ones
    up_time: float  # run time of either [s]
    down_time: float
    squares: float  # mean square of the innovations, over their variance
    quiet: float  # time since the last manoeuvre, or the start [s]


@record
class Sway:
    """Whether the speed goes at random."""

    mean: float  # mean product of a deviation and the change of the one before [rad^2]
    last: float  # what it moved by beyond the prediction [rad]
    before: float  # the same one sample before


def begin_band(band: Band, density: float) -> None:
    """Set the band of a start, with this density of the jerk [(rad/s^3)^2 s]."""
    band.density = density
    band.squares = 1.0
    band.quiet = 0.0
    begin_sums(band)


def begin_sums(band: Band) -> None:
    """Forget the innovations so far, but for their size."""
    band.low = band.up = band.down = band.up_time = band.down_time = 0.0
    band.variance = 1.0


def forget_sway(sway: Sway) -> None:
    """Forget what the readings moved by beyond the prediction."""
    sway.mean = sway.last = sway.before = 0.0


def follow_sums(band: Band, z: float, idle: float) -> float:
    """Take an innovation of `z` standard deviations; return the date of a manoeuvre [s], or 0.

    Fast law (Page 1954): g = max(0, g + z - SIGMAS), alarm at g > ALARM.

    Parameters
    ----------
    idle : time since the last innovation [s].
    """
    band.quiet += idle
    band.up_time += idle
    band.down_time += idle
    band.up += z - SIGMAS
    band.down -= z + SIGMAS
    date = band.up_time if band.up > ALARM else band.down_time if band.down > ALARM else 0.0
    if band.up <= 0.0 or date > 0.0:
        band.up = band.up_time = 0.0
    if band.down <= 0.0 or date > 0.0:
        band.down = band.down_time = 0.0
    return date


def follow_band(band: Band, z: float, gain: float, least: float) -> tuple[float, float]:
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
    band.squares += (z * z - band.squares) / NOISE_SAMPLES
    weight = SHARE * gain
    product = z * band.low / math.sqrt(band.variance)
    band.low += weight * (z - band.low)
    band.variance = (1.0 - weight) * (1.0 - weight) * band.variance + weight * weight
    move = RATE * weight * (product - SLACK)
    band.density *= math.exp(move)
    if band.density < least:
        band.density, move = least, 0.0
    return move if move > 0.0 else 0.0, product


def explain(state: Any, d: float, date: float, dt: float, flickers: bool) -> None:
    """Explain an innovation of `d` [rad] by a manoeuvre, and expect more of its kind.

    Without noise a deviation is large at once. In noise one that grows as the cube of time is
    `SIGMAS` large at n, if the excess over `SIGMAS` takes m samples more to sum up to the alarm:
    3 SIGMAS/n m^2/2 = ALARM. The two samples that it takes at least are no growth.

    What explains the manoeuvre is spread over the time since the last one.

    Parameters
    ----------
    date : run time of the cumulative sum that raised the alarm [s].
    flickers : noise crosses an edge more often than the angle does.
    """
    p, band, sensor = state.p, state.band, state.sensor
    square = sensor.quantum * sensor.quantum
    noisy = sensor.noise > PLAIN * square
    if noisy:
        date += 1.5 * SIGMAS / ALARM * (date / dt - 2.0) * date
    date += dt
    if flickers:
        most = STRAY * sensor.quantum
        if -most < d < most and p.p11 > 0.0:
            # flicker that begins again: it moved in all the time that is remembered
            date = max(date, math.sqrt(p.p00 / p.p11))
    elif state.reading.warm:
        # without what cell and noise may hide; where edges are times the next is news anyway
        hidden = 0.5 * sensor.quantum + SIGMAS * math.sqrt(sensor.noise_bound)
        beyond = abs(d) - hidden
        if noisy and beyond > 0.0:
            explains = date / max(date, band.quiet) * jerk_density(beyond * beyond, date)
            explains = min(explains, jerk_density(sensor.noise_bound + square, dt))
            band.density = max(band.density, explains)
        band.quiet = 0.0
    add_manoeuvre(p, d, date)


def follow_sway(sway: Sway, ahead: float, most: float, believed: bool) -> None:
    """Take a reading that moved by `ahead` [rad] beyond the prediction.

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
        sway.last = sway.before = 0.0
        return
    product = ahead * (sway.last - sway.before)
    product = most if product > most else -most if product < -most else product
    sway.mean += (product - sway.mean) / NOISE_SAMPLES
    sway.before, sway.last = sway.last, ahead
