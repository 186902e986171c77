# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of the readings: resolution, wrap, jumps, repeats, a sensor that sticks, rest."""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg.evaluation.checks.readings import (
    BESIDE,
    FAIL,
    PASS,
    WARN,
    Array,
    Finding,
    Readings,
    beside,
    short,
    times,
)
from estimator_pkg.sensor.guard import REPEATED

TURN = 2.0 * math.pi
COARSE = 1000.0  # fewer counts per turn are coarse
NOISY = 2e-3  # noise of a reading above this [rad or m], and above
NOISY_COUNTS = 3.0  # this many quanta, is more than a sensor should have
ALTERNATING = 0.02  # a larger fraction of jumps there and back: two sources
NEAR_END = 3.0  # a wrap begins and ends within this many moves of the range's ends
AROUND, MOSTLY = 50, 0.8  # samples that show the motion; fraction of the wraps that agree
OTHER_PERIOD = 0.01  # relative difference from the wrap period that counts
MOST_LINES = 1e5  # counts per turn of encoders with a decimal number of lines
TOO_FAST = 0.4  # moves beyond this fraction of the wrap period are ambiguous soon
SELDOM, FEW = 0.005, 5  # repeated readings up to this fraction, or number, are not reported


def finite(seen: Readings) -> Finding:
    """Return how many readings are missing, not finite, or beyond any encoder's range."""
    count = int(np.count_nonzero(~np.isfinite(seen.position)))
    total = len(seen.position)
    if not count:
        return Finding('finite readings', PASS, f'all {total}', '', {'count': 0})
    rows = np.flatnonzero(~np.isfinite(seen.position))
    return Finding(
        'finite readings',
        FAIL if count > 0.2 * total else WARN,
        f'{count} of {total} readings are NaN, infinite or absent, {times(seen.when(rows))}',
        'publish only readings that the sensor has taken',
        {'count': count},
    )


def resolution(seen: Readings) -> Finding:
    """Return the quantum, the counts per turn, and what one count is as a speed."""
    count = seen.quantum
    noise = seen.noise
    numbers = {'quantum': count, 'noise': noise}
    turn = _period(seen) or TURN
    noisy = noise > max(NOISY * turn / TURN, NOISY_COUNTS * count) and not seen.stale
    if not count:
        text = 'no counts found (a float sensor, or noise above a count)'
        if noisy:
            return Finding(
                'resolution',
                WARN,
                f'{text}; neighbouring readings scatter by {noise:.2g} rad',
                'check shielding, supply and mounting of the sensor',
                numbers,
            )
        return Finding('resolution', PASS, text, '', numbers)
    text = f'one count is {count:.4g}'
    per_turn = turn / count
    if seen.period:
        text += f' rad, {per_turn:.6g} per turn'
        numbers['counts_per_turn'] = per_turn
    text += f'; {count / seen.step:.3g} per second in a finite difference'
    if noisy:
        return Finding(
            'resolution',
            WARN,
            f'{text}; neighbouring readings scatter by {noise / count:.2g} counts',
            'check shielding, supply and mounting of the sensor',
            numbers,
        )
    if seen.period and per_turn < COARSE:
        return Finding(
            'resolution',
            WARN,
            f'{text}: coarse',
            f"set 'quantum: {count:.6g}'; use edge_adaptive or kalman; more counts, or one "
            'before the gear, help most',
            numbers,
        )
    return Finding('resolution', PASS, text, f"set 'quantum: {count:.6g}'", numbers)


