# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Random streams of an encoder without a fault: exact stamps, true velocity."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

START = 10**18
TURN = 2.0 * math.pi
MOST = 6000  # readings of a stream


class Clean(NamedTuple):
    """Stamps [ns], readings [rad] wrapped into a turn, velocity [rad/s], quantum [rad]."""

    stamps: NDArray[np.int64]
    readings: NDArray[np.float64]
    velocity: NDArray[np.float64]
    quantum: float


def _steps(random, t, size):
    """A servo from rest to rest: a new speed now and then, with a limited acceleration."""
    wanted = size * random.uniform(-1.0, 1.0, 12) * (random.random(12) < 0.6)
    speed = wanted[(t / t[-1] * 11.999).astype(int)]
    most = size / random.uniform(0.02, 0.3) * np.diff(t, prepend=0.0)
    out, now = np.empty_like(t), 0.0
    for k, goal in enumerate(speed):
        now += min(max(goal - now, -most[k]), most[k])
        out[k] = now
    return out


def _sine(random, t, size):
    return size * np.sin(TURN * random.uniform(0.1, 3.0) * t + random.uniform(0.0, TURN))


def _reversals(random, t, size):
    rate = TURN * random.uniform(0.2, 2.0)
    steepest = 0.3 / (rate * (t[8] - t[0]))  # a reversal takes a few samples
    steep = min(random.uniform(2.0, 30.0), steepest)
    return size * np.clip(steep * np.sin(rate * t), -1.0, 1.0)


def _stick_slip(random, t, size):
    phase = (t * random.uniform(0.5, 4.0)) % 1.0
    part = random.uniform(0.1, 0.5)
    return size * np.where(phase < part, np.sin(math.pi * phase / part) ** 2, 0.0)


def _rests(random, t, size):
    moving = (t % 3.0) > random.uniform(1.5, 2.5)
    return (
        _sine(random, t, size) * moving * np.sin(math.pi * np.clip((t % 3.0) - 1.5, 0, 1.5) / 1.5)
    )


MOTIONS = (_steps, _sine, _reversals, _stick_slip, _rests)


def clean_stream(seed: int, seconds: float = 8.0) -> Clean:
    """Return a stream; its sample rate is 20 Hz to 8 kHz, its counts 256 to 2^18 a turn."""
    random = np.random.default_rng(seed)
    rate = math.exp(random.uniform(math.log(20.0), math.log(8000.0)))
    quantum = TURN / 2.0 ** random.integers(8, 19)
    size = math.exp(random.uniform(math.log(0.1), math.log(min(50.0, 0.5 * rate))))
    t = np.arange(1, min(round(seconds * rate), MOST) + 1) / rate
    fine = np.linspace(0.0, t[-1], 8 * t.size + 1)
    speed = MOTIONS[random.integers(len(MOTIONS))](random, fine, size)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine))])
    angle, speed = angle[8::8] + random.uniform(0.0, TURN), speed[8::8]
    readings = np.mod(np.floor(angle / quantum) * quantum, TURN)
    return Clean(START + np.rint(t * 1e9).astype(np.int64), readings, speed, quantum)
