# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of the readings: resolution, wrap, jumps, repeats, a sensor that sticks, rest."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.calls import run
from estimator_pkg.evaluation.checks.readings import (
    JUMP_SIDE,
    JUMP_SPEEDS,
    STUCK_READINGS,
    Array,
    Readings,
    neighbour_motion,
    plural,
    short,
    times,
)
from estimator_pkg.evaluation.checks.row import FAIL, PASS, WARN, Check, Measured
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
MISSING_OFTEN = 0.2  # a larger fraction of missing readings leaves too few


def finite(seen: Readings) -> Measured:
    """Count the readings that are missing, not finite, or beyond any encoder's range."""
    rows = np.flatnonzero(~np.isfinite(seen.position))
    count, total = len(rows), len(seen.position)
    level = PASS if not count else FAIL if count > MISSING_OFTEN * total else WARN
    words = {'total': total, 'when': times(seen.when(rows))}
    return Measured(level, ['some' if count else 'all'], {'count': count}, words)


def motion(seen: Readings) -> Measured:
    """Measure how far the joint moves, and whether it moves at all."""
    numbers = {'range': seen.range}
    if seen.at_rest:
        return Measured(WARN, ['rest'], numbers)
    return Measured(PASS, ['moves'], numbers | {'speed': seen.speed})


def resolution(seen: Readings) -> Measured:
    """Measure the quantum, the counts per turn, and what one count is as a speed."""
    count, noise, turn = seen.quantum, seen.noise, seen.period or TURN
    numbers = {'quantum': count, 'noise': noise}
    in_turns = count and seen.period and not _of_another_unit(seen)
    if in_turns:
        numbers['counts_per_turn'] = turn / count
    scatters = noise > max(NOISY_READING * turn / TURN, NOISY_COUNTS * count)
    noisy = scatters and not seen.stale
    coarse = bool(in_turns and turn / count < COARSE_COUNTS and not noisy)
    known = seen.own_quantum and not noisy
    words = {
        'turns': f' rad, {turn / count:.6g} per turn' if in_turns else '',
        'speed': count / seen.step,
        'set': f"set 'quantum: {count:.6g}'" + '; ' * coarse if known else '',
        'scatter': f'{noise / count:.2g} counts' if count else f'{noise:.2g} rad',
    }
    texts = ['coarse' if coarse else 'count' if count else 'none', *(['noisy'] if noisy else [])]
    return Measured(WARN if noisy or coarse else PASS, texts, numbers, words)


def wrap(seen: Readings) -> Measured:
    """Find where the reading wraps, and whether it does so by the wrap period."""
    raw = np.diff(seen.raw)
    low, high = float(np.min(seen.raw)), float(np.max(seen.raw))
    period, count = _period(seen)
    words: dict[str, Any] = {
        'low': low,
        'high': high,
        'period': period,
        'expected': seen.period,
        'degrees': _as_counts(seen, '360'),
        'counts': _as_counts(seen, f'{period:.0f}'),
        'mm': 'read it with --unit mm' if seen.log else 'publish m',
    }
    if count == 1:
        return Measured(WARN, ['range', 'once'], {'wrap_period': DEGREES}, words)
    if period:
        in_degrees = abs(period - DEGREES) < DEGREES_DIFFER
        text = 'degrees' if in_degrees else 'raw_counts' if seen.raw_counts else 'period'
        return Measured(FAIL, ['range', text], {'wrap_period': period}, words)
    if seen.free or (seen.period and _of_another_unit(seen)):
        words['free'] = ': judged without a wrap period' if seen.free else ''
        words['if_counts'] = f'if counts, {_as_counts(seen, "N")}; ' if seen.raw_counts else ''
        return Measured(WARN, ['range', 'unit'], {'wraps': 0}, words)
    if not seen.period:
        return Measured(PASS, ['range', 'no_period'], {}, words)
    whole = seen.joined & (np.abs(raw) > 0.5 * seen.period) & ~seen.leaps
    turns = (high - low) / seen.period
    count = int(np.count_nonzero(whole))
    numbers = {'wraps': count, 'turns': turns}
    words['fast'] = float(np.percentile(np.abs(seen.moves[seen.joined]), 99.0))
    if words['fast'] > AMBIGUOUS_MOVE * seen.period:
        words['else'] = f'they never wrap: {FREE}; or' if seen.never_wraps else 'raise the rate, or'
        return Measured(FAIL, ['range', 'ambiguous'], numbers, words)
    if count and turns > 1.2:
        words['when'] = times(seen.when(seen.rows[1:][whole]))
        return Measured(WARN, ['range', 'turns'], numbers, words)
    words['many'] = plural(count, 'wrap') if count else 'no wrap'
    return Measured(PASS, ['range', 'wraps'], numbers, words)


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