def wrap(seen: Readings) -> Finding:
    """Return where the reading wraps, and whether it does so by the wrap period."""
    raw = np.diff(seen.raw)
    low, high = float(np.min(seen.raw)), float(np.max(seen.raw))
    text = f'readings from {low:.3g} to {high:.3g}'
    period = _period(seen)
    if period:
        unit = (
            'the angle is in degrees: publish radians'
            if abs(period - 360.0) < 4.0
            else (f"set 'wrap_period: {period:.6g}'")
        )
        return Finding(
            'wrap',
            FAIL,
            f'{text}; their period is {period:.4g}, not {seen.period:.4g}',
            unit,
            {'wrap_period': period},
        )
    if not seen.period:
        return Finding('wrap', PASS, f'{text}; no wrap period')
    whole = seen.joined & (np.abs(raw) > 0.5 * seen.period) & ~seen.leaps
    turns = (high - low) / seen.period
    numbers = {'wraps': int(np.count_nonzero(whole)), 'turns': turns}
    moves = np.abs(seen.moves[seen.joined])
    if np.percentile(moves, 99.0) > TOO_FAST * seen.period:
        return Finding(
            'wrap',
            FAIL,
            f'{text}; the joint moves {np.percentile(moves, 99.0):.3g} rad from one reading to '
            'the next: half a turn reads as its opposite',
            'raise the rate, or check the unit (radians)',
            numbers,
        )
    if numbers['wraps'] and turns > 1.2:
        return Finding(
            'wrap',
            WARN,
            f'{text}; they jump by whole turns {numbers["wraps"]} times, '
            + times(seen.when(seen.rows[1:][whole])),
            'the turn counter of the sensor is wrong there; observers see the angle alone',
            numbers,
        )
    how = f'{numbers["wraps"] or "no"} wrap{"s" * (numbers["wraps"] > 1)}'
    return Finding('wrap', PASS, f'{text}; {how}', '', numbers)


def _period(seen: Readings) -> float:
    """Return the period by which the readings wrap, if it is not the wrap period; else 0."""
    if seen.period and _in_degrees(seen):
        return 360.0
    raw, low, high = np.diff(seen.raw), float(np.min(seen.raw)), float(np.max(seen.raw))
    size = np.abs(raw)
    far = np.flatnonzero(seen.joined & (size > 0.5 * (high - low)))
    if not 0 < len(far) < 0.2 * len(raw):
        return 0.0
    slack = NEAR_END * (beside(size, far) + seen.quantum) + 1e-3 * (high - low)
    before, after = seen.raw[far], seen.raw[far + 1]
    ends = np.minimum(
        np.maximum(np.abs(before - low), np.abs(after - high)),
        np.maximum(np.abs(before - high), np.abs(after - low)),
    )
    # a wrap goes against the motion around it
    small = np.where(np.isin(np.arange(len(raw)), far), 0.0, raw)
    along = np.array([np.sum(small[max(0, at - AROUND) : at + AROUND]) for at in far])
    usual = np.array([_middle(raw, int(at)) for at in far])
    wraps = (ends <= slack) & (along * raw[far] < 0.0)
    if np.mean(wraps) < MOSTLY or np.max(slack) > 0.2 * (high - low):
        return 0.0
    sizes = size[far] + np.abs(usual)
    found = float(np.median(sizes[wraps]))
    if np.mean(np.abs(sizes - found) <= slack) < MOSTLY:
        return 0.0
    if seen.period and abs(found - seen.period) <= OTHER_PERIOD * seen.period + np.max(slack):
        return 0.0
    return found


def _in_degrees(seen: Readings) -> bool:
    """Return True if the quantum is that of an encoder in degrees.

    Radians that a driver rounds to decimals are no proof: 360 is a multiple of 0.001, too.
    """
    counts = 360.0 / seen.quantum if seen.quantum else 0.0
    if counts <= 100.0 or not _usual(counts) or _usual(TURN / seen.quantum):
        return False
    if round(counts) & (round(counts) - 1) == 0:
        return True  # of 2 ** n counts: no decimal is near
    decimals = -math.log10(seen.quantum)
    rounded = decimals > 1.5 and abs(decimals - round(decimals)) < 1e-4
    return not rounded and counts <= MOST_LINES and float(np.max(np.abs(seen.raw))) > TURN


def _usual(counts: float) -> bool:
    """Return True for counts per turn of encoders: powers of 2, and multiples of 100."""
    whole = round(counts)
    near = abs(counts - whole) < 1e-4 * counts
    return near and whole > 0 and (whole & (whole - 1) == 0 or whole % 100 == 0)


def _middle(moves: Array, at: int) -> float:
    """Return the median of the moves around one of them, without it."""
    return float(np.median(np.r_[moves[max(0, at - BESIDE) : at], moves[at + 1 : at + 1 + BESIDE]]))


