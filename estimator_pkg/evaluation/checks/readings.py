# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One joint's readings in the form that the checks share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from estimator_pkg.driver.batch import Estimates
from estimator_pkg.evaluation.checks.row import Finding
from estimator_pkg.evaluation.delay import Delay
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.matching import pieces
from estimator_pkg.evaluation.reference.quantum import quantum, steady
from estimator_pkg.evaluation.signals import wrapped
from estimator_pkg.evaluation.text import interval

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Mask = NDArray[np.bool_]

DIFFERENCE = Entry('', 'finite_difference')
TIMES_NAMED = 5  # largest number of times in a text
MOVING_COUNTS = 3.0  # a joint moves where it passes this many quanta per sample, over
MEAN_OVER = 21  # samples
NEAR_COUNTS, SIZES_PART = 8.0, 0.02  # changes of two sizes, each this often
COUNTED_PART = 0.02  # readings of which this fraction repeats the one before are counted
JUMP_SIDE = 5  # moves on either side that a jump is compared with
JUMP_MOVES = 7.5  # a jump differs from their median by this many times their size,
JUMP_COUNTS, JUMP_NOISE = 8.0, 10.0  # and this many quanta, and deviations of the noise,
JUMP_NEIGHBOURS = 0.3  # and its neighbours are this fraction of it at most, or lead back
JUMP_SPEEDS = 1.5  # and is faster than this many times the joint elsewhere,
LEAST_JUMP_SPEED = 0.1  # and than any joint can move [rad/s or m/s]
LEAST_MOTION = 1e-6  # smaller changes are rest [rad or m]
REST_NOISE = 4.0  # a range beyond that of white noise by this many deviations is motion
JUMP_RANGE = 1e-3  # and this fraction of the range
BURST = 0.5  # of the mean sample time: copies of a reading follow each other sooner
STUCK_READINGS = 4  # a sensor sticks for at least this many readings
CATCH_UP = 0.4  # and then catches up this fraction of the way that it missed
OVER = 0.1  # time over which a speed is averaged [s]
CATCH_UP_MOVES = 1.5  # a reading after a repeated one moves by this many times its neighbours
SELDOM_WRAPS = 1e-3  # of the moves: a smaller part of wraps is none
STALE = 0.2  # a larger fraction of equal readings in motion is not chance


