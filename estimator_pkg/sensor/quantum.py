# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The quantum as the steps of the readings show it: the smallest step, or difference of two.

A finer step than any before is believed at once, and starts a search that decides whether it was a
stray reading. Until the first step everything is relative to `UNIT`.
"""

from __future__ import annotations

import math

from estimator_pkg.record import record
from estimator_pkg.sensor.noise import Sensor

UNIT = 1.0  # [rad] quantum while none is known
LAST_DIGIT = 1e-6  # of the reading: smaller steps are a float32's last digit
LARGEST_READING = 1e3  # [rad or m] but of no more than this: a wheel turns on, and its steps stay
RESIDUE_PART = 1e-3  # of the quantum: a change by less is rounding residue, and no motion
FINEST_QUANTUM = 1e-10  # [rad or m] no sensor resolves less (36 bits a turn; an atom's diameter)
FINER_STEPS = 2.0  # a smaller step than the given quantum is believed when it came twice
CONFIRMING_STEPS = 8.0  # readings that show the quantum, before it may be larger than before
STRAY_STEPS = 3.0  # the first of them, which a stray reading makes by itself: there, back, and on
SEARCH = 96.0  # readings among which these are looked for, after a new smallest step
FINER = 0.75  # the quantum is too large if steps below this part of it are seen

UNLIKE = 5.0  # steps in a row that are no multiples of each other, without a scatter: no counter
SMOOTH = 0.02  # of the squared smallest step: a counter scatters more, unless its speed is constant

FLOATS = 0.0  # in place of the smallest step: they are no counts, unless the search shows some

SAME_STEP = 0.9  # a step above this part of the quantum is one, but for its last digits,
DIGITS = 0.01  # which are below this part

QUANTUM_AGREES = 0  # the given quantum, with the steps seen
TOO_LARGE = 1
TOO_SMALL = 2


@record
class Steps:
    """The steps of the readings, and what they have shown of the quantum."""

    smallest: float  # smallest step of the reading, or of its steps [rad]
    candidate: float  # for the quantum, of which all steps since it came up are multiples [rad]
    # how many of them could have shown a finer one; below 0: how many were no multiples
    shown: float
    least: float  # the smallest of these but the first `STRAY_STEPS` [rad]
    left: float  # readings for which the search goes on
    finer: float  # steps that were finer than the given quantum


def begin_steps(steps: Steps) -> None:
    """Set the steps before anything has moved."""
    steps.smallest = steps.candidate = steps.least = math.inf
    steps.shown = steps.finer = 0.0
    steps.left = SEARCH


def follow_steps(
    steps: Steps, step: float, last: float, since: float, size: float, given: float, scatter: float
) -> None:
    """Take a `step` [rad], where the last before was +-`last` [rad].

    A finer step than any before is believed at once, and starts a search: when all steps have been
    multiples of a candidate, `CONFIRMING_STEPS` of them could have shown a finer one, and one
    repeated it, it is the quantum, and what was finer was a stray reading.

    Parameters
    ----------
    last : 0: none has moved yet.
    since : time between that and the last reading before this one [s]. A step that comes after
        unchanged readings shows the quantum, for a shaft that skipped a count would not rest.
    size : of the two readings [rad]: of their last digits nothing is learnt.
    given : quantum as given [rad]; 0: not known.
    scatter : mean square of third differences over 20 [rad^2].
    """
    moved = found = abs(step)
    grain = max(LAST_DIGIT * min(size, LARGEST_READING), RESIDUE_PART * min(steps.smallest, moved))
    shows = since > 0.0
    if last > 0.0:
        bend = abs(moved - last)
        if bend > grain:
            shows = True
            if bend < found:
                found = bend
    if found <= grain:
        return
    if found < FINER * given and steps.finer < FINER_STEPS:
        steps.finer += 1.0
    if found < SAME_STEP * steps.smallest:
        steps.left = SEARCH
    if found < steps.smallest:
        steps.smallest = found if steps.least != FLOATS else DIGITS * found
    candidate = steps.candidate
    rest = math.fmod(moved, candidate)
    if found < SAME_STEP * candidate or DIGITS * candidate < rest < (1.0 - DIGITS) * candidate:
        refute(steps, found, 1.0 if shows else 0.5, scatter)
    elif shows and steps.shown < CONFIRMING_STEPS:
        confirm(steps, found, given, scatter)
    steps.left = max(steps.left, 0.0)


def refute(steps: Steps, found: float, weight: float, scatter: float) -> None:
    """Take a step that is no multiple of the candidate: `found` [rad] is the next one.

    Steps that are no multiples of each other, and scatter less than a counter's, are no counts:
    the quantum is `DIGITS` of them.
    """
    steps.shown = min(steps.shown, 0.0) - weight
    steps.candidate = found
    steps.left -= 1.0
    if steps.least != FLOATS:
        steps.least = math.inf
        if steps.shown <= -UNLIKE and scatter < SMOOTH * steps.smallest * steps.smallest:
            steps.smallest *= DIGITS
            steps.shown, steps.least, steps.left = 0.0, FLOATS, SEARCH


def confirm(steps: Steps, found: float, given: float, scatter: float) -> None:
    """Take a multiple of the candidate that could have shown a finer one."""
    steps.shown = (1.0 if steps.shown <= -1.0 else max(steps.shown, 0.0)) + 1.0
    steps.left -= 1.0
    if steps.shown > STRAY_STEPS and found < steps.least:
        steps.least = found
    if steps.shown < CONFIRMING_STEPS:
        return
    if SAME_STEP * steps.least > steps.candidate:  # a stray reading alone showed it
        steps.candidate, steps.shown = steps.least, 1.0
        steps.least, steps.left = math.inf, SEARCH
    elif steps.least == FLOATS and scatter < SMOOTH * steps.candidate * steps.candidate:
        steps.shown -= 1.0  # multiples of one step, but too smooth for a counter
    else:
        steps.smallest, steps.least, steps.left = steps.candidate, math.inf, 0.0
        if steps.candidate >= FINER * given:
            steps.finer = 0.0


def shows_quantum(steps: Steps, step: float, last: float, since: float, quantum: float) -> bool:
    """Return False if a step [rad] cannot change what is known of the quantum.

    Most cannot: nothing is searched for, and neither this one nor its difference from the `last` is
    smaller than the quantum in use. See `follow_steps`.
    """
    step = abs(step)
    if step < SAME_STEP * quantum:
        return True
    bend = abs(step - last)
    if steps.left > 0.0:
        return since > 0.0 or bend > LAST_DIGIT * step
    return DIGITS * quantum < bend < SAME_STEP * quantum


def quantum_of(steps: Steps, given: float) -> float:
    """Return the quantum to use [rad]; 0: none is known yet."""
    smallest = steps.smallest
    if given > 0.0:
        return given if agreement(steps, given) == QUANTUM_AGREES else smallest
    return smallest if smallest < math.inf else 0.0


def agreement(steps: Steps, given: float) -> int:
    """Return how the given quantum [rad] fits: QUANTUM_AGREES, TOO_LARGE or TOO_SMALL."""
    if given <= 0.0:
        return QUANTUM_AGREES
    seen, confirmed = steps.smallest, steps.shown >= CONFIRMING_STEPS
    if seen < given and (steps.finer >= FINER_STEPS or (confirmed and seen < SAME_STEP * given)):
        return TOO_LARGE
    return TOO_SMALL if confirmed and SAME_STEP * seen > given else QUANTUM_AGREES


def is_residue(step: float, size: float, given: float, used: float, first: bool) -> bool:
    """Return True if a step [rad] is rounding residue, and no motion.

    Parameters
    ----------
    size : of the two readings [rad]. given, used : the quantum as given and in use [rad].
    first : this is the first step of all.
    """
    least = RESIDUE_PART * used
    if first and given == 0.0:
        least = LAST_DIGIT * min(size, LARGEST_READING)
    return -least <= step <= least or -FINEST_QUANTUM < step < FINEST_QUANTUM


def search_quantum(steps: Steps, step: float, size: float, given: float, sensor: Sensor) -> float:
    """Take a step; return the quantum to use [rad].

    Parameters
    ----------
    step, size : as of `follow_steps`.
    given : quantum as given [rad]; 0: not known.
    """
    follow_steps(steps, step, sensor.size, sensor.since, size, given, sensor.noise_bound)
    return quantum_of(steps, given)


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
