# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of the stamps: rate, jitter, holes, order, and whether they are true."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.checks.readings import Array, Readings, plural, short, times
from estimator_pkg.evaluation.checks.row import FAIL, PASS, WARN, Check, Measured
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
FEWEST_MOVING = 200  # smallest number of readings in motion that show it
MOVING_PART = 0.1  # a joint moves above this fraction of its usual speed
SPACING_DEVIATIONS = 5.0  # the spacing disagrees with the motion by this many standard deviations
STAMP_OUTLIER = 10.0  # readings further from the line between their neighbours are ignored
VISIBLE = 0.5  # the effect of the spacing is at least this fraction of a quantum, in rms
SPEED_SIDE = 4  # samples on either side that show the speed
MOST_READINGS = 100_000  # readings that are enough
DROPPED_OFTEN = 0.2  # a larger fraction of dropped samples leaves too few
SAME_CLOCK = 86_400.0  # stamps further from their arrival are of another clock [s]
STAMPS_AHEAD = 0.005  # stamps this far in the future of their arrival [s]
STAMPS_OLD = 0.05  # readings that arrive this long after their stamp [s]
CLOCK_DRIFT, LEAST_DRIFT = 1e-3, 0.02  # relative drift of the stamps, and its least effect [s]
DRIFT_TIME = 2.0  # least duration in which a drift shows [s]


