# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The measurement update: an interval meets the Gaussian of the prediction, and both laws listen.

The equations are those of docs/observers/edge_adaptive_theory.md, "What an edge shows" and "How the
bandwidth moves".
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.bandwidth import (
    Band,
    after_manoeuvre,
    began,
    follow_band,
    sums_alone,
)
from estimator_pkg.observers.angle.edge.constants import (
    ALARM,
    BLUR,
    CALM,
    PLAIN,
    SIGMAS,
    SLACK,
    STRAY,
)
from estimator_pkg.observers.angle.edge.covariance import (
    Covariance,
    corrected,
    jerk_density,
    manoeuvred,
    widened,
)
from estimator_pkg.observers.angle.edge.interval import HELD, interval, within
from estimator_pkg.observers.angle.edge.preference import NOWHERE, Taken
from estimator_pkg.observers.angle.edge.sensor import Sensor, follow_noise, vibration, with_noise

SLIGHT = 0.3  # a rise of the log density by less changes next to nothing of the update
LEAST_PART = 0.05  # of its variance an innovation has at least, were it to count in sigmas
UNBELIEVED = (0.0, 0.0, 0.0)
NOT_TAKEN: Taken = (NOWHERE, 0.0, 0.0, 1.0, False, 0.0, False)


def explained(
    p: Covariance,
    band: Band,
    sensor: Sensor,
    d: float,
    date: float,
    dt: float,
    flickers: bool,
    warm: bool,
) -> tuple[Covariance, Band]:
    """Return covariance and band with a manoeuvre that explains `d` [rad].

    Parameters
    ----------
    date : run time of the cumulative sum that raised the alarm [s].
    flickers, warm : as of `update`.
    """
    quantum, noise, scatter, _, _, _, _, _, _, _, pace = sensor
    noisy = noise > PLAIN * quantum * quantum
    date = max(began(date, dt, noisy), pace)  # readings that come in bursts do not date it
    if flickers:
        p00, _, _, p11, _, _ = p
        if -STRAY * quantum < d < STRAY * quantum and p11 > 0.0:
            # flicker that begins again: it moved in all the time that is remembered
            date = max(date, math.sqrt(p00 / p11))
    elif warm:
        hidden = 0.5 * quantum  # a cell may hide it
        if noisy:
            hidden += SIGMAS * math.sqrt(scatter)
        most = jerk_density(scatter + quantum * quantum, dt)
        band = after_manoeuvre(band, abs(d) - hidden, date, noisy, most)
    return manoeuvred(p, d, date), band


def update(
    news: tuple[int, float, float],
    deviations: tuple[float, float, float],
    p: Covariance,
    band: Band,
    sensor: Sensor,
    flickers: bool,
    idle: float,
    dt: float,
    warm: bool,
) -> tuple[bool, tuple[float, float, float], Covariance, Band, Sensor, Taken]:
    """Return the measurement update for an informative reading.

    Parameters
    ----------
    news : (kind, centre [rad], half width [rad]), what the reading shows; see `interval`.
    deviations : of the cell's centre from the predicted angle, and of the change of the reading
        from the predicted motion; size of the cell [rad]. See `interval`.
    flickers : noise crosses an edge more often than the angle does.
    idle : time since the last informative reading [s].
    warm : the noise is known: the first motion is long ago.

    Returns
    -------
    Whether it is believed, correction of (x, v, a), covariance, band, sensor; the news as taken.
    """
    kind, centre, half = news
    quantum, noise, scatter, _, _, _, _, _, _, lasting, _ = sensor
    p00, _, _, _, _, _ = p
    # the interval meets the Gaussian: S = P_00 + R, the mean d, f = 1 - left
    r = noise + 16.0 * BLUR * BLUR * half * half
    s = p00 + r
    d, left = within(centre, half, math.sqrt(s))
    f = 1.0 - left
    score = d * d / s - f
    z = d / math.sqrt(s * (f if f > LEAST_PART else LEAST_PART))
    beyond = z > ALARM or z < -ALARM
    if beyond:
        z = ALARM if z > 0.0 else -ALARM
    # slow law and fast law: the density is that of the longest memory, or of a vibration, at least
    least = CALM * (quantum * quantum + 12.0 * noise)
    if lasting > 0.0 and warm and not flickers:
        shaken = vibration(sensor)
        if shaken > least:
            least = shaken
    listening, growth, date, product = follow_band(band, z, f * p00 / s, idle, least, SLACK)
    if beyond and date == 0.0 and (d > STRAY * quantum or d < -STRAY * quantum):
        # one sample alone: the sums and their dates alone keep it, for the next to confirm
        return False, UNBELIEVED, p, sums_alone(band, listening), sensor, NOT_TAKEN
    if growth > 0.0:
        p = widened(p, growth)
    if date > 0.0:
        p, listening = explained(p, listening, sensor, d, date, dt, flickers, warm)
    p00, p01, p02, _, _, _ = p
    if date > 0.0 or growth > SLIGHT:  # the same reading is worth more to a vaguer prediction
        off, ahead, size = deviations
        kind, centre, half = interval(off, ahead, size, p00, noise, flickers)
        r = noise + 16.0 * BLUR * BLUR * half * half
        d, left = within(centre, half, math.sqrt(p00 + r))
    s = p00 + r
    # the noise follows the score: flicker shows it from either side alike; elsewhere what is
    # correlated is motion
    _, low, variance, _, _, _, _, _, _ = band
    if low * low < variance if flickers else kind != HELD and (score < 0.0 or product < 1.0):
        most = noise if flickers and scatter < noise else scatter
        likelier = follow_noise(noise, score * noise / s, most, quantum)
        if likelier != noise:
            sensor = with_noise(sensor, likelier)
    ratio = d / s  # K d = P_.0 d/S
    measured = kind != HELD  # that an edge did not come moves the estimate, but is no reading
    taken = (p, s, d, left, measured, growth, date > 0.0)
    if measured:
        p = corrected(p, r, left)
    return True, (p00 * ratio, p01 * ratio, p02 * ratio), p, listening, sensor, taken
