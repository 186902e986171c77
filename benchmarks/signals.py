# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The shared set of motions on which observers are compared, in closed form.

Every column is one encoder, read as an angle in [-pi, pi), at 1 kHz and 4096 counts per turn unless
the column states otherwise. With jitter the samples are taken at uneven times and stamped
correctly. Each column can also be drawn at random: another phase, another start, a similar speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_pkg.joints.profiles import pieces

Array = NDArray[np.float64]
Motion = Callable[[Array], tuple[Array, Array]]
Draw = Callable[[np.random.Generator], Motion]

RATE = 1000.0  # [Hz]
COUNTS = 4096
SKIPPED = 1.0  # ignored at the beginning [s]
DURATION = 11.0  # [s]
START_NS = 1_700_000_000_123_456_789
START_ANGLE = 0.3  # [rad]


class Samples(NamedTuple):
    """Readings of an encoder and the true velocity; arrays of shape (n,)."""

    stamps: NDArray[np.int64]
    angle: Array
    velocity: Array


@dataclass(frozen=True)
class Signal:
    """A column of the comparison.

    motion : (time [s]) -> (position [rad], velocity [rad/s]).
    jitter : largest error of a sampling time, as a fraction of the sample time.
    dropped : fraction of the samples, at random, that never arrive.
    rate, counts, noise : sampling [Hz], counts per turn, white noise before quantisation [rad].
    draw : the motion with a random phase or speed; None: always the same, with a random start.
    """

    name: str
    summary: str
    motion: Motion
    jitter: float = 0.0
    dropped: float = 0.0
    rate: float = RATE
    counts: int = COUNTS
    noise: float = 0.0
    draw: Draw | None = None

    @property
    def quantum(self) -> float:
        """Quantum of the reading [rad]."""
        return 2.0 * math.pi / self.counts

    def samples(self, seed: int = 1, duration: float = DURATION) -> Samples:
        """Return `duration` [s] of the signal; the same for the same seed."""
        return self._sampled(self.motion, START_ANGLE, np.random.default_rng(seed), duration)

    def drawn(self, number: int, duration: float = DURATION) -> Samples:
        """Return `samples` with a random start and, if `draw` is set, a random phase or speed."""
        random = np.random.default_rng((number, len(self.name)))
        start = random.uniform(0.0, 2.0 * math.pi)
        motion = self.motion if self.draw is None else self.draw(random)
        return self._sampled(motion, start, random, duration)

    def _sampled(
        self, motion: Motion, start: float, random: np.random.Generator, duration: float
    ) -> Samples:
        count = round(duration * self.rate)
        steps = np.arange(count) + self.jitter * random.uniform(-1.0, 1.0, count)
        kept = random.random(count) >= self.dropped
        stamps = np.rint((steps[kept] + 1.0) * (1e9 / self.rate)).astype(np.int64)
        position, velocity = motion(stamps.astype(np.float64) * 1e-9)
        position = position + start
        if self.noise > 0.0:
            position = position + random.normal(0.0, self.noise, len(position))
        return Samples(stamps + START_NS, encoder(position, self.counts), velocity)


def encoder(position: Array, counts: int = COUNTS) -> Array:
    """Return the position [rad] as an encoder reads it: counts in rad, in [-pi, pi)."""
    count = np.floor(position * (counts / (2.0 * math.pi)))
    return ((count + counts / 2) % counts - counts / 2) * (2.0 * math.pi / counts)


def constant(speed: float) -> Motion:
    """Return a motion at constant speed [rad/s]."""
    return lambda time: (speed * time, np.full(len(time), speed))


def sine(amplitude: float, frequency: float, phase: float = 0.0) -> Motion:
    """Return a motion whose velocity is a sine: amplitude [rad/s], frequency [Hz], phase [rad]."""
    pulsation = 2.0 * math.pi * frequency
    return lambda time: (
        -amplitude / pulsation * np.cos(pulsation * time + phase),
        amplitude * np.sin(pulsation * time + phase),
    )


def trapezoid(speed: float, acceleration: float, hold: float, phase: float = 0.0) -> Motion:
    """Return a motion from rest to `speed` [rad/s] and back, both for `hold` [s], repeated.

    phase : lead, as a fraction of a period.
    """
    rise = speed / acceleration
    profile = pieces(
        [(hold, 0.0, 0.0), (rise, 0.0, speed), (hold, speed, speed), (rise, speed, 0.0)],
        repeat=True,
    )
    return lambda time: profile(time + 2.0 * phase * (hold + rise))[:2]


