# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulated motions with truth, for the ranking without truth: the usual, and the known failures.

Each is a motion in closed form or integrated, read by an encoder of its own. None is a motion on
which the constants of the ranking were chosen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.signals import START_NS, Samples, constant, trapezoid

Array = NDArray[np.float64]
Random = np.random.Generator
Move = Callable[[Array, Random], tuple[Array, Array]]

TURN = 2.0 * math.pi
LENGTH = 12.0  # [s]


class Sensor(NamedTuple):
    """An encoder: rate [Hz], counts per turn, white noise before the counts [rad].

    jitter : largest error of a sampling time, as a fraction of the sample time; stamped rightly.
    wrong : standard deviation of the stamps' error [s]. drops : fraction of lost samples.
    held : each reading is repeated so often. offset : of the angle over one turn [rad].
    sticks : (duration, period) [s] in which the reading does not change. hum : (amplitude [rad],
    frequency [Hz]) of an error.
    """

    rate: float
    counts: int
    noise: float = 0.0
    jitter: float = 0.0
    wrong: float = 0.0
    drops: float = 0.0
    held: int = 1
    offset: float = 0.0
    sticks: tuple[float, float] = (0.0, 1.0)
    hum: tuple[float, float] = (0.0, 1.0)


def sines(highest: float, speed: float, number: int = 12) -> Move:
    """Return a sum of sines of random frequency up to `highest` [Hz] with this rms speed."""

    def move(time: Array, random: Random) -> tuple[Array, Array]:
        hz = highest * random.uniform(0.02, 1.0, number)
        phase = random.uniform(0.0, TURN, number)
        size = speed * math.sqrt(2.0 / number)
        angles = TURN * hz[:, None] * time + phase[:, None]
        position = -size * np.sum(np.cos(angles) / (TURN * hz[:, None]), axis=0)
        return position, size * np.sum(np.sin(angles), axis=0)

    return move


def reaching(length: float, duration: float, pause: float) -> Move:
    """Return minimum-jerk reaches [rad] there and back with pauses."""

    def move(time: Array, random: Random) -> tuple[Array, Array]:
        cycle = duration + pause
        turn, within = np.divmod(time, cycle)
        part = np.clip(within / duration, 0.0, 1.0)
        sign = np.where(turn % 2 == 0, 1.0, -1.0)
        shape = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
        speed = 30.0 * part**2 * (1.0 - part) ** 2 / duration
        position = np.where(turn % 2 == 0, shape, 1.0 - shape) * length
        return position, sign * speed * length

    return move


def chirp(speed: float, highest: float) -> Move:
    """Return a velocity sine whose frequency rises to `highest` [Hz]."""

    def move(time: Array, random: Random) -> tuple[Array, Array]:
        fine = np.linspace(0.0, time[-1] + 0.01, 400_001)
        velocity = speed * np.sin(math.pi * highest * fine**2 / fine[-1])
        return _integrated(fine, velocity, time)

    return move


def vibrating(swing: float, size: float, hz: float, burst: float = 1.0) -> Move:
    """Return a slow swing with a vibration of `size` [rad/s] at `hz` in this part of the time."""

    def move(time: Array, random: Random) -> tuple[Array, Array]:
        fine = np.linspace(0.0, time[-1] + 0.01, 400_001)
        on = (np.mod(fine, 2.0) < 2.0 * burst).astype(float)
        on = np.convolve(on, np.ones(2001) / 2001.0, 'same')
        velocity = swing * np.sin(TURN * 0.4 * fine) + on * size * np.sin(TURN * hz * fine)
        return _integrated(fine, velocity, time)

    return move


def wander(speed: float, hz: float) -> Move:
    """Return a random velocity of this rms, whose spectrum falls off above `hz`."""

    def move(time: Array, random: Random) -> tuple[Array, Array]:
        fine = np.linspace(0.0, time[-1] + 0.01, 1 << 17)
        spectrum = np.fft.rfft(random.normal(size=len(fine)))
        frequency = np.fft.rfftfreq(len(fine), fine[1])
        velocity = np.fft.irfft(spectrum / (1.0 + (frequency / hz) ** 2) ** 1.5, len(fine))
        return _integrated(fine, velocity * speed / np.std(velocity), time)

    return move


def friction(speed: float, break_away: float) -> Move:
    """Return a mass pulled over a spring with dry friction: stick-slip."""

    def move(time: Array, random: Random) -> tuple[Array, Array]:
        fine = np.linspace(0.0, time[-1] + 0.01, 60_001)
        step = fine[1]
        velocity = np.zeros(len(fine))
        q = v = 0.0
        for i, t in enumerate(fine):
            pull = 400.0 * (speed * t + 0.3 * math.sin(1.7 * t) - q) - 4.0 * v
            if v == 0.0 and abs(pull) < break_away:
                velocity[i] = 0.0
                continue
            drag = 0.6 * break_away * (math.copysign(1.0, v) if v else math.copysign(1.0, pull))
            new = v + step * (pull - drag)
            v = 0.0 if v * new < 0.0 else new
            q += step * v
            velocity[i] = v
        return _integrated(fine, velocity, time)

    return move