def jumps(seen: Readings) -> Measured:
    """Find the moves that no joint can make."""
    size = np.abs(seen.moves)
    found = np.arange(len(size)) if seen.alternating else np.flatnonzero(seen.leaps)
    if not len(found):
        return Measured(PASS, ['none'], words={'largest': float(np.max(size))})
    part = len(found) / len(size)
    back = len(found) > 1 and np.mean(
        np.sign(seen.moves[found][1:]) != np.sign(seen.moves[found][:-1])
    )
    two = seen.alternating or (part > ALTERNATING_PART and len(found) > 20 and back > 0.8)
    if two:
        distance = float(np.median(size[found]))
        return Measured(FAIL, ['sources'], {'alternating': part}, {'distance': distance})
    worst = found[np.argmax(size[found])]
    events = found[np.diff(found, prepend=-JUMP_SIDE) > 2]  # there and back is one
    when = seen.when(seen.rows[events + 1])
    return Measured(
        FAIL,
        ['jumps'],
        {'count': len(events), 'largest': float(size[worst]), 'times_s': when},
        {
            'many': plural(len(events), 'jump'),
            'within': short(float(seen.steps[worst])),
            'when': times(when),
        },
    )


def repeated_readings(seen: Readings) -> Measured:
    """Count the readings in motion that repeat the one before."""
    known, total = seen.count(REPEATED_READING), len(seen.position)
    count = max(known, len(seen.repeats))
    numbers = {'dropped': known, 'equal_in_motion': seen.equal}
    if seen.stale:
        return Measured(WARN, ['stale'], numbers, {'new_hz': seen.new_hz})
    if count > max(FEW_REPEATS, SELDOM * total):
        return Measured(WARN, ['some'], numbers, {'count': count, 'total': total})
    return Measured(PASS, ['few' if seen.equal == seen.equal else 'none'], numbers)


def sticking(seen: Readings) -> Measured:
    """Find where the sensor holds a reading while the joint moves."""
    released = np.flatnonzero(seen.released)
    if seen.stale or not len(released):
        return Measured(PASS, ['hidden' if seen.stale else 'none'])
    when = seen.when(seen.rows[released + 1])
    numbers = {'count': len(released), 'times_s': when}
    words = {'many': plural(len(released), 'time'), 'when': times(when)}
    return Measured(WARN, ['holds'], numbers, words)


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


def encoder(seen: Readings) -> Measured:
    """Find the faults of the encoder that its readings alone show, as the nodes report them."""
    used = seen.of(*range(DUPLICATE))
    record, kinds = faults_of(seen.stamps_ns[used], seen.position[used], seen.period, seen.step)
    texts = [
        f'{text_of(record, kind)}, {times(seen.when(used[kinds == kind]))}'
        for kind in np.unique(kinds[kinds != NO_FAULT]).tolist()
    ]
    faulty = bool(np.any((kinds != NO_FAULT) & (kinds != STOPPED)))
    unit = WRAP(seen)
    words = {
        'faults': '; '.join(texts),
        'remedy': unit.remedy if unit.level != PASS else 'check sensor, cable and bus',
    }
    numbers = {'counts': {name: n for (name, _), n in zip(KINDS, record.counts)}}
    text = 'faults' if faulty else 'stops' if texts else 'none'
    return Measured(WARN if faulty else PASS, [text], numbers, words)


