# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""edge_adaptive at starts of motion: its error with the quantum given, and with it found.

    python test/quantum_starts.py

prints the starts at which the two differ by more than 5 % once the quantum is found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from observer_cases import make, stamps, wrapped

REST = 0.2  # [s] the shaft stands before it moves
LENGTH = 1.0  # [s] of motion; but `LEAST` samples at least
LEAST = 400
COUNTS = (512, 4096, 16384, 65536, 1048576)
RATES = (200.0, 500.0, 1000.0, 4000.0)
SPEEDS = (0.3, 3.0, 10.0, 30.0, 100.0)  # [rad/s]


class Start(NamedTuple):
    """A joint that rests, and then turns.

    kind : 'jump' (at once), 'motor' (time constant `constant` [s]), 'ramp' (`constant` [s] to full
    speed) or 'sine' (of this period [s]). phase : of a sample. offset : of a count.
    """

    kind: str
    constant: float
    speed: float
    rate: float
    counts: int
    phase: float
    offset: float

    @property
    def quantum(self) -> float:
        return 2.0 * math.pi / self.counts


class Compared(NamedTuple):
    """found : readings from the first that moved to the one that shows the quantum; -1: none does.

    given, unknown : rms error from then on [rad/s].
    """

    found: int
    given: float
    unknown: float


def starts(count: int = 150, seed: int = 12) -> Iterator[Start]:
    """Starts at random; the speed is below half a turn in four samples."""
    random = np.random.default_rng(seed)
    for i in range(count):
        kind = ('jump', 'motor', 'ramp', 'sine', 'motor')[i % 5]
        constant = {
            'jump': 0.0,
            'motor': random.choice((0.005, 0.02, 0.05, 0.2)),
            'ramp': random.choice((0.02, 0.1, 0.5)),
            'sine': random.choice((0.2, 1.0)),
        }[kind]
        rate = float(random.choice(RATES))
        speed = float(random.choice([v for v in SPEEDS if v < 0.25 * math.pi * rate]))
        counts = int(random.choice(COUNTS))
        phase, offset = random.random(2)
        yield Start(kind, float(constant), speed, rate, counts, float(phase), float(offset))


def motion(start: Start, since: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(angle [rad], velocity [rad/s]) at the time `since` [s] the start."""
    speed, constant = start.speed, start.constant
    moving = np.clip(since, 0.0, None)
    if start.kind == 'jump':
        return speed * moving, np.where(since > 0.0, speed, 0.0)
    if start.kind == 'motor':
        velocity = speed * -np.expm1(-moving / constant)
        return speed * moving - constant * velocity, velocity
    if start.kind == 'ramp':
        rising = np.minimum(moving, constant)
        return speed * (moving - rising + 0.5 * rising**2 / constant), speed * rising / constant
    w = 2.0 * math.pi / constant
    return speed / w * (1.0 - np.cos(w * moving)), speed * np.sin(w * moving)


def stream(start: Start) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(stamps [ns], readings [rad], true velocity [rad/s])."""
    count = round(REST * start.rate) + max(LEAST, round(LENGTH * start.rate))
    time = (np.arange(count) - start.phase) / start.rate - REST
    angle, velocity = motion(start, time)
    angle = angle + start.offset * start.quantum
    read = wrapped(np.floor(angle / start.quantum) * start.quantum)
    return stamps(count, 1.0 / start.rate), read, velocity


def states(start: Start, gains: dict) -> tuple[list, np.ndarray]:
    """(states of the observer, estimated velocities [rad/s]) after every reading."""
    at, read, _ = stream(start)
    joint = make('edge_adaptive', gains)
    after, velocity = [], []
    for stamp, reading in zip(at.tolist(), read.tolist()):
        joint.update(stamp, reading)
        velocity.append(joint.estimate()[1])
        after.append(joint.state)
    return after, np.array(velocity)


def quanta(after: list) -> np.ndarray:
    """Return the quantum in use [rad] after every reading."""
    return np.array([state[3][0] for state in after])


def compare(start: Start) -> Compared:
    """Compare the errors on one start from where the quantum in use is right for good."""
    _, read, truth = stream(start)
    (_, given), (after, unknown) = (states(start, g) for g in ({'quantum': start.quantum}, {}))
    first = int(np.argmax(read != read[0]))
    wrong = np.flatnonzero(np.abs(quanta(after) / start.quantum - 1.0) > 1e-3)
    found = int(wrong[-1]) + 1
    if found >= len(read):
        return Compared(-1, math.nan, math.nan)
    rms = [float(np.sqrt(np.mean((v - truth)[found:] ** 2))) for v in (given, unknown)]
    return Compared(found - first, *rms)


def main() -> None:
    differ = lost = compared = 0
    for start in starts():
        result = compare(start)
        compared += 1
        ratio = result.unknown / result.given if result.found >= 0 else math.nan
        lost += result.found < 0
        differ += not 0.95 < ratio < 1.05 and result.found >= 0
        if not 0.95 < ratio < 1.05:
            print(f'{ratio:8.3f} {result}', *start)
    print(f'{compared} starts: {differ} differ by more than 5 %, {lost} do not find the quantum')


if __name__ == '__main__':
    main()
