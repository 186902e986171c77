# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of an encoder that an angle alone can show (IEC 61800-5-2, table D.16), at random.

A case is a motion, sampled as an encoder counts it, on which one fault begins at speed; a stop is
one that real machines make, and no fault.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.signals import START_NS

Array = NDArray[Any]

TURN = 2.0 * math.pi
SECONDS, ONSET = 5.0, 2.0  # [s]
LEAST = 1.5  # counts in a sample, where a fault begins
SEEN = 8.0  # counts by which a reading is wrong when its reader can know


class Case(NamedTuple):
    """One case.

    stamps [ns], reading, truth [rad], velocity [rad/s] : shape (n,).
    quantum : [rad]. onset : index of the first wrong reading. known : index from which on a reader
    of the readings can know.
    """

    stamps: NDArray[np.int64]
    reading: Array
    truth: Array
    velocity: Array
    quantum: float
    onset: int
    known: int


def motion(rng: np.random.Generator, time: Array) -> Array:
    """Return a random motion that machines make [rad]."""
    kind, sign = rng.integers(4), rng.choice([-1.0, 1.0])
    if kind == 0:
        return sign * rng.uniform(4.0, 30.0) * time
    if kind == 1:
        speed, pulsation = rng.uniform(4.0, 20.0), TURN * rng.uniform(0.1, 2.0)
        return speed / pulsation * np.sin(pulsation * time + rng.uniform(0.0, TURN))
    if kind == 2:
        speeds = np.clip(rng.uniform(1.2, 4.0) * np.sin(TURN * rng.uniform(0.2, 0.8) * time), -1, 1)
        return sign * rng.uniform(4.0, 20.0) * np.cumsum(speeds) * (time[1] - time[0])
    fast, slow = rng.uniform(0.5, 3.0), rng.uniform(0.1, 0.5)
    return sign * 10.0 * time + 2.0 * np.sin(TURN * slow * time) + 0.4 * np.sin(TURN * fast * time)


class Onset(NamedTuple):
    """Where a fault begins: counts, changed in place from index `at` on; rate [Hz]."""

    rng: np.random.Generator
    counts: Array
    at: int
    rate: float

    def now_and_then(self) -> Array:
        """Return the onset and random indices after it, 0.3 s apart in the mean."""
        pauses = self.rng.exponential(0.2 * self.rate, 200) + 0.1 * self.rate
        found = self.at + np.cumsum(np.rint(pauses).astype(int))
        return np.r_[self.at, found[found < len(self.counts) - 8]]

    def size(self, least: float) -> int:
        """Return a random number of counts from `least` to 1000, of either sign."""
        return int(self.rng.choice([-1, 1]) * np.exp(self.rng.uniform(np.log(least), np.log(1000))))


# Each returns the index at which a reader can know; None: when the fault is seen.


def stuck(o: Onset) -> None:
    o.counts[o.at :] = o.counts[o.at - 1]


def stuck_for_a_while(o: Onset) -> int:
    end = o.at + round(o.rng.uniform(0.05, 0.5) * o.rate)
    o.counts[o.at : end] = o.counts[o.at - 1]
    return end


def lost_channel(o: Onset) -> None:
    last = o.counts[o.at - 1]
    o.counts[o.at :] = last + ((o.counts[o.at :] - last) % 2) * o.rng.choice([-1, 1])


def toggling(o: Onset) -> int:
    o.counts[o.at :] += np.arange(len(o.counts) - o.at) % 2
    return o.at + 100


def reversed_from_here(o: Onset) -> None:
    o.counts[o.at :] = 2 * o.counts[o.at - 1] - o.counts[o.at :]


def reversed_about_zero(o: Onset) -> None:
    o.counts[o.at :] *= -1