def steady(speed: float) -> Move:
    """Return a constant speed [rad/s]."""
    return lambda time, random: constant(speed)(time)


def _ramps(speed: float, acceleration: float, hold: float) -> Move:
    return lambda time, random: trapezoid(speed, acceleration, hold)(time)


def _integrated(fine: Array, velocity: Array, time: Array) -> tuple[Array, Array]:
    """Return position and velocity at `time` from a velocity on a fine grid."""
    area = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(fine)
    return (
        np.interp(time, fine, np.concatenate([[0.0], np.cumsum(area)])),
        np.interp(time, fine, velocity),
    )


MOTIONS: dict[str, tuple[Move, Sensor]] = {
    'sines to 3 Hz, 4096 counts': (sines(3.0, 2.0), Sensor(1000.0, 4096)),
    'sines to 3 Hz, 512 counts': (sines(3.0, 2.0), Sensor(500.0, 512)),
    'sines to 10 Hz, 16384 counts': (sines(10.0, 6.0), Sensor(1000.0, 16384)),
    'sines to 10 Hz, 1024 counts': (sines(10.0, 6.0), Sensor(1000.0, 1024)),
    'sines to 1 Hz, 64 counts': (sines(1.0, 5.0), Sensor(200.0, 64)),
    'sines to 1 Hz, noise of 1 mrad': (sines(1.0, 1.0), Sensor(500.0, 1 << 20, 1e-3)),
    'sines to 5 Hz, noise of 3 mrad': (sines(5.0, 3.0), Sensor(200.0, 1 << 20, 3e-3)),
    'sines to 2 Hz at 50 Hz': (sines(2.0, 2.0), Sensor(50.0, 4096)),
    'sines to 2 Hz at 2 kHz': (sines(2.0, 0.5), Sensor(2000.0, 8192)),
    'sines to 4 Hz, jitter': (sines(4.0, 3.0), Sensor(500.0, 4096, jitter=0.4)),
    'sines to 4 Hz, wrong stamps': (sines(4.0, 3.0), Sensor(500.0, 4096, wrong=2e-4)),
    'sines to 4 Hz, 10 % lost': (sines(4.0, 3.0), Sensor(500.0, 4096, drops=0.1)),
    'sines to 2 Hz, readings held 3 times': (sines(2.0, 3.0), Sensor(600.0, 8192, held=3)),
    'reaches, 4096 counts': (reaching(1.5, 1.0, 0.5), Sensor(500.0, 4096)),
    'reaches, 65536 counts': (reaching(1.0, 0.5, 0.5), Sensor(1000.0, 65536)),
    'reaches, noise of 0.5 mrad': (reaching(1.0, 0.8, 0.3), Sensor(250.0, 1 << 20, 5e-4)),
    'reaches at 100 Hz': (reaching(1.2, 0.7, 0.4), Sensor(100.0, 4096)),
    'chirp to 8 Hz, 4096 counts': (chirp(4.0, 8.0), Sensor(1000.0, 4096)),
    'chirp to 20 Hz, 16384 counts': (chirp(3.0, 20.0), Sensor(1000.0, 16384)),
    'chirp to 4 Hz, noise of 2 mrad': (chirp(4.0, 4.0), Sensor(200.0, 1 << 20, 2e-3)),
    'vibration of 20 Hz, 4096 counts': (vibrating(2.0, 1.0, 20.0), Sensor(500.0, 4096)),
    'vibration of 35 Hz, 16384 counts': (vibrating(1.0, 1.0, 35.0), Sensor(1000.0, 16384)),
    'vibration of 28 Hz, noise of 1 mrad': (
        vibrating(1.0, 2.0, 28.0),
        Sensor(400.0, 1 << 20, 1e-3),
    ),
    'vibration of 45 Hz, noise of 0.5 mrad': (
        vibrating(1.0, 1.5, 45.0, 0.5),
        Sensor(500.0, 1 << 20, 5e-4),
    ),
    'bursts of 28 Hz, 2157 counts': (vibrating(1.0, 2.0, 28.0, 0.05), Sensor(200.0, 2157)),
    'bursts of 28 Hz, noise of 2 mrad': (
        vibrating(1.0, 1.0, 28.0, 0.05),
        Sensor(1000.0, 1 << 20, 2e-3),
    ),
    'shaking at 28 Hz, 2157 counts': (vibrating(1.0, 1.0, 28.0, 0.3), Sensor(200.0, 2157)),
    'wander to 2 Hz, 4096 counts': (wander(2.0, 2.0), Sensor(1000.0, 4096)),
    'wander to 8 Hz, 4096 counts': (wander(5.0, 8.0), Sensor(500.0, 4096)),
    'wander to 2 Hz, noise of 1 mrad': (wander(2.0, 2.0), Sensor(300.0, 1 << 20, 1e-3)),
    'wander to 1 Hz, 256 counts': (wander(3.0, 1.0), Sensor(500.0, 256)),
    'wander to 5 Hz, 10000 counts, noise': (wander(4.0, 5.0), Sensor(800.0, 10_000, 3e-4)),
    'trapezoids, 4096 counts': (_ramps(10.0, 60.0, 0.6), Sensor(1000.0, 4096)),
    'trapezoids, 512 counts': (_ramps(20.0, 100.0, 0.4), Sensor(500.0, 512)),
    'trapezoids, noise of 1 mrad': (_ramps(8.0, 40.0, 0.5), Sensor(250.0, 1 << 20, 1e-3)),
    'stick-slip, 4096 counts': (friction(0.4, 20.0), Sensor(500.0, 4096)),
    'stick-slip, 65536 counts': (friction(0.3, 40.0), Sensor(1000.0, 65536)),
}
SLOW = sines(2.0, 2.0)
FAILURES: dict[str, tuple[Move, Sensor]] = {
    'constant speed: 18 rad/s, 4096 counts': (steady(18.0), Sensor(1000.0, 4096)),
    'constant speed: 18 rad/s, 500 counts': (steady(18.0), Sensor(1000.0, 500)),
    'constant speed: 3.1 rad/s, 1024 counts': (steady(3.1), Sensor(500.0, 1024)),
    'constant speed: 7 rad/s, noise of 1 mrad': (steady(7.0), Sensor(500.0, 1 << 20, 1e-3)),
    'constant speed: 7 rad/s, 4096 counts, noise': (steady(7.0), Sensor(500.0, 4096, 4e-4)),
    'constant speed: 12 rad/s, wrong stamps': (steady(12.0), Sensor(500.0, 4096, wrong=1e-4)),
    'constant speed: 5 rad/s, 10 % lost': (steady(5.0), Sensor(500.0, 2048, drops=0.1)),
    'sticks: 50 ms every 2 s': (SLOW, Sensor(1000.0, 4096, sticks=(0.05, 2.0))),
    'sticks: 50 ms every 2 s, noise': (SLOW, Sensor(500.0, 1 << 20, 5e-4, sticks=(0.05, 2.0))),
    'sticks: 20 ms every 0.7 s': (SLOW, Sensor(1000.0, 4096, sticks=(0.02, 0.7))),
    'eccentric: 30 mrad': (sines(2.0, 6.0), Sensor(1000.0, 4096, offset=0.03)),
    'hum: 50 Hz of 2 mrad': (SLOW, Sensor(1000.0, 16384, hum=(2e-3, 50.0))),
    'hum: 120 Hz of 1 mrad': (SLOW, Sensor(1000.0, 1 << 20, 3e-4, hum=(1e-3, 120.0))),
}