def some_speed(speed: float) -> Draw:
    """Return a draw of constant speeds within 20 % of `speed` [rad/s]."""
    return lambda random: constant(speed * random.uniform(0.8, 1.2))


def some_sine(amplitude: float, frequency: float) -> Draw:
    """Return a draw of the sine at any phase."""
    return lambda random: sine(amplitude, frequency, random.uniform(0.0, 2.0 * math.pi))


def some_trapezoid(speed: float, acceleration: float, hold: float) -> Draw:
    """Return a draw of the trapezoid at any phase."""
    return lambda random: trapezoid(speed, acceleration, hold, random.uniform())


def beat(numerator: int, denominator: int, offset: float) -> Motion:
    """Return a constant speed of n/d counts per sample plus `offset` (1 kHz, 4096 counts)."""
    return constant((numerator / denominator + offset) * RATE * 2.0 * math.pi / COUNTS)


def some_beat(least: float, most: float) -> Draw:
    """Return a draw within 4 % of p/q counts per sample, q <= 6, p/q between two bounds."""

    def draw(random: np.random.Generator) -> Motion:
        over = int(random.integers(1, 7))
        whole = int(random.integers(max(1, round(least * over)), max(2, round(most * over) + 1)))
        return beat(whole, over, random.uniform(-0.04, 0.04) * min(1.0, whole / over))

    return draw


SINE, SOME_SINE = sine(5.0, 2.0), some_sine(5.0, 2.0)
SIGNALS = (
    Signal('slow', '0.02 rad/s', constant(0.02), draw=some_speed(0.02)),
    Signal('sine', '5 rad/s sine at 2 Hz', SINE, draw=SOME_SINE),
    Signal(
        'trapezoid',
        '0 to 20 rad/s at 100 rad/s^2',
        trapezoid(20.0, 100.0, 0.8),
        draw=some_trapezoid(20.0, 100.0, 0.8),
    ),
    Signal('fast', '200 rad/s', constant(200.0), draw=some_speed(200.0)),
    Signal('jitter', 'the sine, sampled with +-40 % jitter', SINE, jitter=0.4, draw=SOME_SINE),
    Signal('drops', 'the sine, 10 % of the samples lost', SINE, dropped=0.1, draw=SOME_SINE),
)
# Signals beyond the shared set that distinguish observers: low speeds, other encoders and rates.
FURTHER = (
    Signal('creep', '0.005 rad/s', constant(0.005), draw=some_speed(0.005)),
    Signal('reversal', '0.1 rad/s sine at 0.5 Hz', sine(0.1, 0.5), draw=some_sine(0.1, 0.5)),
    Signal('256', '0.5 rad/s with 256 counts', constant(0.5), counts=256, draw=some_speed(0.5)),
    Signal('1024', '0.5 rad/s with 1024 counts', constant(0.5), counts=1024, draw=some_speed(0.5)),
    Signal(
        '65536', '0.5 rad/s with 65536 counts', constant(0.5), counts=65536, draw=some_speed(0.5)
    ),
    Signal(
        'steps',
        '0 to 30 rad/s at 300 rad/s^2',
        trapezoid(30.0, 300.0, 0.3),
        draw=some_trapezoid(30.0, 300.0, 0.3),
    ),
    Signal('noise', 'the sine with 1 mrad of white noise', SINE, noise=1e-3, draw=SOME_SINE),
    Signal(
        'beat',
        'close to p/q <= 1 count per sample, q <= 6',
        beat(1, 1, 0.01),
        draw=some_beat(0.0, 1.0),
    ),
    Signal(
        'fast beat',
        'the same at 20 to 130 counts per sample',
        beat(261, 2, 0.01),
        draw=some_beat(20.0, 130.0),
    ),
    Signal('100 Hz', 'the sine at 100 Hz', SINE, rate=100.0, draw=SOME_SINE),
    Signal('200 Hz', 'the sine at 200 Hz', SINE, rate=200.0, draw=SOME_SINE),
    Signal('10 kHz', 'the sine at 10 kHz', SINE, rate=10_000.0, draw=SOME_SINE),
)
