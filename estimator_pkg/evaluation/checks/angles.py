# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of the readings: resolution, wrap, jumps, repeats, a sensor that sticks, rest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.calls import run
from estimator_pkg.evaluation.checks.readings import (
    FAIL,
    JUMP_SIDE,
    PASS,
    WARN,
    Array,
    Finding,
    Readings,
    neighbour_motion,
    short,
    times,
)
from estimator_pkg.sensor.clock import Clock
from estimator_pkg.sensor.faults import (
    KINDS,
    NO_FAULT,
    STOPPED,
    EncoderFaults,
    begin_faults,
    find_faults,
    text_of,
)
from estimator_pkg.sensor.guard import DUPLICATE, REPEATED_READING

TURN = 2.0 * math.pi
COARSE_COUNTS = 1000.0  # fewer counts per turn are coarse
NOISY_READING = 2e-3  # noise of a reading above this [rad or m], and above
NOISY_COUNTS = 3.0  # this many quanta, is more than a sensor should have
ALTERNATING_PART = 0.02  # a larger fraction of jumps there and back: two sources
NEAR_END = 3.0  # a wrap begins and ends within this many moves of the range's ends
WRAP_SIDE, WRAPS_AGREE = 50, 0.8  # samples that show the motion; fraction of the wraps that agree
ONE_SAMPLE = 1.5  # neighbours are closer than this many sample times
OTHER_PERIOD = 0.01  # relative difference from the wrap period that counts
MOST_LINES = 1e5  # counts per turn of encoders with a decimal number of lines
AMBIGUOUS_MOVE = 0.4  # moves beyond this fraction of the wrap period are ambiguous soon
SELDOM, FEW_REPEATS = 0.005, 5  # repeated readings up to this fraction, or number, are not reported

FREE = "set 'wrap_period: 0' (--wrap-period 0)"
DEGREES, DEGREES_DIFFER = 360.0, 4.0  # the period of degrees, and its allowed error


def finite(seen: Readings) -> Finding:
    """Return how many readings are missing, not finite, or beyond any encoder's range."""
    rows = np.flatnonzero(~np.isfinite(seen.position))
    count, total = len(rows), len(seen.position)
    if not count:
        return Finding('finite readings', PASS, f'all {total}', '', {'count': 0})
    level = FAIL if count > 0.2 * total else WARN
    text = f'{count} of {total} readings are NaN, infinite or absent, {times(seen.when(rows))}'
    remedy = 'publish only readings that the sensor has taken'
    return Finding('finite readings', level, text, remedy, {'count': count})


def resolution(seen: Readings) -> Finding:
    """Return the quantum, the counts per turn, and what one count is as a speed."""
    count, noise = seen.quantum, seen.noise
    numbers = {'quantum': count, 'noise': noise}
    period = 0.0 if seen.period and _of_another_unit(seen) else seen.period
    turn = seen.period or TURN
    level, remedy = PASS, f"set 'quantum: {count:.6g}'" if seen.own_quantum else ''
    if not count:
        text = 'no counts found (a float sensor, or noise above a count)'
    else:
        text = f'one count is {count:.4g}'
        if period:
            numbers['counts_per_turn'] = turn / count
            text += f' rad, {turn / count:.6g} per turn'
        text += f'; {count / seen.step:.3g} per second in a finite difference'
    if noise > max(NOISY_READING * turn / TURN, NOISY_COUNTS * count) and not seen.stale:
        scatter = f'{noise / count:.2g} counts' if count else f'{noise:.2g} rad'
        text += f'; neighbouring readings scatter by {scatter}'
        level, remedy = WARN, 'check shielding, supply and mounting of the sensor'
    elif count and period and turn / count < COARSE_COUNTS:
        level, text = WARN, f'{text}: coarse'
        remedy += '; use edge_adaptive or kalman; more counts, or one before the gear, help most'
    return Finding('resolution', level, text, remedy, numbers)