def stuck_bit(o: Onset, least: int, most: int) -> int:
    bit = int(o.rng.integers(least, most))
    flips = np.flatnonzero(np.diff((o.counts[o.at :] >> bit) & 1))
    o.counts[o.at :] &= ~(1 << bit)
    if o.rng.random() < 0.5:
        o.counts[o.at :] |= 1 << bit
    return o.at + int(flips[3]) if len(flips) > 3 else len(o.counts)


def single_zeros(o: Onset) -> None:
    o.counts[o.now_and_then()] = 0


def zeros_for_a_while(o: Onset) -> None:
    length = int(o.rng.integers(2, 20))
    for k in o.now_and_then():
        o.counts[k : k + length] = 0


def holds(o: Onset) -> int:
    length = int(o.rng.integers(3, 40))
    for k in o.now_and_then():
        o.counts[k : k + length] = o.counts[k - 1]
    return o.at + length


def single_holds(o: Onset) -> int:
    held = o.at + np.flatnonzero(o.rng.random(len(o.counts) - o.at) < 0.05)
    o.counts[held] = o.counts[held - 1]
    return int(held[0]) + 1


def counts_lost_for_a_while(o: Onset) -> int:
    length = int(o.rng.integers(3, 20))
    for k in o.now_and_then():
        lost = o.counts[min(k + length, len(o.counts)) - 1] - o.counts[k - 1]
        o.counts[k + length :] -= lost
        o.counts[k : k + length] = o.counts[k - 1]
    return o.at + length


def counts_lost_at_once(o: Onset) -> None:
    for k in o.now_and_then():
        o.counts[k:] -= int(o.rng.integers(16, 200) * np.sign(o.counts[k] - o.counts[k - 5]))


def one_jump(o: Onset) -> None:
    o.counts[o.at :] += o.size(32)


def glitches(o: Onset) -> None:
    for k in o.now_and_then():
        o.counts[k] += o.size(64)


