# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""An angle sensor and its transport, with every fault that users report.

Faults of the value (`AngleSensor`, one per joint): those of the table `ERRORS`, quantisation,
repeated readings, a stuck sensor, the wrap convention. Faults of time and transport (`Line`, one
per stream): jitter of sampling and of stamps, dropped and duplicated samples, gaps, bursts.

Each fault draws from its own random stream, one draw per sample whatever happens to the sample.
Enabling one fault, or changing its rate, does not change the draws of the others.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError
from estimator_pkg.parameters import structural

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
Mask = NDArray[np.bool_]

SECOND = 1_000_000_000  # [ns]
TURN = 2.0 * math.pi
SIGNED, UNSIGNED, MULTI_TURN, RAW_COUNTS = 'signed', 'unsigned', 'multi_turn', 'raw_counts'

chance = partial(structural, 0.0, range=(0.0, 1.0))
interval = partial(structural, unit='s', range=(0.0, 1e6))


@dataclass(frozen=True)
class SensorParameters:
    """The sensor and its faults; by default it only quantises."""

    rate: float = structural(1000.0, unit='Hz', range=(0.01, 1e5), description='samples per second')
    counts_per_revolution: int = structural(
        4096,
        unit='counts',
        range=(0, 2**31 - 1),
        description='resolution; the angle is rounded down to a count, so its mean error is minus '
        'half a count; 0: no quantisation',
    )
    convention: str = structural(
        SIGNED,
        choices=(SIGNED, UNSIGNED, MULTI_TURN, RAW_COUNTS),
        description='wrap convention of the angle: [-pi, pi), [0, 2 pi), multi-turn, or counts in '
        '[0, counts_per_revolution) as std_msgs/Int32 on the topic angle',
    )
    noise: float = structural(
        0.0,
        unit='rad',
        range=(0.0, 10.0),
        description='standard deviation of white Gaussian noise, before quantisation',
    )
    eccentricity: float = structural(
        0.0,
        unit='rad',
        range=(0.0, 1.0),
        description='amplitude of an error that is a sine of the angle, as of an eccentric disc',
    )
    outliers: float = chance(description='fraction of readings with an error of outlier_size')
    outlier_size: float = structural(
        1.0, unit='rad', range=(0.0, 1e3), description='size of an outlier, of either sign'
    )
    repeated: float = chance(
        description='fraction of samples that repeat the previous reading with a new stamp'
    )
    update_every: int = structural(
        1,
        unit='samples',
        range=(1, 1_000_000),
        description='the sensor gives a new reading every n-th sample and repeats it in between',
    )
    stuck_every: float = interval(
        0.0, description='mean time until the sensor sticks at its reading; 0: never'
    )
    stuck_length: float = interval(0.2, description='how long the sensor sticks')
    sampling_jitter: float = interval(
        0.0,
        description='largest delay of sampling, uniformly distributed; stamps carry the true time; '
        'must be shorter than one sample time',
    )
    stamp_jitter: float = interval(
        0.0,
        range=(0.0, 100.0),
        description='largest error of a stamp, either way, uniformly distributed; sampling is on '
        'time',
    )
    dropped: float = chance(description='fraction of samples that never arrive')
    duplicated: float = chance(
        description='fraction of messages that arrive twice, with the same stamp'
    )
    gap_every: float = interval(
        0.0, description='mean time until a gap, in which no message arrives; 0: never'
    )
    gap_length: float = interval(0.3, description='how long a gap lasts')
    burst_every: float = interval(
        0.0, description='mean time until messages are delayed and arrive all at once; 0: never'
    )
    burst_length: float = interval(0.05, description='how long a burst delays messages')

    def __post_init__(self) -> None:
        """Check what a range cannot express; raise UsageError."""
        if self.convention == RAW_COUNTS and self.counts_per_revolution == 0:
            raise UsageError("convention 'raw_counts' needs 'counts_per_revolution' > 0: set it")
        if self.sampling_jitter >= 1.0 / self.rate:
            raise UsageError(
                f"parameter 'sampling_jitter' = {self.sampling_jitter:g} must be "
                f'shorter than one sample time, {1.0 / self.rate:g} s'
            )

    @property
    def period(self) -> float:
        """Sample time [s]."""
        return 1.0 / self.rate