def jumps(seen: Readings) -> Finding:
    """Return the moves that no joint can make."""
    size = np.abs(seen.moves)
    if seen.alternating:
        return _two_sources(float(np.median(size)), 1.0)
    found = np.flatnonzero(seen.leaps)
    if not len(found):
        return Finding('jumps', PASS, f'none; the largest change is {np.max(size):.3g} rad')
    part = len(found) / len(size)
    back = len(found) > 1 and np.mean(
        np.sign(seen.moves[found][1:]) != np.sign(seen.moves[found][:-1])
    )
    if part > ALTERNATING and len(found) > 20 and back > 0.8:
        return _two_sources(float(np.median(size[found])), part)
    worst = found[np.argmax(size[found])]
    events = found[np.diff(found, prepend=-BESIDE) > 2]  # there and back is one
    plural = 's' if len(events) > 1 else ''
    return Finding(
        'jumps',
        FAIL,
        f'{len(events)} jump{plural} that no joint can make, up to {size[worst]:.3g} rad within '
        f'{short(float(seen.steps[worst]))}, {times(seen.when(seen.rows[events + 1]))}',
        'a flipped pose, a slipped encoder or a damaged reading: mend or cut the record there',
        {
            'count': len(events),
            'largest': float(size[worst]),
            'times_s': seen.when(seen.rows[events + 1]),
        },
    )


def _two_sources(distance: float, part: float) -> Finding:
    return Finding(
        'jumps',
        FAIL,
        f'the readings alternate between two positions {distance:.3g} rad apart '
        f'({part:.0%} of the samples)',
        'two publishers send this joint: stop one, or remap its topic',
        {'alternating': part},
    )


def repeated_readings(seen: Readings) -> Finding:
    """Return how many readings in motion repeat the one before."""
    known = seen.count(REPEATED)
    numbers = {'dropped': known, 'equal_in_motion': seen.equal}
    if seen.stale:
        every = 1.0 / (1.0 - seen.equal)
        return Finding(
            'repeated readings',
            WARN,
            f'{seen.equal:.0%} of the readings in motion repeat the one before: the sensor gives '
            f'a new one at about {1.0 / (every * seen.step):.3g} Hz',
            'publish each reading once, with the stamp of when it was taken',
            numbers,
        )
    count = max(known, len(seen.repeats))
    if count > max(FEW, SELDOM * len(seen.position)):
        return Finding(
            'repeated readings',
            WARN,
            f'{count} of {len(seen.position)} readings repeat the one before, and the next one '
            'catches up',
            'publish each reading once, with the stamp of when it was taken',
            numbers,
        )
    text = f'{seen.equal:.1%} of those in motion' if seen.equal == seen.equal else 'none seen'
    return Finding('repeated readings', PASS, text, '', numbers)


def sticking(seen: Readings) -> Finding:
    """Return where the sensor holds a reading while the joint moves."""
    if seen.stale:
        return Finding('sticking sensor', PASS, 'hidden by repeated readings')
    released = np.flatnonzero(seen.released)
    if not len(released):
        return Finding('sticking sensor', PASS, 'none seen')
    plural = 's' if len(released) > 1 else ''
    return Finding(
        'sticking sensor',
        WARN,
        f'the reading holds and then catches up {len(released)} time{plural}, '
        + times(seen.when(seen.rows[released + 1])),
        'look for a blocked bus or driver; publish nothing while there is no new reading',
        {'count': len(released), 'times_s': seen.when(seen.rows[released + 1])},
    )


def motion(seen: Readings) -> Finding:
    """Return how far the joint moves, and whether it moves at all."""
    if seen.at_rest:
        return Finding(
            'motion',
            WARN,
            f'at rest throughout: the reading changes by {seen.range:.2g}',
            'record it in motion: nothing can be tuned or compared at rest',
            {'range': seen.range},
        )
    return Finding(
        'motion',
        PASS,
        f'over {seen.range:.3g} rad, up to {seen.speed:.3g} rad/s',
        '',
        {'range': seen.range, 'speed': seen.speed},
    )


CHECKS = (finite, motion, resolution, wrap, jumps, repeated_readings, sticking)
