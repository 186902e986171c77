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

from estimator_pkg.observers.angle.edge.constants import ALARM, MEMORY, RATE, SHARE, SIGMAS
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


def follow_band(
    band: Band, z: float, gain: float, idle: float, least: float, slack: float
) -> tuple[float, float, float]:
    """Take an innovation; return (growth of log density, date of a manoeuvre, product).

    Parameters
    ----------
    z : innovation over its standard deviation, at most the alarm.
    gain : the part of it by which the position is corrected.
    idle : time since the last innovation [s].
    least : the density never falls below this.
    slack : of the product: what is left of it where motion is followed best.

    Returns
    -------
    The growth is 0 where it fell; the date [s] is 0 where there is no manoeuvre.
    """
    band.squares += (z * z - band.squares) / MEMORY
    # slow law: C = z m / sqrt(var m), log c += RATE b (C - slack), with b = weight
    weight = SHARE * gain
    product = z * band.low / math.sqrt(band.variance)
    band.low += weight * (z - band.low)
    band.variance = (1.0 - weight) * (1.0 - weight) * band.variance + weight * weight
    move = RATE * weight * (product - slack)
    band.density *= math.exp(move)
    if band.density < least:
        band.density, move = least, 0.0
    # fast law (Page 1954): g = max(0, g + z - SIGMAS), alarm at g > ALARM
    band.quiet += idle
    band.up_time += idle
    band.down_time += idle
    band.up += z - SIGMAS
    band.down -= z + SIGMAS
    date = 0.0
    if band.up > ALARM:
        date = band.up_time
    elif band.down > ALARM:
        date = band.down_time
    if band.up <= 0.0 or date > 0.0:
        band.up = band.up_time = 0.0
    if band.down <= 0.0 or date > 0.0:
        band.down = band.down_time = 0.0
    return move if move > 0.0 else 0.0, date, product


def expect_manoeuvres(band: Band, beyond: float, date: float, most: float) -> None:
    """After a manoeuvre the density expects more of its kind.

    What explains the manoeuvre is spread over the time since the last one.

    Parameters
    ----------
    beyond : deviation that the manoeuvre explains, without what cell and noise may hide [rad].
    date : time since the manoeuvre began [s].
    most : the density is not raised beyond this.
    """
    if beyond > 0.0:
        share = date / max(date, band.quiet)
        explains = min(share * jerk_density(beyond * beyond, date), most)
        band.density = max(band.density, explains)
    band.quiet = 0.0


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
    if product > most:
        product = most
    elif product < -most:
        product = -most
    sway.mean += (product - sway.mean) / MEMORY
    sway.before, sway.last = sway.last, ahead


def began(date: float, dt: float, noisy: bool) -> float:
    """Return how long ago [s] the manoeuvre began whose cumulative sum has run for `date` [s].

    Without noise a deviation is large at once. In noise one that grows as the cube of time is
    `SIGMAS` large at n, if the excess over `SIGMAS` takes m samples more to sum up to the alarm:
    3 SIGMAS/n m^2/2 = ALARM. The two samples that it takes at least are no growth.
    """
    if noisy:
        date += 1.5 * SIGMAS / ALARM * (date / dt - 2.0) * date
    return date + dt