@dataclass(frozen=True)
class Readings:
    """One joint's readings in the order of their arrival.

    name : of the joint.
    stamps_ns, arrival_ns : shape (n,), header stamps and times of publishing [ns].
    position : shape (n,) [rad or m], nan for a missing or unusable one.
    velocity : shape (n,), the velocity in the same messages [rad/s or m/s], nan without one.
    period : wrap period [rad]; 0: none.
    start_ns : the time zero of texts.
    free : the wrap period that was set is replaced: by none, see `as_read`, or by that of degrees.
    log : of a log, whose stamps are its only times.
    """

    name: str
    stamps_ns: Rows
    arrival_ns: Rows
    position: Array
    velocity: Array
    period: float
    start_ns: int = 0
    free: bool = False
    log: bool = False

    @cached_property
    def difference(self) -> Estimates:
        """The low-passed finite difference, with the verdicts of the guard that every node has."""
        joint = DIFFERENCE.joint(wrap_period=self.period)
        return joint.run(self.stamps_ns, self.position)

    @cached_property
    def parts(self) -> list[Rows]:
        """Indices of the usable readings, in pieces without a jump of the clock."""
        good = np.flatnonzero(np.isfinite(self.position) & (self.stamps_ns > 0))
        return [good[part] for part in pieces(self.stamps_ns[good]) if len(part) > 2]

    @cached_property
    def rows(self) -> Rows:
        """Indices of the usable readings, in the order of their stamps within each piece."""
        return np.concatenate(self.parts) if self.parts else np.zeros(0, np.int64)

    @cached_property
    def joined(self) -> Mask:
        """Shape (m - 1,): True where a row and the next belong to one piece."""
        found = np.ones(max(len(self.rows) - 1, 0), bool)
        found[np.cumsum([len(part) for part in self.parts], dtype=np.int64)[:-1] - 1] = False
        return found

    @cached_property
    def steps(self) -> Array:
        """Shape (m - 1,): the time from a row to the next [s]; only where `joined`."""
        return np.diff(self.stamps_ns[self.rows]) * 1e-9

    @cached_property
    def step(self) -> float:
        """Median sample time [s]; nan for too few readings."""
        steps = self.steps[self.joined]
        return float(np.median(steps)) if len(steps) else np.nan

    @cached_property
    def raw(self) -> Array:
        """Readings of the rows [rad or m], shape (m,)."""
        return self.position[self.rows]

    @cached_property
    def moves(self) -> Array:
        """Change of the reading to the next row [rad or m], the shorter way, shape (m - 1,)."""
        return np.where(self.joined, wrapped(np.diff(self.raw), self.period), 0.0)

    @cached_property
    def quantum(self) -> float:
        """Distance of neighbouring levels of the readings; 0 if they are not quantised.

        Each wrap by a period that is no multiple of it shifts the levels, so changes count too.
        """
        found = quantum(self.raw)
        size = np.abs(self.moves[self.joined])
        changed = size[size > 1e-9]
        if len(changed) < 2 * MEAN_OVER:
            return found
        low = float(np.percentile(changed, 10))
        near = size[size < NEAR_COUNTS * low] / low
        whole = np.rint(near)
        kinds = np.bincount(whole.astype(np.int64)) > SIZES_PART * len(near)
        if np.mean(np.abs(near - whole) < 0.1) < 0.95 or np.count_nonzero(kinds[1:]) < 2:
            return found
        step = low * float(np.sum(near) / np.sum(whole))
        return step if found < 0.7 * step and not steady(self.moves, step) else found

    @property
    def raw_counts(self) -> bool:
        """True if the quantum is a whole number of rad: counts of an encoder, or another unit."""
        unit = self.quantum if self.period or self.free else 0.0
        return unit > 0.5 and abs(unit - round(unit)) < 1e-4 * unit

    @property
    def own_quantum(self) -> float:
        """The quantum for a node; 0: none, or that of another unit."""
        return 0.0 if self.raw_counts else self.quantum

    @cached_property
    def never_wraps(self) -> bool:
        """True if the readings pass more than the wrap period, or would, without any wrap."""
        near = self.joined & (self.steps < 1.5 * self.step)
        moves = np.diff(self.raw)[near]
        if len(moves) < 2 * JUMP_SIDE:
            return False
        usual = np.median(sliding_window_view(np.pad(moves, 2, 'reflect'), 5), axis=1)
        return bool(np.mean(np.abs(moves - usual) > 0.5 * self.period) < SELDOM_WRAPS)

    @cached_property
    def range(self) -> float:
        """The way between the extremes of `path`."""
        return float(np.ptp(self.path))

    @cached_property
    def grain(self) -> float:
        """The quantum; of readings on two lattices, as after a flip, a small change of theirs."""
        if self.quantum:
            return self.quantum
        size = np.abs(self.moves[self.joined])
        changed = size[size > 1e-9]
        counted = len(changed) > MEAN_OVER and len(changed) < (1.0 - COUNTED_PART) * len(size)
        return float(np.percentile(changed, 10)) if counted else 0.0

    @cached_property
    def scatter(self) -> float:
        """Deviation of neighbouring readings from a straight line: noise, and bends."""
        return 1.4826 * float(np.median(np.abs(np.diff(self.moves)))) / np.sqrt(6.0)

    @cached_property
    def noise(self) -> float:
        """Deviation of white noise with the same third differences, in the slower half."""
        third, size = np.abs(np.diff(self.moves, 2)), np.abs(self.moves[1:-1])
        slow = third[size <= np.median(size)]
        return 1.4826 * float(np.median(slow)) / np.sqrt(20.0) if len(slow) else 0.0

    @cached_property
    def at_rest(self) -> bool:
        """True if the joint moves by no more than its readings' noise or three quanta.

        Of white noise, the slower half of the moves is less: all of them tell its size.
        """
        noise = 1.4826 * float(np.median(np.abs(np.diff(self.moves, 2)))) / np.sqrt(20.0)
        white = REST_NOISE + 2.0 * np.sqrt(2.0 * np.log(len(self.rows)))  # and extremes of it
        least = max(3.0 * self.grain, white * noise, LEAST_MOTION)
        return not self.alternating and self.range <= least

    @cached_property
    def alternating(self) -> bool:
        """True if every other reading belongs to another motion."""
        size, two = np.abs(self.moves), np.abs(self.moves[1:] + self.moves[:-1])
        usual = float(np.median(size))
        return bool(np.median(two) < 0.1 * usual and usual > 10.0 * self.grain)

    @cached_property
    def speed(self) -> float:
        """Largest mean speed over `OVER` seconds."""
        return self._speed_of(self.path)

    def _speed_of(self, path: Array) -> float:
        across = max(1, round(OVER / self.step))
        if len(path) <= across:
            return float(np.ptp(path) / max(float(np.sum(self.steps[self.joined])), 1e-9))
        return float(np.percentile(np.abs(path[across:] - path[:-across]), 99.9)) / (
            across * self.step
        )

    @cached_property
    def moving(self) -> Mask:
        """Shape (m - 1,): more than `MOVING_COUNTS` quanta per sample pass before and after."""
        size = np.abs(self.moves)
        if len(size) <= 2 * MEAN_OVER:
            return np.zeros(len(size), bool)
        mean = sliding_window_view(size, MEAN_OVER).mean(axis=1)
        both = np.minimum(mean[:-MEAN_OVER], mean[MEAN_OVER:])  # before and after
        mean = np.zeros(len(size))
        mean[MEAN_OVER:-MEAN_OVER] = both[: len(size) - 2 * MEAN_OVER]
        floor = MOVING_COUNTS * self.grain or max(1e-3 * self.range / MEAN_OVER, 2.0 * self.scatter)
        return mean > floor

    @cached_property
    def equal(self) -> float:
        """Fraction of the readings in motion that repeat the one before; nan without motion."""
        moving = self.moving & self.joined
        if np.count_nonzero(moving) < 2 * MEAN_OVER:
            return np.nan
        return float(np.mean(np.abs(self.moves[moving]) <= 0.01 * self.grain))

    @cached_property
    def copies(self) -> int:
        """How often each reading is sent, in a burst with a stamp for each; 1: once."""
        steps = self.steps[self.joined]
        close = steps < BURST * float(np.mean(steps))
        copied = close & (self.moves[self.joined] == 0.0)
        between = float(np.mean(~close))
        regular = np.mean(close) >= 0.4 and np.mean(copied[close]) > 0.95
        return round(1.0 / between) if regular and between > 0.0 and not self.at_rest else 1

    @cached_property
    def new_hz(self) -> float:
        """Rate of new readings while the joint moves [Hz]."""
        steps = self.steps[self.joined]
        if self.copies > 1:
            first = np.flatnonzero(steps > BURST * np.mean(steps))
            return 1.0 / float(np.median(np.diff(np.cumsum(steps)[first])))
        return (1.0 - self.equal) / self.step

    @cached_property
    def leaps(self) -> Mask:
        """Where a move is far larger than those on both sides (shape (m - 1,))."""
        size = np.abs(self.moves)
        changed = np.flatnonzero(self.joined & (size > 0.01 * self.grain))
        found = np.zeros(len(size), bool)
        if len(changed) < 2 * JUMP_SIDE:
            return found
        moves = self.moves[changed] / np.maximum(1.0, np.rint(self.steps[changed] / self.step))
        floor = max(
            JUMP_COUNTS * self.grain,
            JUMP_NOISE * self.scatter,
            JUMP_RANGE * float(np.ptp(np.cumsum(self.moves))),
        )
        around = np.arange(len(moves))
        usual = np.median(
            sliding_window_view(np.pad(moves, JUMP_SIDE, 'reflect'), 2 * JUMP_SIDE + 1), 1
        )
        size, padded = np.abs(moves), np.pad(moves, 1)
        near = np.maximum(np.abs(padded[:-2]), np.abs(padded[2:]))
        back = np.minimum(np.abs(moves + padded[:-2]), np.abs(moves + padded[2:]))
        found[changed] = (
            np.abs(moves - usual) > np.maximum(JUMP_MOVES * neighbour_motion(size, around), floor)
        ) & (np.minimum(near, back) < JUMP_NEIGHBOURS * size)
        found &= ~self.released
        if not found.any():
            return found
        # a joint can make the speed that it has elsewhere
        path = np.cumsum(np.where(found, 0.0, self.moves))
        speed = max(JUMP_SPEEDS * self._speed_of(path), LEAST_JUMP_SPEED)
        return found & (np.abs(self.moves) > np.maximum(speed * self.steps, LEAST_MOTION))

    @cached_property
    def released(self) -> Mask:
        """Where a reading that was held catches up (shape (m - 1,)).

        The joint moves before and after, and the reading is equal for `STUCK_READINGS` samples or
        more. A slow joint may rest, so there it must then go most of the way that it would have
        gone.
        """
        size = np.abs(self.moves)
        found = np.zeros(len(size), bool)
        still = self.joined & (size <= 0.01 * self.grain)
        edges = np.flatnonzero(np.diff(np.r_[False, still, False].astype(np.int8)))
        first, last = edges[::2], edges[1::2]  # moves first .. last - 1 are zero
        long = (
            (last - first >= STUCK_READINGS) & (first >= JUMP_SIDE) & (last + JUMP_SIDE < len(size))
        )
        for a, b in zip(first[long].tolist(), last[long].tolist()):
            before = float(np.median(self.moves[a - JUMP_SIDE : a]))
            after = float(np.median(self.moves[b + 1 : b + 1 + JUMP_SIDE]))
            missed = 0.5 * (before + after) * (b - a + 1)
            far = abs(missed) > max(8.0 * self.grain, 4.0 * max(abs(before), abs(after)))
            caught = far and CATCH_UP < self.moves[b] / missed < 1.0 / CATCH_UP
            moved = min(abs(before), abs(after)) > max(MOVING_COUNTS * self.grain, self.scatter)
            sudden = abs(self.moves[b]) > 3.0 * max(abs(before), abs(after))
            if (caught and before * after > 0.0) or (moved and sudden):
                found[b] = True
        return found

    @property
    def stale(self) -> bool:
        """True if the same reading is published several times."""
        return self.equal > STALE

    @cached_property
    def path(self) -> Array:
        """Unwrapped motion [rad or m] from 0 on, without jumps, shape (m,)."""
        return np.concatenate([[0.0], np.cumsum(np.where(self.leaps, 0.0, self.moves))])

    @cached_property
    def repeats(self) -> Rows:
        """Where a single reading repeats the one before, and the next catches up (of moves)."""
        size = np.abs(self.moves)
        around = neighbour_motion(size, np.arange(len(size)))
        at = np.flatnonzero(self.moving[:-1] & (size[:-1] <= 0.01 * self.grain))
        at = at[
            (around[at] > MOVING_COUNTS * self.grain) & (size[at + 1] > CATCH_UP_MOVES * around[at])
        ]
        return at[self.joined[at] & self.joined[at + 1]]

    def count(self, *verdicts: int) -> int:
        """Return the number of samples with one of these verdicts of the guard."""
        return int(np.count_nonzero(np.isin(self.difference.verdict, verdicts)))

    def when(self, rows: Rows, arrival: bool = False) -> list[float]:
        """Return the times [s] of these samples, from `start_ns`."""
        stamps = self.arrival_ns - self.arrival_ns[0] if arrival else self.stamps_ns - self.start_ns
        return [float(each) * 1e-9 for each in stamps[rows]]

    def of(self, *verdicts: int) -> Rows:
        """Return the samples with one of these verdicts of the guard."""
        return np.flatnonzero(np.isin(self.difference.verdict, verdicts))