COUNT = 'one count is {quantum:.4g}{turns}; {speed:.3g} per second in a finite difference'
ONCE = 'publish each reading once, with the stamp of when it was taken'
PERIOD = 'their period is {period:.4g}, not {expected:.4g}'
WRAP = Check(
    'wrap',
    'where and by what period the readings wrap',
    'FAIL: another period or degrees, from several wraps; half a turn per sample. WARN: degrees, '
    'mm or counts that do not wrap; whole turns',
    {
        'range': 'readings from {low:.3g} to {high:.3g}',
        'once': 'they wrap once, by {period:.4g} -> if degrees, {degrees}; if not, they jump '
        'there: mend or cut the record',
        'degrees': f'{PERIOD} -> the angle is in degrees: {{degrees}}',
        'raw_counts': f'{PERIOD} -> they are raw counts: {{counts}}',
        'period': f"{PERIOD} -> set 'wrap_period: {{wrap_period:.6g}}'",
        'unit': 'nothing wraps, and their steps are not those of radians{free} -> {if_counts}if '
        f'degrees, {{degrees}}; if mm, {{mm}}; if prismatic or multi-turn, {FREE}',
        'no_period': 'no wrap period',
        'ambiguous': 'the joint moves {fast:.3g} rad from one reading to the next: half a turn '
        'reads as its opposite -> {else} check the unit (radians)',
        'turns': 'they jump by whole turns {wraps} times, {when} -> the turn counter of the '
        'sensor is wrong there; observers see the angle alone',
        'wraps': '{many}',
    },
    wrap,
)
CHECKS = (
    Check(
        'finite readings',
        'NaN, infinite or absent readings',
        'any',
        {
            'all': 'all {total}',
            'some': '{count} of {total} readings are NaN, infinite or absent, {when} -> publish '
            'only readings that the sensor has taken',
        },
        finite,
    ),
    Check(
        'motion',
        'range and speed',
        'at rest throughout',
        {
            'rest': 'at rest throughout: the reading changes by {range:.2g} -> record it in '
            'motion: nothing can be tuned or compared at rest',
            'moves': 'over {range:.3g} rad, up to {speed:.3g} rad/s',
        },
        motion,
    ),
    Check(
        'resolution',
        'quantum, counts per turn, scatter',
        f'below {COARSE_COUNTS:g} counts per turn; scatter above {NOISY_COUNTS:g} counts and '
        f'{NOISY_READING * 1e3:g} mrad',
        {
            'none': 'no counts found (a float sensor, or noise above a count)',
            'count': f'{COUNT} -> {{set}}',
            'coarse': f'{COUNT}: coarse -> {{set}}use edge_adaptive or kalman; more counts, or '
            'one before the gear, help most',
            'noisy': 'neighbouring readings scatter by {scatter} -> check shielding, supply and '
            'mounting of the sensor',
        },
        resolution,
    ),
    WRAP,
    Check(
        'jumps',
        f'moves that no joint can make, above {JUMP_SPEEDS:g} times its speed elsewhere, with '
        'their times',
        'any; readings that alternate between two sources',
        {
            'none': 'none; the largest change is {largest:.3g} rad',
            'jumps': '{many} that no joint can make, up to {largest:.3g} rad within {within}, '
            '{when} -> a flipped pose, a slipped encoder or a damaged reading: mend or cut the '
            'record there',
            'sources': 'the readings alternate between two positions {distance:.3g} rad apart '
            '({alternating:.0%} of the samples) -> two publishers send this joint: stop one, or '
            'remap its topic',
        },
        jumps,
    ),
    Check(
        'repeated readings',
        'readings in motion that repeat the one before',
        f'above {100 * SELDOM:g} % and {FEW_REPEATS}',
        {
            'none': 'none seen',
            'few': '{equal_in_motion:.1%} of those in motion',
            'some': f'{{count}} of {{total}} readings repeat the one before, and the next one '
            f'catches up -> {ONCE}',
            'stale': '{equal_in_motion:.0%} of the readings in motion repeat the one before: the '
            f'sensor gives a new one at about {{new_hz:.3g}} Hz -> {ONCE}',
        },
        repeated_readings,
    ),
    Check(
        'sticking sensor',
        f'readings that stay for {STUCK_READINGS} samples and then catch up',
        'any',
        {
            'none': 'none seen',
            'hidden': 'hidden by repeated readings',
            'holds': 'the reading holds and then catches up {many}, {when} -> look for a blocked '
            'bus or driver; publish nothing while there is no new reading',
        },
        sticking,
    ),
    Check(
        'encoder',
        '[faults that the readings show](troubleshooting.md#faults-of-an-encoder)',
        'any but a stop that may be a stuck sensor',
        {'none': 'none', 'stops': '{faults}', 'faults': '{faults} -> {remedy}'},
        encoder,
    ),
)
