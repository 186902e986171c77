# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of an encoder that an angle alone can show (IEC 61800-5-2, table D.16), at random.

A case is a motion, sampled as an encoder counts it, on which one fault begins at speed; a stop is
one that real machines make, and no fault.
"""

from __future__ import annotations

import math
from collections.abc import Callable
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


class Faulted(NamedTuple):
    """Counts with a fault, and the index at which its reader can know; None: when it is seen."""

    counts: Array
    known: int | None = None


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


def stuck(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    counts[at:] = counts[at - 1]
    return Faulted(counts)


def stuck_for_a_while(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    end = at + round(rng.uniform(0.05, 0.5) * rate)
    counts[at:end] = counts[at - 1]
    return Faulted(counts, end)


def lost_channel(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    counts[at:] = counts[at - 1] + ((counts[at:] - counts[at - 1]) % 2) * rng.choice([-1, 1])
    return Faulted(counts)


def toggling(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    counts[at:] += np.arange(len(counts) - at) % 2
    return Faulted(counts, at + 100)


def reversed_from_here(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    counts[at:] = 2 * counts[at - 1] - counts[at:]
    return Faulted(counts)


def reversed_about_zero(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    counts[at:] = -counts[at:]
    return Faulted(counts)


def _bit(bit: int, rng: np.random.Generator, counts: Array, at: int) -> Faulted:
    clean = counts.copy()
    mask = 1 << bit
    counts[at:] = counts[at:] | mask if rng.random() < 0.5 else counts[at:] & ~mask
    flips = np.flatnonzero(np.diff((clean[at:] >> bit) & 1))
    return Faulted(counts, at + int(flips[3]) if len(flips) > 3 else len(counts))


def stuck_low_bit(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    return _bit(int(rng.integers(1, 4)), rng, counts, at)


def stuck_high_bit(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    return _bit(int(rng.integers(6, 11)), rng, counts, at)


def _now_and_then(rng: np.random.Generator, at: int, end: int, rate: float, every: float) -> Array:
    found = at + np.cumsum(np.rint(rng.exponential(every * rate, 200) + 0.1 * rate).astype(int))
    return np.r_[at, found[found < end - 8]]


def single_zeros(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    counts[_now_and_then(rng, at, len(counts), rate, 0.2)] = 0
    return Faulted(counts)


def zeros_for_a_while(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    length = int(rng.integers(2, 20))
    for k in _now_and_then(rng, at, len(counts), rate, 0.2):
        counts[k : k + length] = 0
    return Faulted(counts)


def holds(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    length = int(rng.integers(3, 40))
    for k in _now_and_then(rng, at, len(counts), rate, 0.2):
        counts[k : k + length] = counts[k - 1]
    return Faulted(counts, at + length)


def single_holds(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    held = at + np.flatnonzero(rng.random(len(counts) - at) < 0.05)
    counts[held] = counts[held - 1]
    return Faulted(counts, int(held[0]) + 1)


def counts_lost_for_a_while(
    rng: np.random.Generator, counts: Array, at: int, rate: float
) -> Faulted:
    length, first = int(rng.integers(3, 20)), None
    for k in _now_and_then(rng, at, len(counts), rate, 0.2):
        lost = counts[min(k + length, len(counts)) - 1] - counts[k - 1]
        counts[k + length :] -= lost
        counts[k : k + length] = counts[k - 1]
        first = first or k + length
    return Faulted(counts, first)


def counts_lost_at_once(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    for k in _now_and_then(rng, at, len(counts), rate, 0.2):
        counts[k:] -= int(rng.integers(16, 200) * np.sign(counts[k] - counts[k - 5]))
    return Faulted(counts)


def one_jump(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    counts[at:] += int(rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(32), np.log(1000))))
    return Faulted(counts)


def glitches(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    for k in _now_and_then(rng, at, len(counts), rate, 0.2):
        counts[k] += int(rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(64), np.log(1000))))
    return Faulted(counts)


def _every(n: int, counts: Array, at: int) -> Faulted:
    tail = np.arange(len(counts) - at)
    counts[at:] = counts[at + tail // n * n]
    return Faulted(counts, at + 5 * n)


def every_second(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    return _every(2, counts, at)


def every_nth(rng: np.random.Generator, counts: Array, at: int, rate: float) -> Faulted:
    return _every(int(rng.integers(3, 11)), counts, at)


FAULTS: dict[str, tuple[Callable[..., Faulted], tuple[str, ...]]] = {
    'stuck at speed': (stuck, ('stuck', 'stopped')),
    'stuck, then right again': (stuck_for_a_while, ('held', 'stuck')),
    'lost channel': (lost_channel, ('channel', 'stuck', 'stopped')),
    'toggling by a count': (toggling, ('toggle',)),
    'reversed': (reversed_from_here, ('reversed',)),
    'reversed about zero': (reversed_about_zero, ('reversed',)),
    'stuck bit 1 to 3': (stuck_low_bit, ('bit', 'jump')),
    'stuck bit 6 to 10': (stuck_high_bit, ('bit', 'jump')),
    'zero for one reading': (single_zeros, ('zero', 'glitch')),
    'zero for 2 to 19': (zeros_for_a_while, ('zero', 'glitch', 'stuck')),
    'hold of 3 to 39': (holds, ('held',)),
    'hold of one': (single_holds, ('held',)),
    'counts lost for 3 to 19': (counts_lost_for_a_while, ('lost',)),
    'counts lost at once': (counts_lost_at_once, ('lost', 'jump')),
    'jump': (one_jump, ('jump', 'lost')),
    'glitches': (glitches, ('glitch', 'zero')),
    'repetition of every second': (every_second, ('held',)),
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
    counts, known = fault(rng, clean.copy(), onset, rate)
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


STOPS = {
    'impact on a stop, with a rebound': (0.1, 0.6),
    'impact on a spring of 1 to 10 ms': (0.0, 0.0),
    'a gripper that closes in 5 to 50 ms': (0.0, 0.0),
    'a strike: the speed jumps': (0.0, 0.0),
    'impact without rebound, within a sample': (0.0, 0.0),
}


def stop(name: str, number: int) -> Case:
    """Return a stop that real machines make: no fault."""
    rng = np.random.default_rng((number, sum(map(ord, name))))
    rate, per_turn, noise, time = sampled(rng)
    at, fine = rng.uniform(2.0, 3.0), 20
    dense = np.arange(len(time) * fine) / (rate * fine)
    speed = np.full(len(dense), rng.uniform(2.0, 20.0))
    speed *= np.where(dense < 0.3, dense / 0.3, 1.0)
    after = dense >= at
    late = dense[after] - at
    top = speed[-1]
    if 'rebound,' in f'{name},' and 'with a' in name:
        ratio = rng.uniform(0.1, 0.6)
        speed[after] = -ratio * top * np.exp(-late / rng.uniform(0.02, 0.2))
    elif 'spring' in name:
        pulsation = math.pi / rng.uniform(2e-3, 2e-2)
        damping = rng.uniform(0.2, 0.8) * pulsation
        speed[after] = top * np.exp(-damping * late) * np.cos(pulsation * late)
    elif 'gripper' in name:
        speed[after] = top * np.maximum(0.0, 1.0 - late / rng.uniform(5e-3, 5e-2))
    elif 'strike' in name:
        speed[after] = top * rng.uniform(-2.0, 3.0) * np.exp(-late / rng.uniform(0.1, 1.0))
    else:
        speed[after] = 0.0
    dense_position = np.cumsum(speed) / (rate * fine)
    position, velocity = dense_position[::fine], speed[::fine]
    counts = counted(rng, position, per_turn, noise)
    return _case(rng, time, counts, position, velocity, per_turn, len(time), len(time))
