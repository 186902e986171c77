# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of the stamps: rate, jitter, holes, order, and whether they are true."""

from __future__ import annotations

import numpy as np

from estimator_pkg.evaluation.checks.readings import (
    FAIL,
    PASS,
    WARN,
    Array,
    Finding,
    Readings,
    short,
    times,
)
from estimator_pkg.evaluation.checks.stamp_error import line_error, spacing_error
from estimator_pkg.evaluation.delay import GAP_STEPS
from estimator_pkg.evaluation.matching import strays
from estimator_pkg.sensor.guard import (
    AFTER_CLOCK_JUMP,
    AFTER_GAP,
    AFTER_OUTAGE,
    AFTER_STRAY_STAMP,
    DUPLICATE,
    LATE_STAMP,
    ZERO_STAMP,
)
from estimator_pkg.streams.contract import HEADER, PUBLISHER, stamp_remedy

RATE_WINDOWS, IN_WINDOW = 20, 100  # windows of the rate; samples of one at least
OTHER_RATE = 1.3  # ratio of the rates of two windows that is a change
IRREGULAR = 0.25  # spacing whose spread is this fraction of the sample time is irregular
HOLE_RATIO = 10.0  # a longer gap between stamps is a hole [median sample times]
NEARBY_STEPS = 20  # samples whose median spacing missing ones are counted with
LOST_OFTEN = 0.005  # a larger fraction of missing samples is reported
STAMP_ERROR_PART = 0.05  # stamps that err by this fraction of the sample time are reported
DROPPED_OFTEN = 0.2  # a larger fraction of dropped samples leaves too few
SAME_CLOCK = 86_400.0  # stamps further from their arrival are of another clock [s]
STAMPS_AHEAD = 0.005  # stamps this far in the future of their arrival [s]
STAMPS_OLD = 0.05  # readings that arrive this long after their stamp [s]
CLOCK_DRIFT, LEAST_DRIFT = 1e-3, 0.02  # relative drift of the stamps, and its least effect [s]
DRIFT_TIME = 2.0  # least duration in which a drift shows [s]