def random_stream(seed: int, purpose: str, joint: int = 0) -> np.random.Generator:
    """Return the generator of this purpose and joint, independent of all other purposes."""
    return np.random.Generator(
        np.random.PCG64(np.random.SeedSequence([seed, zlib.crc32(purpose.encode()), joint]))
    )


class Episodes:
    """Random episodes of a fault, each over consecutive samples.

    Parameters
    ----------
    parameters : for a fault `name`, `name`_every is the mean time from the end of one episode to
        the start of the next [s] (0: never), and `name`_length that of each, at least one sample.
    seed, joint : determine the random stream: one draw per sample.
    """

    def __init__(self, parameters: SensorParameters, name: str, seed: int, joint: int = 0) -> None:
        every, length = (getattr(parameters, f'{name}_{what}') for what in ('every', 'length'))
        self._random = random_stream(seed, name, joint)
        self._chance = parameters.period / every if every > 0.0 else 0.0
        self._samples = max(1, round(length / parameters.period))
        self._until = 0  # sample at which the latest episode ends

    def ends(self, first: int, count: int) -> Whole:
        """Return, for samples `first` on, the sample at which their episode ends; 0: no episode.

        The result has shape (count,).
        """
        ends = np.zeros(count, np.int64)
        if self._chance == 0.0:
            return ends
        ends[: max(0, self._until - first)] = self._until
        for start in np.flatnonzero(self._random.random(count) < self._chance):
            if first + start >= self._until:
                self._until = int(first + start) + self._samples
                ends[start : start + self._samples] = self._until
        return ends


def _outliers(p: SensorParameters, angle: Floats, random: np.random.Generator) -> Floats:
    draw, sign = random.random((len(angle), 2)).T
    size = np.where(sign < 0.5, -p.outlier_size, p.outlier_size)
    return np.where(draw < p.outliers, size, 0.0)


# errors of the angle before quantisation [rad], each by the parameter that switches it on
ERRORS: dict[str, Callable[[SensorParameters, Floats, np.random.Generator], Floats]] = {
    'eccentricity': lambda p, angle, random: p.eccentricity * np.sin(angle),
    'noise': lambda p, angle, random: p.noise * random.standard_normal(len(angle)),
    'outliers': _outliers,
}


class AngleSensor:
    """One joint's sensor. Pass the true angles of all samples, in order, to `read`.

    Parameters
    ----------
    parameters : faults and resolution.
    seed, joint : determine its random streams.
    """

    def __init__(self, parameters: SensorParameters, seed: int, joint: int = 0) -> None:
        self._p = parameters
        self._random = {name: random_stream(seed, name, joint) for name in (*ERRORS, 'repeated')}
        self._stuck = Episodes(parameters, 'stuck', seed, joint)
        self._index = 0
        self._held = 0.0  # last reading, in counts if the sensor has a resolution, else in rad

    def read(self, angle: Floats) -> Floats:
        """Return the readings for these true angles [rad], shape (n,), in the wrap convention."""
        p, reading = self._p, angle
        for name, error in ERRORS.items():
            if getattr(p, name) > 0.0:
                reading = reading + error(p, angle, self._random[name])
        counts = p.counts_per_revolution
        if counts:
            reading = np.floor(reading * (counts / TURN))
        return written(self._hold(reading), counts, p.convention)

    def _hold(self, reading: Floats) -> Floats:
        """Replace readings that are not fresh by the last fresh one."""
        p, count = self._p, len(reading)
        index = np.arange(self._index, self._index + count)
        fresh = self._stuck.ends(self._index, count) == 0
        if p.update_every > 1:
            fresh &= index % p.update_every == 0
        if p.repeated > 0.0:
            fresh &= self._random['repeated'].random(count) >= p.repeated
        if self._index == 0:
            fresh[:1] = True
        source = np.maximum.accumulate(np.where(fresh, np.arange(count), -1))
        held = np.where(source < 0, self._held, reading[source])
        if count:
            self._held = float(held[-1])
            self._index += count
        return held


