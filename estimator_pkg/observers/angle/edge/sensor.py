# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The sensor as its readings show it: the noise above its quantum, and a vibration.

The noise is seen in the change of the residual of linear interpolation between every second
reading, which is a third difference divided by the true sample times: position, speed and
acceleration are gone from it. Where one such difference has the sign of the one before, it is no
noise, which alternates, but a vibration of a few samples' period.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.constants import BLUR, MEMORY
from estimator_pkg.observers.angle.edge.covariance import jerk_density

OUTLIER = 25.0  # largest weight of a square, in its expected value: 5 sigma
# third differences after one wrong reading, over the one before each; how near one must be to it
ALONE, NEAR = (-3.0, -1.0, -1.0 / 3.0), 0.25
LASTING = 4.0 / 11.0  # third differences are twice the changes of the residual; 3 + 8, see below
# (quantum in use [rad]; noise: variance of the edges, without the quantum's own [rad^2]; scatter:
# mean square of third differences over 20 [rad^2]; residual, step [rad] and dt [s] of the sample
# before, dt 0: none; size of the last change of the reading [rad], 0: none, and time since it
# [s]; change of the residual one sample before [rad], inf: none; square of the third differences
# that last [rad^2], negative where they alternate; mean dt [s])
Sensor = tuple[float, float, float, float, float, float, float, float, float, float, float]


def begin_sensor(quantum: float) -> Sensor:
    """Return the sensor before anything was seen."""
    return (
        quantum,
        BLUR * BLUR * quantum * quantum,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        math.inf,
        0.0,
        0.0,
    )


def first_step(quantum: float, step: float, dt: float) -> Sensor:
    """Return the sensor as after the first `step` [rad], in a sample of `dt` [s]."""
    return (
        quantum,
        BLUR * BLUR * quantum * quantum,
        0.0,
        0.0,
        step,
        dt,
        abs(step),
        0.0,
        math.inf,
        0.0,
        0.0,
    )


def with_noise(sensor: Sensor, noise: float) -> Sensor:
    """Return the sensor with another noise [rad^2]."""
    quantum, _, scatter, residual, step, dt, change, since, bend, lasting, pace = sensor
    return (quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, pace)


def aged(sensor: Sensor, v: float) -> Sensor:
    """Return a sensor whose readings are up to one sample old, at the speed `v` [rad/s].

    The age is uniform, so the noise is at least (v dt)^2/12. It repeats like a sawtooth, of which
    third differences see the teeth alone.
    """
    quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, pace = sensor
    age = v * v * pace * pace / 12.0
    noise = age if noise < age else noise
    scatter = age if scatter < age else scatter
    return (quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, pace)


def paced(sensor: Sensor, pace: float) -> Sensor:
    """Return the sensor with another mean sample time [s]."""
    quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, _ = sensor
    return (quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, pace)


def follow_sensor(
    sensor: Sensor, step: float, counted: float, dt: float, quantum: float, believed: float
) -> Sensor:
    """Return the sensor one sample further: the reading moved by `step` [rad] in `dt` [s].

    Parameters
    ----------
    counted : the step as read, without a correction of the reading [rad].
    quantum : to reckon with from now on [rad].
    believed : readings since one that was not; 3 or more: that is in no third difference.

    Notes
    -----
    The mean of 3 T'^2 + 8 T T', T being a third difference and T' the one before, is 11 T^2 where
    T lasts, -60 sigma^2 for white noise, and not above 0 for the readings of any constant speed,
    however it beats with the sampling (a larger share than 3 would not have that). What the noise
    and the quantum may add by chance is taken off.
    """
    used, noise, scatter, residual, last, before, change, since, bend, lasting, pace = sensor
    square = quantum * quantum
    if before > 0.0:
        third = (step * before - last * dt) / (dt + before) - residual
        residual += third
        if bend == math.inf:
            bend, lasting, pace = 0.0, -square, pace if pace > 0.0 else dt
        else:
            power = 0.2 * third * third
            most = OUTLIER * (scatter + square)
            if believed < 3.0:
                alone = ALONE[int(believed)] * bend
                if abs(third - alone) < NEAR * abs(alone):  # a glitch is no noise
                    most = scatter + square
            scatter += ((power if power < most else most) - scatter) / MEMORY
            power = LASTING * bend * (3.0 * bend + 8.0 * third) - square / 12.0 - noise
            lasting += ((power if power < most else most) - lasting) / MEMORY
            pace += (dt - pace) / MEMORY
            bend = third
    if noise < scatter - square:  # more than any quantisation makes: it is noise
        noise = scatter - square
    elif quantum != used:
        noise = BLUR * BLUR * square
    if step == 0.0:
        return (
            quantum,
            noise,
            scatter,
            residual,
            step,
            dt,
            change,
            since + dt,
            bend,
            lasting,
            pace,
        )
    return quantum, noise, scatter, residual, step, dt, abs(counted), 0.0, bend, lasting, pace


def vibration(sensor: Sensor) -> float:
    """Return the density of white jerk [(rad/s^3)^2 s] that makes the third differences that last.

    Within a sample it adds their square to the variance of the predicted angle: so far off is what
    is extrapolated with an acceleration. 0: there is nothing but noise.
    """
    _, _, _, _, _, _, _, _, _, lasting, pace = sensor
    if lasting <= 0.0:
        return 0.0
    return jerk_density(lasting, pace)


def follow_noise(noise: float, excess: float, scatter: float, quantum: float) -> float:
    """Return the noise [rad^2] made likelier.

    Twofold in one sample at most; never above the scatter, which is no motion, and never below the
    `BLUR`.

    Parameters
    ----------
    excess : score of the innovation variance, times the noise [rad^2].
    """
    noise += noise * (excess / MEMORY if excess < MEMORY else 1.0)
    if noise > scatter:
        noise = scatter
    least = BLUR * BLUR * quantum * quantum
    return noise if noise > least else least
