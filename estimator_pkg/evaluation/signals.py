"""The shared set of motions on which observers are compared, in closed form.

Every column is one encoder: 1 kHz, 4096 counts per turn, read as an angle in [-pi, pi). With jitter
the samples are taken at uneven times, and their stamps say when.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Motion = Callable[[Array], tuple[Array, Array]]

RATE = 1000.0           # [Hz]
COUNTS = 4096
SKIPPED = 1.0           # [s] at the beginning that does not count
DURATION = 11.0         # [s]
START_NS = 1_700_000_000_123_456_789
START_ANGLE = 0.3       # [rad]


class Samples(NamedTuple):
    """What an encoder gave and what was true; arrays of shape (n,)."""

    stamps: NDArray[np.int64]
    angle: Array
    velocity: Array


@dataclass(frozen=True)
class Signal:
    """A column of the comparison.

    motion : (time [s]) -> (position [rad], velocity [rad/s]).
    jitter : sampling times are off by up to this part of a sample time.
    dropped : this part of the samples, at random, never arrives.
    """

    name: str
    summary: str
    motion: Motion
    jitter: float = 0.0
    dropped: float = 0.0

    def samples(self, seed: int = 1, duration: float = DURATION) -> Samples:
        """`duration` [s] of it; the same for the same seed."""
        random = np.random.default_rng(seed)
        count = round(duration * RATE)
        steps = np.arange(count) + self.jitter * random.uniform(-1.0, 1.0, count)
        kept = random.random(count) >= self.dropped
        stamps = np.rint((steps[kept] + 1.0) * (1e9 / RATE)).astype(np.int64)
        position, velocity = self.motion(stamps.astype(np.float64) * 1e-9)
        return Samples(stamps + START_NS, encoder(position + START_ANGLE), velocity)


def encoder(position: Array) -> Array:
    """The position [rad] as an encoder reads it: whole counts, in [-pi, pi)."""
    count = np.floor(position * (COUNTS / (2.0 * math.pi)))
    return ((count + COUNTS / 2) % COUNTS - COUNTS / 2) * (2.0 * math.pi / COUNTS)


def constant(speed: float) -> Motion:
    """Constant speed [rad/s]."""
    return lambda time: (speed * time, np.full(len(time), speed))


def sine(amplitude: float, frequency: float) -> Motion:
    """A velocity of this amplitude [rad/s] and frequency [Hz]."""
    pulsation = 2.0 * math.pi * frequency
    return lambda time: (-amplitude / pulsation * np.cos(pulsation * time),
                         amplitude * np.sin(pulsation * time))


def trapezoid(speed: float, acceleration: float, hold: float) -> Motion:
    """Again and again from rest to `speed` [rad/s] and back, both held for `hold` [s]."""
    rise = speed / acceleration
    corners = np.cumsum([0.0, hold, rise, hold, rise])
    speeds = np.array([0.0, 0.0, speed, speed, 0.0])
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1])
                                                 * np.diff(corners))])
    change = np.array([0.0, acceleration, 0.0, -acceleration])

    def motion(time: Array) -> tuple[Array, Array]:
        turns, phase = np.divmod(time, corners[-1])
        part = np.clip(np.searchsorted(corners, phase, side='right') - 1, 0, 3)
        inside = phase - corners[part]
        velocity = speeds[part] + change[part] * inside
        position = travelled[part] + (speeds[part] + 0.5 * change[part] * inside) * inside
        return turns * travelled[-1] + position, velocity

    return motion


SIGNALS = (
    Signal('slow', '0.02 rad/s', constant(0.02)),
    Signal('sine', '5 rad/s sine at 2 Hz', sine(5.0, 2.0)),
    Signal('trapezoid', '0 to 20 rad/s at 100 rad/s^2', trapezoid(20.0, 100.0, 0.8)),
    Signal('fast', '200 rad/s', constant(200.0)),
    Signal('jitter', 'the sine, sampled with +-40 % jitter', sine(5.0, 2.0), jitter=0.4),
    Signal('drops', 'the sine, 10 % of the samples lost', sine(5.0, 2.0), dropped=0.1),
)