def written(reading: Floats, counts: int, convention: str) -> Floats:
    """Return readings of any turn in a wrap convention, in rad or counts.

    Parameters
    ----------
    reading : in counts if `counts` > 0, else in rad; shape (n,).
    counts : counts per revolution; 0: no quantisation.
    convention : one of SIGNED, UNSIGNED, MULTI_TURN (all in rad), RAW_COUNTS.
    """
    turn = float(counts) if counts else TURN
    if convention != MULTI_TURN:
        reading = reading - turn * np.floor(reading / turn)
        reading = np.where(reading >= turn, 0.0, reading)  # a tiny negative angle rounds to a turn
    if convention == SIGNED:
        reading = np.where(reading >= 0.5 * turn, reading - turn, reading)
    if convention == RAW_COUNTS or not counts:
        return reading
    return reading / counts * TURN  # in this order -pi is exact for every number of counts


class Samples(NamedTuple):
    """Times and fates of a chunk of samples; arrays of shape (n,).

    Attributes
    ----------
    taken_ns : true sampling times [ns from the start].
    stamp_ns : stamps [ns from the start].
    due_ns : arrival times [ns from the start].
    copies : number of messages that arrive: 0, 1 or 2.
    horizon_ns : no message of a later chunk arrives before this.
    """

    taken_ns: Whole
    stamp_ns: Whole
    due_ns: Whole
    copies: Whole
    horizon_ns: int

    def rows(self) -> Iterator[tuple[int, int, int, int]]:
        """Yield (taken_ns, stamp_ns, due_ns, copies) of each sample."""
        return zip(*(each.tolist() for each in self[:4]))


class Line:
    """Sampling in time, and transport from the sensor to the reader."""

    def __init__(self, parameters: SensorParameters, seed: int) -> None:
        self._p = p = parameters
        faults = 'sampling_jitter', 'stamp_jitter', 'dropped', 'duplicated'
        self._random = {name: random_stream(seed, name) for name in faults}
        self._gaps, self._bursts = (Episodes(p, name, seed) for name in ('gap', 'burst'))
        self._index = 0

    def carry(self, count: int) -> Samples:
        """Return the times of the next `count` samples."""
        p, first = self._p, self._index
        self._index += count
        index = np.arange(first, first + count)
        taken = self._grid(index)
        if p.sampling_jitter > 0.0:
            taken = taken + _whole(
                p.sampling_jitter * SECOND * self._random['sampling_jitter'].random(count)
            )
        stamp = taken
        if p.stamp_jitter > 0.0:
            uniform = 2.0 * self._random['stamp_jitter'].random(count) - 1.0
            stamp = taken + _whole(p.stamp_jitter * SECOND * uniform)
        arrives: Mask = self._gaps.ends(first, count) == 0
        if p.dropped > 0.0:
            arrives = arrives & (self._random['dropped'].random(count) >= p.dropped)
        copies = arrives.astype(np.int64)
        if p.duplicated > 0.0:
            copies *= 1 + (self._random['duplicated'].random(count) < p.duplicated)
        held_until = self._bursts.ends(first, count)
        due = np.where(held_until > 0, self._grid(held_until), taken)
        return Samples(taken, stamp, due, copies, int(self._grid(np.array([self._index]))[0]))

    def _grid(self, index: Whole) -> Whole:
        return _whole(index.astype(np.float64) * (SECOND / self._p.rate))


def _whole(nanoseconds: Floats) -> Whole:
    return np.rint(nanoseconds).astype(np.int64)
