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

from estimator_pkg.record import record

SIGMAS = 3.0  # slack of the cumulative sums; prediction this far outside its cell is held
BLUR = 0.03  # quanta: no edge is known better; and either end of an interval, of its width
NOISE_SAMPLES = 32.0  # samples: memory of the noise, and of the innovations' size
OUTLIER_RATIO = 25.0  # largest weight of a square, in its expected value: 5 sigma
# third differences after one wrong reading, over the one before each; how near one must be to it
CORRELATION_SCALE = 4.0 / 11.0  # third differences are twice the changes of the residual; 3 + 8


@record
class Sensor:
    """The sensor as its readings show it."""

    quantum: float  # in use [rad]
    noise: float  # variance of the edges, without the quantum's own [rad^2]
    noise_bound: float  # mean square of third differences over 20 [rad^2]
    residual: float  # of linear interpolation, one sample before [rad]
    step: float  # change of the reading in the sample before [rad]
    dt: float  # sample time of that [s]; 0: none
    size: float  # of the last change of the reading [rad]; 0: none
    since: float  # time since that [s]
    residual_change: float  # change of the residual one sample before [rad]; inf: none
    vibration_power: float  # of third differences that last [rad^2]; negative: they alternate
    mean_sample_time: float  # mean sample time [s]


def jerk_density(variance: float, within: float) -> float:
    """Return the density of white jerk [(rad/s^3)^2 s] that moves the angle by `variance` [rad^2].

    `within` that time [s] a density c makes c within^5/20.
    """
    square = within * within
    return 20.0 * variance / (square * square * within)


def begin_sensor(sensor: Sensor, quantum: float) -> None:
    """Set the sensor before anything was seen."""
    sensor.quantum = quantum
    sensor.noise = BLUR * BLUR * quantum * quantum
    sensor.noise_bound = 0.0
    begin_differences(sensor)


def begin_differences(sensor: Sensor) -> None:
    """Forget the readings so far, but for what they showed of the noise."""
    sensor.residual = sensor.step = sensor.dt = sensor.size = sensor.since = 0.0
    sensor.vibration_power = sensor.mean_sample_time = 0.0
    sensor.residual_change = math.inf


def first_step(sensor: Sensor, quantum: float, step: float, dt: float) -> None:
    """Set the sensor as after the first `step` [rad], in a sample of `dt` [s]."""
    begin_sensor(sensor, quantum)
    sensor.step, sensor.dt, sensor.size = step, dt, abs(step)


def age_noise(sensor: Sensor, v: float) -> None:
    """Take readings to be up to one sample old, at the speed `v` [rad/s].

    The age is uniform, so the noise is at least (v dt)^2/12. It repeats like a sawtooth, of which
    third differences see the teeth alone.
    """
    age = v * v * sensor.mean_sample_time * sensor.mean_sample_time / 12.0
    sensor.noise = age if sensor.noise < age else sensor.noise
    sensor.noise_bound = age if sensor.noise_bound < age else sensor.noise_bound


def follow_sensor(sensor: Sensor, step: float, dt: float, quantum: float, spoilt: bool) -> None:
    """Take a reading that moved by `step` [rad] in `dt` [s].

    Parameters
    ----------
    quantum : to reckon with from now on [rad].
    spoilt : one of the last readings was wrong, and their scatter is no noise.

    Notes
    -----
    The mean of 3 T'^2 + 8 T T', T being a third difference and T' the one before, is 11 T^2 where
    T lasts, -60 sigma^2 for white noise, and not above 0 for the readings of any constant speed,
    however it beats with the sampling (a larger share than 3 would not have that). What the noise
    and the quantum may add by chance is taken off.
    """
    square = quantum * quantum
    if sensor.dt > 0.0:
        third = (step * sensor.dt - sensor.step * dt) / (dt + sensor.dt) - sensor.residual
        sensor.residual += third
        if sensor.residual_change == math.inf:
            sensor.residual_change, sensor.vibration_power = 0.0, -square
            if sensor.mean_sample_time == 0.0:
                sensor.mean_sample_time = dt
        else:
            before, bound = sensor.residual_change, sensor.noise_bound
            power, most = 0.2 * third * third, OUTLIER_RATIO * (bound + square)
            if spoilt:
                most = bound + square
            power = power if power < most else most
            sensor.noise_bound = bound + (power - bound) / NOISE_SAMPLES
            power = CORRELATION_SCALE * before * (3.0 * before + 8.0 * third)
            power = power - square / 12.0 - sensor.noise
            power = power if power < most else most
            sensor.vibration_power += (power - sensor.vibration_power) / NOISE_SAMPLES
            sensor.mean_sample_time += (dt - sensor.mean_sample_time) / NOISE_SAMPLES
            sensor.residual_change = third
    least = sensor.noise_bound - square  # more than any quantisation makes: it is noise
    if quantum != sensor.quantum:
        sensor.noise = BLUR * BLUR * square
    if sensor.noise < least:
        sensor.noise = least
    sensor.quantum, sensor.step, sensor.dt = quantum, step, dt
    if step == 0.0:
        sensor.since += dt
    else:
        sensor.size, sensor.since = abs(step), 0.0


def vibration(sensor: Sensor) -> float:
    """Return the density of white jerk [(rad/s^3)^2 s] that makes the third differences that last.

    Within a sample it adds their square to the variance of the predicted angle: the error of
    extrapolating with an acceleration. 0: there is nothing but noise.
    """
    if sensor.vibration_power <= 0.0:
        return 0.0
    return jerk_density(sensor.vibration_power, sensor.mean_sample_time)


def follow_noise(noise: float, excess: float, scatter: float, quantum: float) -> float:
    """Return the noise [rad^2] made likelier.

    Twofold in one sample at most; never above the scatter, which is no motion, and never below the
    `BLUR`.

    Parameters
    ----------
    excess : score of the innovation variance, times the noise [rad^2].
    """
    noise += noise * (excess / NOISE_SAMPLES if excess < NOISE_SAMPLES else 1.0)
    if noise > scatter:
        noise = scatter
    least = BLUR * BLUR * quantum * quantum
    return noise if noise > least else least