def wrap(seen: Readings) -> Finding:
    """Return where the reading wraps, and whether it does so by the wrap period."""
    raw = np.diff(seen.raw)
    low, high = float(np.min(seen.raw)), float(np.max(seen.raw))
    text = f'readings from {low:.3g} to {high:.3g}'
    period, count = _period(seen)
    degrees = _as_counts(seen, '360')
    if count == 1:
        text += f'; they wrap once, by {period:.4g}'
        remedy = f'if degrees, {degrees}; if not, they jump there: mend or cut the record'
        return Finding('wrap', WARN, text, remedy, {'wrap_period': DEGREES})
    if period:
        text += f'; their period is {period:.4g}, not {seen.period:.4g}'
        remedy = f"set 'wrap_period: {period:.6g}'"
        if abs(period - DEGREES) < DEGREES_DIFFER:
            remedy = f'the angle is in degrees: {degrees}'
        elif seen.raw_counts:
            remedy = f'they are raw counts: {_as_counts(seen, f"{period:.0f}")}'
        return Finding('wrap', FAIL, text, remedy, {'wrap_period': period})
    if seen.free or (seen.period and _of_another_unit(seen)):
        text += '; nothing wraps, and their steps are not those of radians'
        if seen.free:
            text += ': judged without a wrap period'
        mm = 'read it with --unit mm' if seen.log else 'publish m'
        remedy = f'if degrees, {degrees}; if mm, {mm}; if prismatic or multi-turn, {FREE}'
        if seen.raw_counts:
            remedy = f'if counts, {_as_counts(seen, "N")}; {remedy}'
        return Finding('wrap', WARN, text, remedy, {'wraps': 0})
    if not seen.period:
        return Finding('wrap', PASS, f'{text}; no wrap period')
    whole = seen.joined & (np.abs(raw) > 0.5 * seen.period) & ~seen.leaps
    turns = (high - low) / seen.period
    count = int(np.count_nonzero(whole))
    numbers = {'wraps': count, 'turns': turns}
    fast = np.percentile(np.abs(seen.moves[seen.joined]), 99.0)
    if fast > AMBIGUOUS_MOVE * seen.period:
        text += f'; the joint moves {fast:.3g} rad from one reading to the next'
        text += ': half a turn reads as its opposite'
        remedy = 'raise the rate, or check the unit (radians)'
        if seen.never_wraps:
            remedy = f'they never wrap: {FREE}; or check the unit (radians)'
        return Finding('wrap', FAIL, text, remedy, numbers)
    if count and turns > 1.2:
        when = times(seen.when(seen.rows[1:][whole]))
        text += f'; they jump by whole turns {count} times, {when}'
        remedy = 'the turn counter of the sensor is wrong there; observers see the angle alone'
        return Finding('wrap', WARN, text, remedy, numbers)
    return Finding('wrap', PASS, f'{text}; {count or "no"} wrap{"s" * (count > 1)}', '', numbers)


def _as_counts(seen: Readings, counts: str) -> str:
    """Return how to read an angle with this number of counts per turn; 360: degrees."""
    if seen.log:
        unit = 'deg' if counts == '360' else f'count --counts {counts}'
        return f'read it with --unit {unit}'
    return f'publish radians, or read the number by --angle with counts_per_revolution={counts}'


def _period(seen: Readings) -> tuple[float, int]:
    """Return the period by which the readings wrap, and how often; 0: none but the wrap period.

    It shows in more than one wrap between neighbours, one sample apart; in one, if it is that of
    degrees.
    """
    raw, low, high = np.diff(seen.raw), float(np.min(seen.raw)), float(np.max(seen.raw))
    size = np.abs(raw)
    near = seen.joined & (seen.steps < ONE_SAMPLE * seen.step)
    far = np.flatnonzero(near & (size > 0.5 * (high - low)))
    if not 0 < len(far) < 0.2 * len(raw):
        return 0.0, 0
    slack = NEAR_END * (neighbour_motion(size, far) + seen.quantum) + 1e-3 * (high - low)
    before, after = seen.raw[far], seen.raw[far + 1]
    ends = np.minimum(
        np.maximum(np.abs(before - low), np.abs(after - high)),
        np.maximum(np.abs(before - high), np.abs(after - low)),
    )
    # a wrap goes against the motion around it
    small = np.where(np.isin(np.arange(len(raw)), far), 0.0, raw)
    along = np.array([np.sum(small[max(0, at - WRAP_SIDE) : at + WRAP_SIDE]) for at in far])
    usual = np.array([_middle(raw, int(at)) for at in far])
    wraps = (ends <= slack) & (along * raw[far] < 0.0)
    count = int(np.count_nonzero(wraps))
    if not count or np.mean(wraps) < WRAPS_AGREE or np.max(slack) > 0.2 * (high - low):
        return 0.0, 0
    sizes = size[far] + np.abs(usual)
    found = float(np.median(sizes[wraps]))
    if np.mean(np.abs(sizes - found) <= slack) < WRAPS_AGREE:
        return 0.0, 0
    if seen.period and abs(found - seen.period) <= OTHER_PERIOD * seen.period + np.max(slack):
        return 0.0, 0
    if count == 1 and abs(found - DEGREES) >= DEGREES_DIFFER:
        return 0.0, 0
    return found, count


