# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The quantum as the steps of the readings show it: the smallest step, or difference of two.

A finer step than any before is believed at once until the steps have confirmed the quantum, from
then on if such steps are the rule. Steps that are no multiples of it, and scatter less than those
of a counter, are no counts. Until the first step everything is relative to `UNIT`.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.sensor import Sensor
from estimator_pkg.record import record

UNIT = 1.0  # [rad] quantum while none is known
ROUNDING = 1e-6  # of the reading: smaller steps are a float32's last digit
LARGEST = 1e3  # [rad or m] but of no more than this: a wheel turns on, and its steps stay
RESIDUE = 1e-3  # of the quantum: a change by less is rounding residue, and no motion
FINEST = 1e-10  # [rad or m] no sensor resolves less (36 bits a turn; an atom's diameter)
JUMP = 1e3  # times the range of all readings before: those before were residue
SHOWN = 8.0  # multiples of the quantum in a row that confirm it, if they could show a finer one
UNLIKE = 5.0  # steps in a row that are no multiples, without a scatter: no counter
SMOOTH = 0.02  # of the squared smallest step: a counter scatters more, unless its speed is constant
SEARCH = 32.0  # other steps in a row, after which only finer ones are looked at

CLOSE = 0.9  # a step above this part of the quantum is one, but for its last digits,
DIGITS = 0.01  # which are below this part

AGREES = 0  # the given quantum, with the steps seen
TOO_LARGE = 1
TOO_SMALL = 2


@record
class Steps:
    """The steps of the readings, and what they have shown of the quantum."""

    smallest: float  # smallest step of the reading, or of its steps [rad]
    # how many multiples of it came in a row, of those that could show a finer step; below 0: how
    # many others did
    shown: float
    finest: float  # smallest step since it is confirmed [rad]
    finer: float  # by how many more finer ones came than others
    part: float  # the quantum over the smallest step
    jump: float  # the last step [rad], where it exceeds `JUMP` times the range before, else 0


def begin_steps(steps: Steps) -> None:
    """Set the steps before anything has moved."""
    steps.smallest = steps.finest = math.inf
    steps.shown = steps.finer = steps.jump = 0.0
    steps.part = 1.0


def follow_steps(
    steps: Steps, step: float, last: float, since: float, size: float, scatter: float
) -> None:
    """Take a `step` [rad], where the last before was +-`last` [rad].

    Parameters
    ----------
    last : 0: none has moved yet.
    since : time between that and the last reading before this one [s]. A step that comes after
        unchanged readings shows the quantum, for a shaft that skipped a count would not rest.
    size : of the two readings [rad]: of their last digits nothing is learnt.
    scatter : mean square of third differences over 20 [rad^2].
    """
    moved = found = abs(step)
    grain = max(ROUNDING * min(size, LARGEST), RESIDUE * min(steps.smallest, moved))
    shows = since > 0.0
    if last > 0.0:
        bend = abs(moved - last)
        if bend > grain:
            shows = True
            if bend < found:
                found = bend
    steps.jump = 0.0
    if found <= grain:
        return
    if found < CLOSE * steps.smallest:
        steps.finest = min(found, steps.finest)
        steps.finer += 1.0
        if steps.shown < SHOWN or steps.finer >= SHOWN:
            steps.smallest, steps.shown = steps.finest, 1.0 if shows else 0.0
            steps.finest, steps.finer = math.inf, 0.0
        return
    rest = math.fmod(moved, steps.smallest)
    if steps.finer > 0.0:
        steps.finer -= 1.0
    if steps.finer == 0.0:
        steps.finest = math.inf
    if steps.shown < SHOWN:
        confirm(steps, found, rest, shows, scatter)


def confirm(steps: Steps, found: float, rest: float, shows: bool, scatter: float) -> None:
    """Take a step that is no finer one, while the quantum is not confirmed.

    Parameters
    ----------
    found : the step, or its difference from the last one [rad].
    rest : of the step, by the smallest one [rad]. shows : it could have shown a finer one.
    """
    steps.smallest = smallest = min(steps.smallest, found)
    smooth = scatter < SMOOTH * smallest * smallest
    if DIGITS * smallest < rest < (1.0 - DIGITS) * smallest:
        steps.shown = min(steps.shown, 0.0) - (1.0 if shows else 0.5)
        if steps.shown <= -UNLIKE and smooth:
            steps.part = DIGITS
    elif shows and (steps.part == 1.0 or steps.shown < SHOWN - 1.0 or not smooth):
        steps.shown = max(steps.shown, 0.0) + 1.0
        if steps.shown == SHOWN:
            steps.part = 1.0


def shows_quantum(steps: Steps, step: float, last: float, since: float, quantum: float) -> bool:
    """Return False if a step [rad] cannot change what is known of the quantum.

    Most cannot: nothing is searched for, and neither this one nor its difference from the `last` is
    smaller than the quantum in use. See `follow_steps`.
    """
    step = abs(step)
    if step < CLOSE * quantum:
        return True
    bend = abs(step - last)
    if -SEARCH < steps.shown < SHOWN or steps.finer > 0.0:
        return since > 0.0 or bend > ROUNDING * step
    return DIGITS * quantum < bend < CLOSE * quantum


def quantum_of(steps: Steps, given: float) -> float:
    """Return the quantum to use [rad]; 0: none is known yet."""
    smallest = steps.smallest * steps.part
    if given > 0.0:
        return given if agreement(steps, given) == AGREES else smallest
    return smallest if smallest < math.inf else 0.0


def agreement(steps: Steps, given: float) -> int:
    """Return how the given quantum [rad] fits the steps seen: AGREES, TOO_LARGE or TOO_SMALL."""
    if given <= 0.0 or steps.shown < SHOWN:
        return AGREES
    if steps.smallest < CLOSE * given:
        return TOO_LARGE
    return TOO_SMALL if CLOSE * steps.smallest > given else AGREES


def is_residue(step: float, size: float, given: float, used: float, first: bool) -> bool:
    """Return True if a step [rad] is rounding residue, and no motion.

    Parameters
    ----------
    size : of the two readings [rad]. given, used : the quantum as given and in use [rad].
    first : this is the first step of all.
    """
    least = ROUNDING * min(size, LARGEST) if first and given == 0.0 else RESIDUE * used
    return -least <= step <= least or -FINEST < step < FINEST


def search(steps: Steps, step: float, size: float, given: float, sensor: Sensor) -> float:
    """Take a step; return the quantum to use [rad].

    Parameters
    ----------
    step, size : as of `follow_steps`.
    given : quantum as given [rad]; 0: not known.
    """
    follow_steps(steps, step, sensor.size, sensor.since, size, sensor.scatter)
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
