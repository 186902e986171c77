# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulated streams on which two observers of an angle are compared.

Seven rates, four motions, readings with and without quantisation and noise; and at 1 kHz what
drivers do to readings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.signals import START_NS, Samples, constant, encoder, sine, trapezoid

Array = NDArray[Any]

RATES = (10.0, 30.0, 100.0, 200.0, 500.0, 1000.0, 10_000.0)  # [Hz]
PHASES = (0.0, 0.37)  # of a sample
MOTIONS = {
    'fast sine': sine(5.0, 2.0, 0.3),
    'slow sine': sine(0.5, 0.2, 0.3),
    'constant': constant(2.0),
    'point to point': trapezoid(2.0, 10.0, 0.5),
}
TURN = 2.0 * math.pi
QUANTUM = TURN / 4096
START = 0.3  # [rad]
CUTOFF = 30.0  # [Hz] of the low-pass


class Stream(NamedTuple):
    """Readings with a name; `period` is the wrap period [rad], 0 for a prismatic joint."""

    name: str
    samples: Samples
    period: float = TURN


def wrapped(position: Array) -> Array:
    """Return positions [rad] in [-pi, pi)."""
    found: Array = (position + math.pi) % TURN - math.pi
    return found


def streams(phase: float) -> Iterator[Stream]:
    """Yield every stream at this phase of the sampling."""
    for rate in RATES:
        count = max(300, round(3.0 * rate))
        time: Array = (np.arange(count) + 1.0 + phase) / rate
        for name, motion in MOTIONS.items():
            position, velocity = motion(time)
            position = np.asarray(position + START, np.float64)
            random = np.random.default_rng((int(rate), len(name)))
            readings = {
                'floats': wrapped(position),
                'noise': wrapped(position + random.normal(0.0, 1e-4, count)),
                'counts': encoder(position),
                'noisy counts': encoder(position + random.normal(0.0, 1e-3, count)),
            }
            for kind, angle in readings.items():
                yield Stream(f'{rate:g} Hz, {name}, {kind}', _samples(time, angle, velocity))
    for name, motion in MOTIONS.items():
        yield from _disturbed(name, motion, phase)


def _disturbed(name: str, motion: Any, phase: float) -> Iterator[Stream]:
    count, random = 6000, np.random.default_rng(len(name))
    time = (np.arange(count) + 1.0 + phase) / 1000.0
    position, velocity = motion(time)
    position = np.asarray(position + START, np.float64)
    filtered = _low_passed(np.floor(position / QUANTUM) * QUANTUM, 1000.0)
    glitches = encoder(position)
    at = random.integers(500, count, 10)
    glitches[at] = wrapped(glitches[at] + 0.5)
    late = time + random.uniform(-0.2, 0.2, count) / 1000.0
    moved, _ = motion(late)
    held = np.where(random.random(count) < 0.2, np.maximum(np.arange(count) - 1, 0), range(count))
    kinds: tuple[tuple[str, NDArray[Any], Array], ...] = (
        ('low-passed counts', wrapped(filtered), velocity),
        ('repeated', encoder(position[np.arange(count) // 2 * 2]), velocity),
        ('held', encoder(position[held]), velocity),
        ('float32', wrapped(position).astype(np.float32).astype(np.float64), velocity),
        ('rounded', np.round(wrapped(position), 4), velocity),
        ('jitter', encoder(moved + START), velocity),
        ('glitches', glitches, velocity),
    )
    for kind, angle, true in kinds:
        yield Stream(f'{kind}, {name}', _samples(time, angle, true))
    yield Stream(
        f'low-passed counts at 200 Hz, {name}',
        _samples(time[::5], wrapped(filtered)[::5], velocity[::5]),
    )
    metres = np.floor(0.01 * position / 1e-6) * 1e-6
    yield Stream(f'prismatic, {name}', _samples(time, metres, 0.01 * velocity), 0.0)


def _low_passed(reading: Array, rate: float) -> Array:
    share = 1.0 - math.exp(-TURN * CUTOFF / rate)
    out, state = np.empty(len(reading)), reading[0]
    for i, each in enumerate(reading):
        state += share * (each - state)
        out[i] = state
    return out


def _samples(time: Array, angle: NDArray[Any], velocity: NDArray[Any]) -> Samples:
    return Samples(START_NS + np.rint(time * 1e9).astype(np.int64), angle, velocity)