def rate(seen: Readings) -> Measured:
    """Measure the sample rate, and whether it changes."""
    steps = seen.steps[seen.joined]
    words = {'span': short(float(np.sum(steps)))}
    numbers = {'hz': 1.0 / seen.step, 'readings': len(seen.rows)}
    if seen.copies > 1:
        words['many'] = 'twice' if seen.copies == 2 else f'{seen.copies} times'
        return Measured(PASS, ['copies'], numbers | {'hz': seen.new_hz}, words)
    windows = min(RATE_WINDOWS, len(steps) // IN_WINDOW)
    if windows > 1:
        parts = np.array_split(steps, windows)
        medians = np.array([np.median(part) for part in parts])
        slow, fast = float(np.max(medians)), float(np.min(medians))
        if slow > OTHER_RATE * fast:
            far = np.abs(np.log(medians / medians[0])) > np.log(OTHER_RATE)
            first = parts[: max(1, int(np.argmax(far)))]
            numbers |= {'fastest_hz': 1.0 / fast, 'slowest_hz': 1.0 / slow}
            at = {'at': float(np.sum(np.concatenate(first)))}
            return Measured(WARN, ['rate', 'changes'], numbers, words | at)
    return Measured(PASS, ['rate'], numbers, words)


def jitter(seen: Readings) -> Measured:
    """Measure how regular the spacing of the stamps is."""
    near = seen.steps[seen.joined & (seen.steps < GAP_STEPS * seen.step)]
    spread = float(np.sqrt(np.mean((near - seen.step) ** 2)))
    middle = 1.4826 * float(np.median(np.abs(near - seen.step)))
    irregular = middle > IRREGULAR * seen.step
    return Measured(
        WARN if irregular else PASS,
        ['irregular' if irregular else 'spacing'],
        {'spacing_rms_s': spread, 'spacing_mad_s': middle},
        {'spread': short(spread), 'part': spread / seen.step},
    )


def holes(seen: Readings) -> Measured:
    """Measure the gaps between stamps, and count the missing samples."""
    inside = seen.steps < HOLE_RATIO * seen.step
    local = _local(seen.steps)
    regular = 1.4826 * float(np.median(np.abs(seen.steps / local - 1.0))) < 0.1
    regular = regular and seen.copies == 1
    missing = np.maximum(np.rint(seen.steps / local) - 1.0, 0.0) * regular
    lost = float(np.sum(missing[seen.joined & inside])) / max(len(seen.rows), 1)
    long = np.flatnonzero(seen.joined & ~inside)
    numbers = {'holes': len(long), 'lost_fraction': lost}
    if not len(long):
        often = lost > LOST_OFTEN
        return Measured(WARN if often else PASS, ['lost' if often else 'none'], numbers)
    worst = long[np.argsort(-seen.steps[long], kind='stable')]
    longest = float(seen.steps[worst[0]])
    gaps = seen.count(AFTER_GAP, AFTER_OUTAGE)
    much = gaps and longest > 0.1 * float(np.sum(seen.steps[seen.joined]))
    return Measured(
        FAIL if much else WARN,
        ['restarts' if gaps else 'holes'],
        numbers | {'longest_s': longest, 'restarts': gaps},
        {
            'many': plural(len(long), 'hole'),
            'longest': short(longest),
            'when': times(seen.when(seen.rows[worst])),
        },
    )


def _local(steps: Array) -> Array:
    """Return the median of the steps around each."""
    parts = np.array_split(steps, max(1, len(steps) // NEARBY_STEPS))
    return np.concatenate([np.full(len(part), max(float(np.median(part)), 1e-9)) for part in parts])


def dropped(verdict: int) -> Callable[[Readings], Measured]:
    """Return a function that counts the samples that the guard drops by this verdict."""

    def counted(seen: Readings) -> Measured:
        total, count = len(seen.stamps_ns), seen.count(verdict)
        source = PUBLISHER if seen.log or not np.any(seen.arrival_ns > 0) else HEADER
        words = {
            'total': total,
            'when': times(seen.when(seen.of(verdict))),
            'remedy': stamp_remedy(source),
        }
        level = PASS if not count else FAIL if count > DROPPED_OFTEN * total else WARN
        return Measured(level, ['some' if count else 'none'], {'count': count}, words)

    return counted


def order(seen: Readings) -> Measured:
    """Count the stamps that are late, jump, or stand alone in the future."""
    late, jumps = seen.of(LATE_STAMP), seen.of(AFTER_CLOCK_JUMP)
    alone = np.flatnonzero(strays(seen.stamps_ns))
    if not len(alone):
        alone = seen.of(AFTER_STRAY_STAMP)
    jumps = jumps[~np.isin(jumps - 1, alone)]
    numbers = {'late': len(late), 'clock_jumps': len(jumps), 'strays': len(alone)}
    texts = [each for each in ('clock_jumps', 'strays', 'late') if numbers[each]]
    words = {'jumps': plural(len(jumps), 'time'), 'when': times(seen.when(jumps, arrival=True))}
    grave = len(jumps) or len(late) > DROPPED_OFTEN * len(seen.stamps_ns)
    level = FAIL if grave else WARN if texts else PASS
    return Measured(level, texts or ['newer'], numbers, words)


def stamp_error(seen: Readings) -> Measured:
    """Measure by how much the stamps are wrong, from errors that grow with the speed."""
    if seen.stale or np.any(seen.leaps):
        return Measured(PASS, ['hidden'])
    good = np.sort(seen.rows)
    wrong = _spacing_error(seen.stamps_ns[good], seen.position[good], seen.period, seen.grain)
    lie = wrong > STAMP_ERROR_PART * seen.step
    text = 'lie' if lie else 'err' if wrong else 'true'
    words = {'wrong': short(wrong), 'off': wrong * seen.speed, 'speed': seen.speed}
    return Measured(WARN if lie else PASS, [text], {'stamp_error_s': wrong}, words)


def _spacing_error(
    stamps_ns: NDArray[np.int64], position: Array, period: float, count: float
) -> float:
    """Return the standard deviation of the stamps' error [s] if their spacing lies; else 0.

    A reading between two others lies off the middle of both by its speed times d, the distance of
    its stamp from the middle of their stamps. So the regression of one on the other has the slope
    1 for true stamps, and var(true d) / var(d) < 1 for others. This holds for any noise of the
    reading, and for stamps that change the order.

    Parameters
    ----------
    stamps_ns, position : shape (n,), in the order of arrival. period : wrap period [rad]; 0:
        none. count : quantum [rad]; 0: none.
    """
    time = (stamps_ns[:MOST_READINGS] - stamps_ns[0]) * 1e-9
    moves = np.diff(position[:MOST_READINGS])
    if period > 0.0:
        moves -= period * np.round(moves / period)
    steps = np.diff(time)
    step = float(np.median(steps))
    if len(steps) < FEWEST_MOVING or step <= 0.0:
        return 0.0
    around = slice(SPEED_SIDE - 1, -(SPEED_SIDE - 1))
    off = 0.5 * (moves[:-1] - moves[1:])[around]
    early = 0.5 * (steps[:-1] - steps[1:])[around]
    way, passed, longest = (
        np.lib.stride_tricks.sliding_window_view(each, 2 * SPEED_SIDE)
        for each in (moves, steps, np.abs(steps))
    )
    speed = way.sum(axis=1) / np.maximum(passed.sum(axis=1), SPEED_SIDE * step)
    near = longest.max(axis=1) < 5.0 * step
    near &= np.abs(off) <= STAMP_OUTLIER * 1.4826 * np.median(np.abs(off)) + np.abs(speed) * step
    near &= np.abs(speed) > MOVING_PART * float(np.percentile(np.abs(speed), 95))
    if np.count_nonzero(near) < FEWEST_MOVING:
        return 0.0
    off, shift, early = off[near], (speed * early)[near], early[near]
    power = float(np.sum(shift * shift))
    if power <= len(shift) * max(VISIBLE * count, 1e-12) ** 2:
        return 0.0  # the readings are too coarse to show it
    slope = float(np.sum(off * shift)) / power
    unsure = math.sqrt(float(np.sum((off - slope * shift) ** 2 * shift**2))) / power
    if 1.0 - slope < SPACING_DEVIATIONS * unsure:
        return 0.0
    return math.sqrt(min(1.0 - slope, 1.0) * float(np.mean(early * early)) / 1.5)


def clock(seen: Readings) -> Measured:
    """Compare the stamps with the times of arrival."""
    good = seen.rows
    age = (seen.arrival_ns[good] - seen.stamps_ns[good]) * 1e-9
    usual, least = float(np.median(age)), float(np.min(age))
    numbers = {'age_s': usual}
    words = {'usual': short(usual), 'ahead': short(-least)}
    if len(seen.parts) > 1 or len(age) < 20:
        return Measured(PASS, ['few'], {}, words)
    tenth = max(1, len(age) // 10)
    passed = float(seen.stamps_ns[good[-1]] - seen.stamps_ns[good[0]]) * 1e-9
    drifted = float(np.min(age[-tenth:]) - np.min(age[:tenth]))
    jittery = float(np.percentile(age[:tenth], 50) - np.min(age[:tenth]))
    if passed > DRIFT_TIME and abs(drifted) > max(CLOCK_DRIFT * passed, LEAST_DRIFT, 5.0 * jittery):
        numbers['clock_ratio'] = 1.0 - drifted / (passed + drifted)
        drift = {'drifted': short(abs(drifted)), 'passed': short(passed)}
        return Measured(WARN, ['drift'], numbers, drift)
    if abs(usual) > SAME_CLOCK:
        return Measured(PASS, ['another'], numbers)
    if least < -STAMPS_AHEAD:
        return Measured(WARN, ['ahead'], numbers, words)
    old = usual > STAMPS_OLD
    return Measured(WARN if old else PASS, ['old' if old else 'age'], numbers, words)


CLOCK = Check(
    'clock',
    'age, offset and drift of stamps against arrival',
    f'{1e3 * STAMPS_AHEAD:g} ms ahead, {1e3 * STAMPS_OLD:g} ms old, drift above '
    f'{100 * CLOCK_DRIFT:g} %',
    {
        'few': 'stamps are {usual} older than their arrival',
        'drift': 'the stamps run at {clock_ratio:.4f} times the clock of arrival ({drifted} in '
        '{passed}) -> right in a simulation (use_sim_time); else the velocity is wrong by this '
        'factor: check the unit and clock of the stamps',
        'another': 'stamps are of another clock than the arrival',
        'ahead': 'stamps are up to {ahead} ahead of their arrival -> the clocks of two machines '
        'differ: synchronise them (chrony, PTP)',
        'old': 'readings arrive {usual} after their stamp -> estimates are as late: look for a '
        'queue or a slow link, or for clocks that differ',
        'age': 'readings arrive {usual} after their stamp',
    },
    clock,
)
MISSING = Check(
    'missing stamps',
    'samples without a stamp',
    'any',
    {
        'none': '0 of {total} samples',
        'some': '{count} of {total} samples have no time stamp and are dropped -> {remedy}',
    },
    dropped(ZERO_STAMP),
)
ORDER = Check(
    'order of stamps',
    'late stamps, clock jumps, stamps far in the future',
    'any; FAIL if the clock jumps back',
    {
        'newer': 'each is newer than the one before',
        'clock_jumps': 'the clock jumps back {jumps}, {when} -> one bag or simulation per record '
        '(a loop, a restart)',
        'strays': '{strays} single stamps are far in the future -> check the clock of the driver',
        'late': '{late} stamps are older than the one before, and are dropped -> publish in the '
        'order of the stamps; look for two publishers',
    },
    order,
)
SPACING = 'the spacing of stamps varies by {spread} rms ({part:.2g} samples)'
HOLES = '{many}, the longest {longest}, {when} -> look for a blocked publisher or a lossy link'
CHECKS = (
    Check(
        'rate',
        f'median sample rate, and that of up to {RATE_WINDOWS} windows',
        f'windows differ by more than {100 * (OTHER_RATE - 1.0):g} %',
        {
            'rate': '{hz:.5g} Hz, {readings} readings in {span}',
            'copies': '{hz:.5g} Hz, each reading {many}, {readings} in {span}',
            'changes': 'it changes between {fastest_hz:.4g} and {slowest_hz:.4g} Hz, first about '
            '{at:.1f} s after the start -> check the load of the publisher; gains fit one rate',
        },
        rate,
    ),
    Check(
        'jitter',
        'spread of the spacing of stamps',
        f'robust spread above {100 * IRREGULAR:g} % of the sample time',
        {
            'spacing': SPACING,
            'irregular': f'{SPACING} -> stamp each reading when it is taken, not when it is '
            'published or received',
        },
        jitter,
    ),
    Check(
        'holes',
        'gaps, and single missing samples',
        f'a gap of {HOLE_RATIO:g} sample times; more than {100 * LOST_OFTEN:g} % missing',
        {
            'none': 'none; {lost_fraction:.2%} of single samples missing',
            'lost': '{lost_fraction:.1%} of the samples are missing, a few at a time -> look for a '
            "lossy link or a queue of depth 1; raise the publisher's priority",
            'holes': HOLES,
            'restarts': f'{HOLES}; observers start anew after those above gap_max',
        },
        holes,
    ),
    Check(
        'repeated stamps',
        'samples with the stamp of the one before',
        'any',
        {
            'none': '0 of {total} samples',
            'some': '{count} of {total} samples repeat the previous stamp and are dropped, {when} '
            '-> stamp each reading once; look for two publishers, a name that a message has '
            'twice, or stamps of a coarse clock',
        },
        dropped(DUPLICATE),
    ),
    ORDER,
    Check(
        'lying stamps',
        'error of the stamps: in motion, a reading must fit those before and after it',
        f'above {100 * STAMP_ERROR_PART:g} % of the sample time',
        {
            'hidden': 'hidden by repeats and jumps of the readings',
            'true': 'no error seen in the motion',
            'err': 'wrong by {wrong} rms',
            'lie': 'the stamps are wrong by {wrong} rms: in motion the readings do not fit them '
            '({off:.2g} rad at {speed:.2g} rad/s) -> stamp each reading when it is taken; a clock '
            'of the device is best',
        },
        stamp_error,
    ),
    CLOCK,
    MISSING,
)