def rate(seen: Readings) -> Finding:
    """Return the sample rate, and whether it changes."""
    steps = seen.steps[seen.joined]
    count, hz = len(seen.rows), 1.0 / seen.step
    if seen.copies > 1:
        hz = seen.new_hz
        many = 'twice' if seen.copies == 2 else f'{seen.copies} times'
        text = f'{hz:.5g} Hz, each reading {many}, {count} in {short(float(np.sum(steps)))}'
        return Finding('rate', PASS, text, numbers={'hz': hz, 'readings': count})
    text = f'{hz:.5g} Hz, {count} readings in {short(float(np.sum(steps)))}'
    numbers = {'hz': hz, 'readings': count}
    windows = min(RATE_WINDOWS, len(steps) // IN_WINDOW)
    if windows > 1:
        parts = np.array_split(steps, windows)
        medians = np.array([np.median(part) for part in parts])
        slow, fast = float(np.max(medians)), float(np.min(medians))
        if slow > OTHER_RATE * fast:
            far = np.abs(np.log(medians / medians[0])) > np.log(OTHER_RATE)
            at = float(np.sum(np.concatenate(parts[: max(1, int(np.argmax(far)))])))
            text += f'; it changes between {1.0 / fast:.4g} and {1.0 / slow:.4g} Hz'
            text += f', first about {at:.1f} s after the start'
            numbers |= {'fastest_hz': 1.0 / fast, 'slowest_hz': 1.0 / slow}
            remedy = 'check the load of the publisher; gains fit one rate'
            return Finding('rate', WARN, text, remedy, numbers)
    return Finding('rate', PASS, text, numbers=numbers)


def jitter(seen: Readings) -> Finding:
    """Return how regular the spacing of the stamps is."""
    near = seen.steps[seen.joined & (seen.steps < GAP_STEPS * seen.step)]
    spread = float(np.sqrt(np.mean((near - seen.step) ** 2)))
    middle = 1.4826 * float(np.median(np.abs(near - seen.step)))
    text = f'the spacing of stamps varies by {short(spread)} rms ({spread / seen.step:.2g} samples)'
    numbers = {'spacing_rms_s': spread, 'spacing_mad_s': middle}
    irregular = middle > IRREGULAR * seen.step
    remedy = 'stamp each reading when it is taken, not when it is published or received'
    level = WARN if irregular else PASS
    return Finding('jitter', level, text, remedy if irregular else '', numbers)


def holes(seen: Readings) -> Finding:
    """Return the gaps between stamps, and how many samples are missing."""
    inside = seen.steps < HOLE_RATIO * seen.step
    local = _local(seen.steps)
    regular = 1.4826 * float(np.median(np.abs(seen.steps / local - 1.0))) < 0.1
    regular = regular and seen.copies == 1
    missing = np.maximum(np.rint(seen.steps / local) - 1.0, 0.0) * regular
    lost = float(np.sum(missing[seen.joined & inside])) / max(len(seen.rows), 1)
    long = np.flatnonzero(seen.joined & ~inside)
    numbers = {'holes': len(long), 'lost_fraction': lost}
    if not len(long) and lost <= LOST_OFTEN:
        return Finding('holes', PASS, f'none; {lost:.2%} of single samples missing', '', numbers)
    if not len(long):
        text = f'{lost:.1%} of the samples are missing, a few at a time'
        remedy = "look for a lossy link or a queue of depth 1; raise the publisher's priority"
        return Finding('holes', WARN, text, remedy, numbers)
    worst = long[np.argsort(-seen.steps[long], kind='stable')]
    longest = float(seen.steps[worst[0]])
    gaps = seen.count(AFTER_GAP, AFTER_OUTAGE)
    much = gaps and longest > 0.1 * float(np.sum(seen.steps[seen.joined]))
    text = (
        f'{len(long)} hole{"s" * (len(long) > 1)}, the longest {short(longest)}, '
        f'{times(seen.when(seen.rows[worst]))}'
    )
    remedy = 'look for a blocked publisher or a lossy link'
    if gaps:
        remedy += '; observers start anew after those above gap_max'
    numbers |= {'longest_s': longest, 'restarts': gaps}
    return Finding('holes', FAIL if much else WARN, text, remedy, numbers)


def _local(steps: Array) -> Array:
    """Return the median of the steps around each."""
    parts = np.array_split(steps, max(1, len(steps) // NEARBY_STEPS))
    return np.concatenate([np.full(len(part), max(float(np.median(part)), 1e-9)) for part in parts])


def repeated_stamps(seen: Readings) -> Finding:
    """Return how many samples repeat the stamp of the one before."""
    return _dropped(
        seen,
        'repeated stamps',
        seen.count(DUPLICATE),
        'repeat the previous stamp and are dropped',
        'stamp each reading once; look for two publishers, a name that a message has twice, or '
        'stamps of a coarse clock',
        times(seen.when(seen.of(DUPLICATE))),
    )


def order(seen: Readings) -> Finding:
    """Return how many stamps are late, jump, or stand alone in the future."""
    late, jumps = seen.of(LATE_STAMP), seen.of(AFTER_CLOCK_JUMP)
    alone = np.flatnonzero(strays(seen.stamps_ns))
    if not len(alone):
        alone = seen.of(AFTER_STRAY_STAMP)
    jumps = jumps[~np.isin(jumps - 1, alone)]
    parts = []
    if len(jumps):
        parts.append(
            f'the clock jumps back {len(jumps)} time{"s" * (len(jumps) > 1)}, '
            + times(seen.when(jumps, arrival=True))
        )
    if len(alone):
        parts.append(f'{len(alone)} single stamps are far in the future')
    if len(late):
        parts.append(f'{len(late)} stamps are older than the one before, and are dropped')
    numbers = {'late': len(late), 'clock_jumps': len(jumps), 'strays': len(alone)}
    if not parts:
        return Finding('order of stamps', PASS, 'each is newer than the one before', '', numbers)
    remedies = [
        *(['one bag or simulation per record (a loop, a restart)'] if len(jumps) else []),
        *(['check the clock of the driver'] if len(alone) else []),
        *(['publish in the order of the stamps; look for two publishers'] if len(late) else []),
    ]
    level = FAIL if len(jumps) or len(late) > DROPPED_OFTEN * len(seen.stamps_ns) else WARN
    return Finding('order of stamps', level, '; '.join(parts), '; '.join(remedies), numbers)


def missing_stamps(seen: Readings) -> Finding:
    """Return how many samples have no stamp."""
    return _dropped(
        seen,
        'missing stamps',
        seen.count(ZERO_STAMP),
        'have no time stamp and are dropped',
        stamp_remedy(PUBLISHER if seen.log or not np.any(seen.arrival_ns > 0) else HEADER),
    )


def stamp_error(seen: Readings) -> Finding:
    """Return by how much the stamps are wrong, from errors that grow with the speed."""
    if seen.stale or np.any(seen.leaps):
        return Finding('lying stamps', PASS, 'hidden by repeats and jumps of the readings')
    good = np.sort(seen.rows)
    wrong = max(
        line_error(seen.series, seen.parts[0], seen.period, seen.quantum),
        spacing_error(seen.stamps_ns[good], seen.position[good], seen.period, seen.grain),
    )
    level, remedy = PASS, ''
    text = f'wrong by {short(wrong)} rms' if wrong else 'no error seen in the motion'
    if wrong > STAMP_ERROR_PART * seen.step:
        level, remedy = WARN, 'stamp each reading when it is taken; a clock of the device is best'
        text = (
            f'the stamps are {text}: in motion the readings do not fit them '
            f'({wrong * seen.speed:.2g} rad at {seen.speed:.2g} rad/s)'
        )
    return Finding('lying stamps', level, text, remedy, {'stamp_error_s': wrong})


def clock(seen: Readings) -> Finding:
    """Return how the stamps agree with the times of arrival."""
    good = seen.rows
    age = (seen.arrival_ns[good] - seen.stamps_ns[good]) * 1e-9
    usual, least = float(np.median(age)), float(np.min(age))
    numbers = {'age_s': usual}
    if len(seen.parts) > 1 or len(age) < 20:
        return Finding('clock', PASS, f'stamps are {short(usual)} older than their arrival')
    tenth = max(1, len(age) // 10)
    passed = float(seen.stamps_ns[good[-1]] - seen.stamps_ns[good[0]]) * 1e-9
    drifted = float(np.min(age[-tenth:]) - np.min(age[:tenth]))
    jittery = float(np.percentile(age[:tenth], 50) - np.min(age[:tenth]))
    if passed > DRIFT_TIME and abs(drifted) > max(CLOCK_DRIFT * passed, LEAST_DRIFT, 5.0 * jittery):
        ratio = 1.0 - drifted / (passed + drifted)
        text = (
            f'the stamps run at {ratio:.4f} times the clock of arrival '
            f'({short(abs(drifted))} in {short(passed)})'
        )
        remedy = (
            'right in a simulation (use_sim_time); else the velocity is wrong by this factor: '
            'check the unit and clock of the stamps'
        )
        return Finding('clock', WARN, text, remedy, numbers | {'clock_ratio': ratio})
    text, remedy = f'readings arrive {short(usual)} after their stamp', ''
    if abs(usual) > SAME_CLOCK:
        text = 'stamps are of another clock than the arrival'
    elif least < -STAMPS_AHEAD:
        text = f'stamps are up to {short(-least)} ahead of their arrival'
        remedy = 'the clocks of two machines differ: synchronise them (chrony, PTP)'
    elif usual > STAMPS_OLD:
        remedy = 'estimates are as late: look for a queue or a slow link, or for clocks that differ'
    return Finding('clock', WARN if remedy else PASS, text, remedy, numbers)


def _dropped(
    seen: Readings, name: str, count: int, what: str, remedy: str, where: str = ''
) -> Finding:
    """Return the finding on samples that the guard drops."""
    total, numbers = len(seen.stamps_ns), {'count': count}
    if not count:
        return Finding(name, PASS, f'0 of {total} samples', '', numbers)
    text = f'{count} of {total} samples {what}' + (f', {where}' if where else '')
    return Finding(name, FAIL if count > DROPPED_OFTEN * total else WARN, text, remedy, numbers)


CHECKS = (rate, jitter, holes, repeated_stamps, order, stamp_error, clock)
