# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Detect repeated readings: a sensor slower than the driver that publishes it.

A driver that publishes at 1 kHz the readings of a 100 Hz sensor repeats each reading nine times. An
observer that treats the repeated ones as measurements sees a joint that stops and jumps. So
`advance` of `estimator_pkg.driver.track` drops them, once the pattern is recognised.

The evidence is a hold: an unchanged reading while the joint moves. An encoder at creep repeats its
reading as regularly, but then each change is one count, whatever the speed, and the length of the
holds depends on the speed. With repeated readings the changes depend on the speed and the holds do
not. So holds are collected in chains of equal length and spacing. A hold counts if the change into
it is several times the second smallest change in its chain (a single one may be part of a count,
where a sensor clips), has the same sign as the previous change, and leads to another reading. Noise
gives equal readings at random, which form no chains. At constant speed there is another criterion:
a chain whose holds all have exactly the same spacing while their changes differ. For creep to look
like this, it would need exactly a rational fraction of a count per sample and coarsely rounded
readings.

What is known: how many equal readings in a row are dropped (0: no pattern is recognised); how many
were since the last change, or the last sample used; and the chain, see `Chain`.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.circle import wrap

# (stamp of the newest hold [ns]; its spacing from the one before [ns]; the newest change [rad]; the
# reading of the newest hold [rad]; the smallest and the second smallest change of the chain [rad];
# the score, and in a pattern 1 after a reading at rest; holds in a row whose spacing was exactly
# the same; how many of their changes differed; length of the longest hold; changes in a row; how
# many of these end the recognition; the sample time of the messages [ns])
Chain = tuple[int, int, float, float, float, float, int, int, int, int, int, int, float]
Repeats = tuple[int, int, Chain]

BLANK: Repeats = (0, 0, (0, 0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0, 0, 0, 0, 0.0))

SCORE = 12  # a chain is accepted at this many holds of one sample, half as many longer ones
ALIKE = 50  # or at this many holds with exactly the same spacing,
DIFFERENCES = 10  # if this many of their changes differ
VARIED = 3.0  # a change above this multiple of the second smallest is motion, not one count
DIFFERENT = 0.002  # two changes differ if their relative difference is larger than this
RESIDUE = 1e-10  # smaller changes are rounding [rad or m],
ROUNDING = 3e-7  # or smaller than this fraction of the reading (float32)
SLIP = 1.25  # allowed difference of the spacing within a chain [samples],
SLACK = 0.2  # or this fraction of it
FAR = 16.0  # holds of one sample further apart form no chain [samples]
BREAKS = 3  # this many changes in a row without a hold end the recognition


def hold(
    repeats: Repeats, stamp_ns: int, reading: float, earlier: float, mean_dt: float, period: float
) -> Repeats:
    """Return the state after a reading is repeated that had changed, without a pattern so far.

    Parameters
    ----------
    stamp_ns : stamp of the repeated reading.
    reading, earlier : the repeated reading, and the one before it [rad or m].
    mean_dt : mean sample time [s].
    period : wrap period [rad]; 0: none.
    """
    _, length, chain = repeats
    start_ns, before_ns, last, value, least, low, score, alike, differences, longest, _, _, _ = (
        chain
    )
    change = wrap(reading - earlier, period)
    size, pace = abs(change), 1e9 * mean_dt
    spacing_ns = stamp_ns - start_ns
    slip = abs(spacing_ns - before_ns)
    follows = earlier == value  # one change since the last hold
    regular = slip <= max(SLIP * pace, SLACK * spacing_ns) and (
        follows or (length == 1 and spacing_ns < FAR * pace)
    )
    rounding = RESIDUE + ROUNDING * (abs(reading) + abs(earlier))
    if not regular or size <= rounding:
        chain = (stamp_ns, spacing_ns, change, reading, size, math.inf, 0, 0, 0, 0, 0, 0, 0.0)
        return 0, 1, chain
    held = int(spacing_ns / pace + 0.5) - 1 if follows else 1
    longest = max(longest, held, 1)
    if size < least:
        least, low = size, least
    elif size < low:
        low = size
    alike += 1
    if slip > 0.5 * pace:
        alike = differences = 0
    if change * last > 0.0 and reading != value:
        if size >= VARIED * low:
            score += 1 if held == 1 else 2
        if abs(change - last) > DIFFERENT * size + rounding:
            differences += 1
    if score < SCORE and (alike < ALIKE or differences < DIFFERENCES):
        evidence = (score, alike, differences, longest)
        return 0, 1, (stamp_ns, spacing_ns, change, reading, least, low) + evidence + (0, 0, 0.0)
    patience = BREAKS if follows else BREAKS + 2 * int(spacing_ns / pace + 0.5)
    chain = (stamp_ns, spacing_ns, change, reading, least, low, 0, 0, 0, 0, 0, patience, pace)
    return longest, 1, chain


def repeated(repeats: Repeats) -> tuple[Repeats, bool]:
    """Return the state after an equal reading in a pattern, and True if it is a repeated one.

    One more than the pattern has means that the joint is at rest: a new reading.
    """
    most, length, chain = repeats
    stamp_ns, spacing_ns, change, value, least, low, _, _, _, _, _, patience, pace = chain
    length += 1
    drop = length <= most
    length, alone = (length, 0) if drop else (0, 1)
    chain = (stamp_ns, spacing_ns, change, value, least, low, alone, 0, 0, 0, 0, patience, pace)
    return (most, length, chain), drop


def changed(repeats: Repeats, passed_ns: int, change: float) -> Repeats:
    """Return the state after a reading that changed in a pattern; `BLANK` if that ends it.

    Parameters
    ----------
    passed_ns : time since the last used sample.
    change : change of the reading [rad or m].
    """
    most, length, chain = repeats
    stamp_ns, spacing_ns, last, value, least, low, alone, _, _, _, changes, patience, pace = chain
    changes = changes + 1 if length == 0 and passed_ns < 1.5 * pace else 0
    if changes >= patience:
        return BLANK
    if (
        alone == 1
        and length == 0
        and change * last > 0.0
        and abs(change) >= VARIED * low
        and abs(last) >= 0.5 * abs(change)
    ):
        most += 1  # what was taken for a reading at rest was in the midst of the motion
    chain = (stamp_ns, spacing_ns, change, value, least, low, 0, 0, 0, 0, changes, patience, pace)
    return most, 0, chain


def note_on_repeats(repeats: Repeats) -> str:
    """Return a note on repeated readings for the status; '' without any."""
    times, _, _ = repeats
    if times == 0:
        return ''
    return (
        f'the stream repeats its readings (up to {times} times each): the repeated ones are dropped'
    )