def sampled(name: str) -> Samples:
    """Return the readings of a motion; the same each time."""
    move, sensor = {**MOTIONS, **FAILURES}[name]
    random = np.random.default_rng(sum(map(ord, name)))
    count = round(LENGTH * sensor.rate)
    steps = np.arange(count) + sensor.jitter * random.uniform(-1.0, 1.0, count)
    time = np.sort((steps + 1.0) / sensor.rate)
    position, velocity = move(time, random)
    angle = position + random.uniform(0.0, TURN)
    angle = angle + sensor.offset * np.sin(angle)
    angle = angle + sensor.hum[0] * np.sin(TURN * sensor.hum[1] * time)
    angle = angle + random.normal(0.0, max(sensor.noise, 1e-12), count)
    held = np.arange(count) // sensor.held * sensor.held
    duration, every = sensor.sticks
    if duration:
        free = np.mod(time + 0.5 * every, every) >= duration
        held = np.maximum.accumulate(np.where(free, held, 0))
    angle = angle[held]
    step = TURN / sensor.counts
    wrapped = np.floor(angle / step) % sensor.counts * step
    shown = time + random.normal(0.0, max(sensor.wrong, 1e-12), count)
    stamps = START_NS + np.rint(shown * 1e9).astype(np.int64)
    kept = np.diff(stamps, prepend=0) > 0
    kept &= random.random(count) >= sensor.drops
    return Samples(stamps[kept], wrapped[kept], velocity[kept])