def _of_another_unit(seen: Readings) -> bool:
    """Return True if the readings may be degrees, mm or counts: by their quantum."""
    return seen.never_wraps and (seen.raw_counts or _in_degrees(seen))


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
    return float(
        np.median(np.r_[moves[max(0, at - JUMP_SIDE) : at], moves[at + 1 : at + 1 + JUMP_SIDE]])
    )


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
    if part > ALTERNATING_PART and len(found) > 20 and back > 0.8:
        return _two_sources(float(np.median(size[found])), part)
    worst = found[np.argmax(size[found])]
    events = found[np.diff(found, prepend=-JUMP_SIDE) > 2]  # there and back is one
    when = seen.when(seen.rows[events + 1])
    text = (
        f'{len(events)} jump{"s" * (len(events) > 1)} that no joint can make, up to '
        f'{size[worst]:.3g} rad within {short(float(seen.steps[worst]))}, {times(when)}'
    )
    remedy = 'a flipped pose, a slipped encoder or a damaged reading: mend or cut the record there'
    numbers = {'count': len(events), 'largest': float(size[worst]), 'times_s': when}
    return Finding('jumps', FAIL, text, remedy, numbers)


def _two_sources(distance: float, part: float) -> Finding:
    text = (
        f'the readings alternate between two positions {distance:.3g} rad apart '
        f'({part:.0%} of the samples)'
    )
    remedy = 'two publishers send this joint: stop one, or remap its topic'
    return Finding('jumps', FAIL, text, remedy, {'alternating': part})


def repeated_readings(seen: Readings) -> Finding:
    """Return how many readings in motion repeat the one before."""
    known, total = seen.count(REPEATED_READING), len(seen.position)
    count = max(known, len(seen.repeats))
    level, remedy = WARN, 'publish each reading once, with the stamp of when it was taken'
    if seen.stale:
        text = (
            f'{seen.equal:.0%} of the readings in motion repeat the one before: the sensor gives '
            f'a new one at about {seen.new_hz:.3g} Hz'
        )
    elif count > max(FEW_REPEATS, SELDOM * total):
        text = f'{count} of {total} readings repeat the one before, and the next one catches up'
    else:
        level, remedy = PASS, ''
        text = f'{seen.equal:.1%} of those in motion' if seen.equal == seen.equal else 'none seen'
    numbers = {'dropped': known, 'equal_in_motion': seen.equal}
    return Finding('repeated readings', level, text, remedy, numbers)


def sticking(seen: Readings) -> Finding:
    """Return where the sensor holds a reading while the joint moves."""
    released = np.flatnonzero(seen.released)
    if seen.stale or not len(released):
        text = 'hidden by repeated readings' if seen.stale else 'none seen'
        return Finding('sticking sensor', PASS, text)
    when = seen.when(seen.rows[released + 1])
    many = f'{len(released)} time{"s" * (len(released) > 1)}'
    text = f'the reading holds and then catches up {many}, {times(when)}'
    remedy = 'look for a blocked bus or driver; publish nothing while there is no new reading'
    numbers = {'count': len(released), 'times_s': when}
    return Finding('sticking sensor', WARN, text, remedy, numbers)


def motion(seen: Readings) -> Finding:
    """Return how far the joint moves, and whether it moves at all."""
    numbers = {'range': seen.range}
    if seen.at_rest:
        text = f'at rest throughout: the reading changes by {seen.range:.2g}'
        remedy = 'record it in motion: nothing can be tuned or compared at rest'
        return Finding('motion', WARN, text, remedy, numbers)
    text = f'over {seen.range:.3g} rad, up to {seen.speed:.3g} rad/s'
    return Finding('motion', PASS, text, '', numbers | {'speed': seen.speed})


def faults_of(
    stamps: NDArray[np.int64], readings: NDArray[np.float64], period: float, dt: float
) -> tuple[EncoderFaults, NDArray[np.int64]]:
    """Return the faults of an encoder, and the kind that each reading decides, shape (n,).

    Parameters
    ----------
    stamps [ns], readings [rad or m] : shape (n,). period : wrap period [rad]; 0: none. dt : mean
    sample time [s].
    """
    record, clock, kinds = EncoderFaults(), Clock(), np.full(len(stamps), NO_FAULT)
    begin_faults(record)
    clock.mean_dt = dt
    run(find_faults, record, clock, len(stamps), period, stamps, readings, kinds)
    return record, kinds


def encoder(seen: Readings) -> Finding:
    """Return the faults of the encoder that its readings alone show, as the nodes report them."""
    used = seen.of(*range(DUPLICATE))
    record, kinds = faults_of(seen.stamps_ns[used], seen.position[used], seen.period, seen.step)
    texts = [
        f'{text_of(record, kind)}, {times(seen.when(used[kinds == kind]))}'
        for kind in np.unique(kinds[kinds != NO_FAULT]).tolist()
    ]
    faulty = bool(np.any((kinds != NO_FAULT) & (kinds != STOPPED)))
    unit = wrap(seen)
    remedy = unit.remedy if unit.level != PASS else 'check sensor, cable and bus'
    remedy = remedy if faulty else ''
    numbers = {'counts': {name: n for (name, _), n in zip(KINDS, record.counts)}}
    return Finding('encoder', WARN if faulty else PASS, '; '.join(texts) or 'none', remedy, numbers)


CHECKS = (finite, motion, resolution, wrap, jumps, repeated_readings, sticking, encoder)
