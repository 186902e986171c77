# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The quantum as the steps of the readings show it: the smallest step, or difference of two.

A finer step than any before is believed at once, and starts a search that decides whether it was a
stray reading. Until the first step everything is relative to `UNIT`.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.sensor import Sensor
from estimator_pkg.observers.maths.seldom import seldom

UNIT = 1.0  # [rad] quantum while none is known
ROUNDING = 1e-6  # of the reading: smaller steps are a float32's last digit
LARGEST = 1e3  # [rad or m] but of no more than this: a wheel turns on, and its steps stay
RESIDUE = 1e-3  # of the quantum: a change by less is rounding residue, and no motion
FINEST = 1e-10  # [rad or m] no sensor resolves less (36 bits a turn; an atom's diameter)
JUMP = 1e3  # times the range of all readings before: those before were residue
SEEN = 2.0  # a smaller step than the given quantum is believed when it came twice
SHOWN = 8.0  # readings that show the quantum, before it is thought to be larger than before
RETURNS = 3.0  # the first of them, which a stray reading makes by itself: there, back, and on
SEARCH = 96.0  # readings among which these are looked for, after a new smallest step
FINER = 0.75  # the quantum is too large if steps below this part of it are seen

UNLIKE = 5.0  # steps in a row that are no multiples of each other, without a scatter: no counter
SMOOTH = 0.02  # of the squared smallest step: a counter scatters more, unless its speed is constant

FLOATS = 0.0  # in place of the smallest step: they are no counts, unless the search shows some

CLOSE = 0.9  # a step above this part of the quantum is one, but for its last digits,
DIGITS = 0.01  # which are below this part

AGREES, TOO_LARGE, TOO_SMALL = 0, 1, 2

# (smallest step of the reading, or of its steps, seen [rad]; candidate for the quantum, of which
# all steps since it came up are multiples [rad]; how many of them could have shown a finer one,
# below 0: how many were no multiple of the one before;
# the smallest of these but the first `RETURNS` [rad]; readings for which the search goes on;
# steps that were finer than the given quantum; the last step [rad], where it was more than `JUMP`
# times the range of all readings before, else 0)
Steps = tuple[float, float, float, float, float, float, float]

FIRST_STEPS: Steps = (math.inf, math.inf, 0.0, math.inf, SEARCH, 0.0, 0.0)


def follow_steps(
    steps: Steps,
    step: float,
    last: float,
    since: float,
    size: float,
    quantum: float,
    scatter: float,
) -> Steps:
    """Return the steps after one of `step` [rad], where the last before was +-`last` [rad].

    A finer step than any before is believed at once, and starts a search: when all steps have been
    multiples of a candidate, `SHOWN` of them could have shown a finer one, and one repeated it, it
    is the quantum, and what was finer was a stray reading.

    Parameters
    ----------
    last : 0: none has moved yet.
    since : time between that and the last reading before this one [s]. A step that comes after
        unchanged readings shows the quantum, for a shaft that skipped a count would not rest.
    size : of the two readings [rad]: of their last digits nothing is learnt.
    quantum : as given [rad]; 0: not known.
    scatter : mean square of third differences over 20 [rad^2]. Steps that are no multiples of each
        other, and scatter less than a counter's, are no counts: the quantum is `DIGITS` of them.
    """
    smallest, candidate, shown, least, left, finer, _ = steps
    moved = found = abs(step)
    grain = max(ROUNDING * min(size, LARGEST), RESIDUE * min(smallest, moved))
    shows = since > 0.0
    if last > 0.0:
        bend = abs(moved - last)
        if bend > grain:
            shows = True
            if bend < found:
                found = bend
    if found <= grain:
        return (smallest, candidate, shown, least, left, finer, 0.0)
    if found < FINER * quantum and finer < SEEN:
        finer += 1.0
    if found < CLOSE * smallest:
        left = SEARCH
    if found < smallest:
        smallest = found if least != FLOATS else DIGITS * found
    rest = moved % candidate
    if found < CLOSE * candidate or DIGITS * candidate < rest < (1.0 - DIGITS) * candidate:
        shown = (shown if shown < 0.0 else 0.0) - (1.0 if shows else 0.5)
        candidate, left = found, left - 1.0
        if least != FLOATS:
            least = math.inf
            if shown <= -UNLIKE and scatter < SMOOTH * smallest * smallest:
                smallest, shown, least, left = DIGITS * smallest, 0.0, FLOATS, SEARCH
    elif shows and shown < SHOWN:
        shown, left = (1.0 if shown <= -1.0 else 0.0 if shown < 0.0 else shown) + 1.0, left - 1.0
        if shown > RETURNS and found < least:
            least = found
        if shown == SHOWN and CLOSE * least > candidate:  # a stray reading alone showed it
            candidate, shown, least, left = least, 1.0, math.inf, SEARCH
        elif shown == SHOWN and least == FLOATS and scatter < SMOOTH * candidate * candidate:
            shown -= 1.0  # multiples of one step, but too smooth for a counter
        elif shown == SHOWN:
            smallest, least, left = candidate, math.inf, 0.0
            if candidate >= FINER * quantum:
                finer = 0.0
    return (smallest, candidate, shown, least, left if left > 0.0 else 0.0, finer, 0.0)