def every_nth(o: Onset, n: int = 0) -> int:
    n = n or int(o.rng.integers(3, 11))
    tail = np.arange(len(o.counts) - o.at)
    o.counts[o.at :] = o.counts[o.at + tail // n * n]
    return o.at + 5 * n


# The fault, and the kinds that name it rightly.
FAULTS: dict[str, tuple[Callable[[Onset], int | None], tuple[str, ...]]] = {
    'stuck at speed': (stuck, ('stuck', 'stopped')),
    'stuck, then right again': (stuck_for_a_while, ('held', 'stuck')),
    'lost channel': (lost_channel, ('channel', 'stuck', 'stopped')),
    'toggling by a count': (toggling, ('toggle',)),
    'reversed': (reversed_from_here, ('reversed',)),
    'reversed about zero': (reversed_about_zero, ('reversed',)),
    'stuck bit 1 to 3': (partial(stuck_bit, least=1, most=4), ('bit', 'jump')),
    'stuck bit 6 to 10': (partial(stuck_bit, least=6, most=11), ('bit', 'jump')),
    'zero for one reading': (single_zeros, ('zero', 'glitch')),
    'zero for 2 to 19': (zeros_for_a_while, ('zero', 'glitch', 'stuck')),
    'hold of 3 to 39': (holds, ('held',)),
    'hold of one': (single_holds, ('held',)),
    'counts lost for 3 to 19': (counts_lost_for_a_while, ('lost',)),
    'counts lost at once': (counts_lost_at_once, ('lost', 'jump')),
    'jump': (one_jump, ('jump', 'lost')),
    'glitches': (glitches, ('glitch', 'zero')),
    'repetition of every second': (partial(every_nth, n=2), ('held',)),
    'repetition of every nth': (every_nth, ('held',)),
}


def sampled(rng: np.random.Generator) -> tuple[float, int, float, Array]:
    """Return (rate [Hz], counts per turn, noise [counts], time [s]) at random."""
    rate = float(rng.choice([200.0, 500.0, 1000.0, 2000.0, 4000.0]))
    per_turn = int(rng.choice([4096, 4000, 16384, 20000, 131072]))
    noise = float(rng.choice([0.0, 0.0, 0.3, 1.0]))
    return rate, per_turn, noise, np.arange(round(SECONDS * rate)) / rate


def counted(
    rng: np.random.Generator, position: Array, per_turn: int, noise: float
) -> NDArray[np.int64]:
    """Return positions [rad] as counts, with white noise [counts]."""
    exact = (position + rng.uniform(0.0, TURN)) * (per_turn / TURN)
    return np.floor(exact + noise * rng.standard_normal(len(position))).astype(np.int64)


def case(name: str, number: int) -> Case:
    """Return the case of this number of a fault."""
    fault, _ = FAULTS[name]
    rng = np.random.default_rng((number, sum(map(ord, name))))
    while True:
        rate, per_turn, noise, time = sampled(rng)
        position = motion(rng, time)
        velocity = np.gradient(position, time)
        fast = np.abs(velocity) > 0.5 * np.max(np.abs(velocity))
        fast &= np.abs(velocity) * per_turn / TURN / rate > LEAST  # counts per sample
        at = np.flatnonzero(fast & (time > ONSET) & (time < SECONDS - 1.5))
        if len(at):
            break
    onset = int(rng.choice(at))
    clean = counted(rng, position, per_turn, noise)
    counts = clean.copy()
    known = fault(Onset(rng, counts, onset, rate))
    if known is None:
        wrong = np.flatnonzero(np.abs(counts - clean) >= SEEN + 8.0 * noise)
        known = int(wrong[0]) if len(wrong) else len(counts)
    return _case(rng, time, counts, position, velocity, per_turn, onset, known)


def _case(
    rng: np.random.Generator,
    time: Array,
    counts: Array,
    position: Array,
    velocity: Array,
    per_turn: int,
    onset: int,
    known: int,
) -> Case:
    quantum = TURN / per_turn
    reading = counts * quantum
    if rng.random() < 0.7:
        reading = (counts + per_turn // 2) % per_turn * quantum - per_turn // 2 * quantum
    stamps = START_NS + np.rint(time * 1e9).astype(np.int64)
    return Case(stamps, reading, position, velocity, quantum, onset, known)


def rebound(rng: np.random.Generator, late: Array) -> Array:
    ratio = rng.uniform(0.1, 0.6)
    return -ratio * np.exp(-late / rng.uniform(0.02, 0.2))


def spring(rng: np.random.Generator, late: Array) -> Array:
    pulsation = math.pi / rng.uniform(2e-3, 2e-2)
    damping = rng.uniform(0.2, 0.8) * pulsation
    return np.exp(-damping * late) * np.cos(pulsation * late)


# (time since the impact [s]) -> the speed over that before
STOPS: dict[str, Callable[[np.random.Generator, Array], Array]] = {
    'impact on a stop, with a rebound': rebound,
    'impact on a spring of 1 to 10 ms': spring,
    'a gripper that closes in 5 to 50 ms': lambda rng, late: np.maximum(
        0.0, 1.0 - late / rng.uniform(5e-3, 5e-2)
    ),
    'impact without rebound, within a sample': lambda rng, late: np.zeros(len(late)),
}


def stop(name: str, number: int) -> Case:
    """Return a stop that real machines make: no fault."""
    rng = np.random.default_rng((number, sum(map(ord, name))))
    rate, per_turn, noise, time = sampled(rng)
    at, fine = rng.uniform(2.0, 3.0), 20
    dense = np.arange(len(time) * fine) / (rate * fine)
    top = rng.uniform(2.0, 20.0)
    speed = top * np.where(dense < 0.3, dense / 0.3, 1.0)
    speed[dense >= at] = top * STOPS[name](rng, dense[dense >= at] - at)
    position, velocity = np.cumsum(speed)[::fine] / (rate * fine), speed[::fine]
    counts = counted(rng, position, per_turn, noise)
    return _case(rng, time, counts, position, velocity, per_turn, len(time), len(time))
