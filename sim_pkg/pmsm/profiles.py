# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Speed profiles for the motor simulator: segments, each starting where the last one ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError

RPM = 2.0 * math.pi / 60.0  # rad/s per revolution per minute

# (duration [s], start [rpm], end [rpm]): the profile P1 of the tables, 0.70 s
P1 = (
    (0.10, 3000.0, 3000.0),
    (0.05, 3000.0, 6000.0),
    (0.10, 6000.0, 6000.0),
    (0.04, 6000.0, 3000.0),
    (0.04, 3000.0, 6000.0),
    (0.04, 6000.0, 3000.0),
    (0.04, 3000.0, 6000.0),
    (0.10, 6000.0, 2000.0),
    (0.09, 2000.0, 2000.0),
    (0.10, 2000.0, 5000.0),
)

# (part of the run, start, end) over the top speed; these repeat
SHAPES = {
    'ramps': ((0.2, 0.3, 0.3), (0.2, 0.3, 1.0), (0.2, 1.0, 1.0), (0.2, 1.0, 0.3), (0.2, 0.3, 0.3)),
    'reversal': ((0.3, 1.0, 1.0), (0.2, 1.0, -1.0), (0.3, -1.0, -1.0), (0.2, -1.0, 1.0)),
    'standstill': (
        (0.2, 0.0, 0.0),
        (0.2, 0.0, 1.0),
        (0.2, 1.0, 1.0),
        (0.2, 1.0, 0.0),
        (0.2, 0.0, 0.0),
    ),
}
NAMES = ('constant', 'ramps', 'p1', 'reversal', 'standstill')


class Motion(NamedTuple):
    """Mechanical speed [rad/s], its two derivatives, and angle [rad]; arrays of the same shape."""

    speed: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    jerk: NDArray[np.float64]
    angle: NDArray[np.float64]


class Profile:
    """A mechanical speed over time; after the last segment the speed is constant.

    Parameters
    ----------
    segments : (duration [s], start [rpm], end [rpm]) each.
    smooth : half-cosine segments (True) or straight ramps (False).
    repeat : start again after the last segment.
    """

    def __init__(
        self,
        segments: Sequence[tuple[float, float, float]],
        *,
        smooth: bool = True,
        repeat: bool = False,
    ) -> None:
        table = np.asarray(segments, dtype=float)
        if table.ndim != 2 or table.shape[1] != 3 or not np.all(table[:, 0] > 0.0):
            raise UsageError(
                f'the profile has shape {table.shape} or a duration <= 0: give a list of '
                '(duration [s], start [rpm], end [rpm])'
            )
        self.duration = float(table[:, 0].sum())
        self._length = np.append(table[:, 0], 1.0)
        self._start = np.concatenate(([0.0], np.cumsum(table[:, 0])))
        self._start[-1] += 1e-12  # the end itself belongs to the last segment
        self._from = np.append(table[:, 1], table[-1, 2]) * RPM
        self._to = np.append(table[:, 2], table[-1, 2]) * RPM
        # both shapes move by the mean speed times the duration
        travelled = np.cumsum(0.5 * (self._from + self._to)[:-1] * self._length[:-1])
        self._angle = np.concatenate(([0.0], travelled))
        self._smooth = smooth
        self._repeat = repeat

    def at(self, times: NDArray[np.float64]) -> Motion:
        """Return the motion at `times` [s], shape (n,)."""
        t = np.asarray(times, dtype=float)
        turns = np.zeros_like(t)
        if self._repeat:
            turns = np.floor(t / self.duration)
            t = t - turns * self.duration
        k = np.clip(np.searchsorted(self._start, t, side='right') - 1, 0, len(self._start) - 1)
        s, length = t - self._start[k], self._length[k]
        low, rise = self._from[k], self._to[k] - self._from[k]
        if self._smooth:
            rate = np.pi / length
            wave, cross = np.cos(rate * s), np.sin(rate * s)
            speed = low + 0.5 * rise * (1.0 - wave)
            acceleration = 0.5 * rise * rate * cross
            jerk = 0.5 * rise * rate * rate * wave
            angle = low * s + 0.5 * rise * (s - cross / rate)
        else:
            speed = low + rise * s / length
            acceleration = rise / length
            jerk = np.zeros_like(s)
            angle = low * s + 0.5 * rise * s * s / length
        return Motion(speed, acceleration, jerk, self._angle[k] + angle + turns * self._angle[-1])


def named(name: str, speed_rpm: float, duration: float) -> Profile:
    """Return a profile by name, scaled to a speed.

    Parameters
    ----------
    name : one of `NAMES`.
    speed_rpm : top speed [rpm]; P1, which has 6000 rpm, is scaled to it.
    duration : length of one run through the profile [s]; P1 always takes 0.70 s.
    """
    if name == 'constant':
        return Profile([(duration, speed_rpm, speed_rpm)])
    if name == 'p1':
        scale = speed_rpm / 6000.0
        return Profile([(part, low * scale, high * scale) for part, low, high in P1])
    if name not in SHAPES:
        raise UsageError(f"profile '{name}' does not exist: choose one of {', '.join(NAMES)}")
    return Profile(
        [(part * duration, low * speed_rpm, high * speed_rpm) for part, low, high in SHAPES[name]],
        smooth=name != 'ramps',
        repeat=True,
    )