def neighbour_motion(size: Array, at: Rows) -> Array:
    """Return the larger of the median moves before and after these [rad or m], shape (n,)."""
    padded = np.pad(size, JUMP_SIDE, mode='reflect')
    medians = np.median(sliding_window_view(padded, JUMP_SIDE), axis=1)
    return np.asarray(np.maximum(medians[at], medians[at + JUMP_SIDE + 1]))


def times(seconds: list[float]) -> str:
    """Return times for a text, as 'at 1.20 s, 3.41 s and 7 more'."""
    more = f' and {len(seconds) - TIMES_NAMED} more' if len(seconds) > TIMES_NAMED else ''
    return 'at ' + ', '.join(f'{each:.2f} s' for each in seconds[:TIMES_NAMED]) + more


def plural(count: int, name: str) -> str:
    """Return '1 hole' or '2 holes'."""
    return f'{count} {name}{"s" * (count > 1)}'


def late_by(late: Delay) -> str:
    """Return a delay for a text."""
    known = interval(1e3 * late.late, 1e3 * late.half, 'ms')
    return 'delay not determined' if known == '-' else f'{known} late'


def to_mend(failed: Sequence[Finding]) -> str:
    """Return why nothing is recommended while these checks FAIL, and what to do, as sentences."""
    return '. '.join(f'{each.value}. Mend this first: {each.remedy}' for each in failed)


def short(seconds: float) -> str:
    """Return a time with its unit: 1.23 s, 4.5 ms, 67 us."""
    if not np.isfinite(seconds):
        return '-'
    for factor, unit in ((1.0, 's'), (1e3, 'ms')):
        if abs(seconds) * factor >= 0.9995:
            return f'{seconds * factor:.3g} {unit}'
    return f'{seconds * 1e6:.3g} us'