def shows_quantum(steps: Steps, step: float, last: float, since: float, quantum: float) -> bool:
    """Return False if a step [rad] cannot change what is known of the quantum.

    Most cannot: nothing is searched for, and neither this one nor its difference from the `last` is
    smaller than the quantum in use. See `follow_steps`.
    """
    step = abs(step)
    if step < CLOSE * quantum:
        return True
    bend = abs(step - last)
    _, _, _, _, left, _, _ = steps
    if left > 0.0:
        return since > 0.0 or bend > ROUNDING * step
    return DIGITS * quantum < bend < CLOSE * quantum


def quantum_of(steps: Steps, given: float) -> float:
    """Return the quantum to use [rad]; 0: none is known yet."""
    smallest, _, _, _, _, _, _ = steps
    if given > 0.0:
        return given if agreement(steps, given) == AGREES else smallest
    return smallest if smallest < math.inf else 0.0


def agreement(steps: Steps, given: float) -> int:
    """Return how the given quantum [rad] fits the steps seen: AGREES, TOO_LARGE or TOO_SMALL."""
    seen, _, shown, _, _, finer, _ = steps
    if given <= 0.0:
        return AGREES
    confirmed = shown >= SHOWN
    if seen < given and (finer >= SEEN or (confirmed and seen < CLOSE * given)):
        return TOO_LARGE
    if confirmed and CLOSE * seen > given:
        return TOO_SMALL
    return AGREES


@seldom
def search(
    steps: Steps, step: float, size: float, given: float, sensor: Sensor, first: bool
) -> tuple[bool, Steps, float]:
    """Return whether a step is no residue, and what it shows: steps, and the quantum [rad].

    Parameters
    ----------
    step, size, given : as `step`, `size` and `quantum` of `follow_steps`.
    first : this is the first step of all.
    """
    used, _, scatter, _, _, _, last, since, _, _, _ = sensor
    least = ROUNDING * min(size, LARGEST) if first and given == 0.0 else RESIDUE * used
    if -least <= step <= least or -FINEST < step < FINEST:
        return False, steps, used
    steps = follow_steps(steps, step, last, since, size, given, scatter)
    return True, steps, quantum_of(steps, given)


def with_jump(steps: Steps, jump: float) -> Steps:
    """Return the steps where the last one of `jump` [rad] may show that all before was residue."""
    smallest, candidate, shown, least, left, finer, _ = steps
    return (smallest, candidate, shown, least, left, finer, jump)


def misfit(steps: Steps, given: float) -> str:
    """Return how the given quantum [rad] differs from the steps seen, as text for users, or ''."""
    judged, found = agreement(steps, given), quantum_of(steps, 0.0)
    if judged == TOO_LARGE:
        return (
            f'quantum {given:.4g} is too large: steps of {found:.4g} were seen, which is '
            'used instead'
        )
    if judged == TOO_SMALL:
        return (
            f'quantum {given:.4g} is too small: no step below {found:.4g} was seen, which '
            'is used instead'
        )
    return ''
