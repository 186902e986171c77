"""Readings that are repeated: a sensor slower than the driver that publishes it.

A driver that publishes at 1 kHz what its sensor reads at 100 Hz repeats each reading nine times.
An observer that takes the repeated ones for measurements sees a joint that stops and jumps. So
`advance` of `estimator_pkg.driver.track` drops them, once the pattern is recognised.

The evidence is a hold: a reading that stays while the motion moves. An encoder at creep holds its
reading as regularly, but then each change is one count, whatever the speed, and the holds become
longer or shorter with it. Where readings are repeated, the changes follow the speed and the holds
do not. So holds are gathered in chains of equal length and spacing, and a hold counts if the
change into it is several times the second smallest change in its chain (one alone may be part of a
count, where a sensor clips), goes the same way as the one before, and leads to another reading.
Noise gives equal readings at random, which make no chains. At constant speed a chain shows it too
whose holds all have exactly the same spacing while their changes differ: creep would have to stay
at a whole fraction of a count per sample, of readings that are rounded coarsely.

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

SCORE = 12  # holds of one sample after which a chain is believed; half as many of longer ones
ALIKE = 50  # the same of holds that are spaced exactly alike, ...
DIFFERENCES = 10  # ... if so many of their changes differ
VARIED = 3.0  # times the second smallest change of the chain: motion, not one count
DIFFERENT = 0.002  # part of a change by which another one differs that is not the same count
RESIDUE = 1e-10  # rad or m; and part of the reading for float32: smaller changes are rounding
ROUNDING = 3e-7
SLIP = 1.25  # samples by which the spacing in a chain may differ, ...
SLACK = 0.2  # ... or this part of it
FAR = 16.0  # samples; holds of one sample at a larger distance are no chain
BREAKS = 3  # changes in a row without a hold, where each had one, end the recognition


def hold(
    repeats: Repeats, stamp_ns: int, reading: float, earlier: float, mean_dt: float, period: float
) -> Repeats:
    """Return what is known once a changed reading is repeated, while no pattern is recognised.

    Parameters
    ----------
    stamp_ns : of the repeated reading.
    reading, earlier : the reading that is repeated, and the one before it [rad or m].
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
    """Return what is known after an equal reading in a pattern, and whether it is a repeated one.

    One more than the pattern has means that the joint is at rest: a reading of its own.
    """
    most, length, chain = repeats
    stamp_ns, spacing_ns, change, value, least, low, _, _, _, _, _, patience, pace = chain
    length += 1
    drop = length <= most
    length, alone = (length, 0) if drop else (0, 1)
    chain = (stamp_ns, spacing_ns, change, value, least, low, alone, 0, 0, 0, 0, patience, pace)
    return (most, length, chain), drop


def changed(repeats: Repeats, passed_ns: int, change: float) -> Repeats:
    """Return what is known after a changed reading in a pattern; `BLANK` where that ends it.

    Parameters
    ----------
    passed_ns : since the last sample that was used.
    change : of the reading [rad or m].
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
