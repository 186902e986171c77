# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The sensor as its readings show it: the quantum, and the noise above it.

The noise is seen in the change of the residual of linear interpolation between every second
reading, which is a third difference divided by the true sample times: position, speed and
acceleration are gone from it. Where one such difference has the sign of the one before, it is no
noise, which alternates, but a vibration of a few samples' period. The quantum is the smallest step
of the reading, or of the steps.
"""

from __future__ import annotations

import math

OUTLIER = 25.0  # largest weight of a square, in its expected value: 5 sigma
LASTING = 4.0 / 11.0  # third differences are twice the changes of the residual; 3 + 8, see below
ROUNDING = 1e-6  # of the reading: smaller steps are a float32's last digit
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

CLOSE = 0.9  # a step above this part of the quantum is one, but for its last digits,
DIGITS = 0.01  # which are below this part

AGREES, TOO_LARGE, TOO_SMALL = 0, 1, 2

# (quantum in use [rad]; noise: variance of the edges, without the quantum's own [rad^2]; scatter:
# mean square of third differences over 20 [rad^2]; residual, step [rad] and dt [s] of the sample
# before, dt 0: none; size of the last change of the reading [rad], 0: none, and time since it
# [s]; change of the residual one sample before [rad], inf: none; square of the third differences
# that last [rad^2], negative where they alternate; mean dt [s])
Sensor = tuple[float, float, float, float, float, float, float, float, float, float, float]
# (smallest step of the reading, or of its steps, seen [rad]; candidate for the quantum, of which
# all steps since it came up are multiples [rad]; how many of them could have shown a finer one,
# below 0: how many were no multiple of the one before;
# the smallest of these but the first `RETURNS` [rad]; readings for which the search goes on;
# steps that were finer than the given quantum; the last step [rad], where it was more than `JUMP`
# times the range of all readings before, else 0)
Steps = tuple[float, float, float, float, float, float, float]

FIRST_STEPS: Steps = (math.inf, math.inf, 0.0, math.inf, SEARCH, 0.0, 0.0)


def begin_sensor(quantum: float, blur: float) -> Sensor:
    """Return the sensor before anything was seen. `blur`: see `follow_sensor`."""
    return (
        quantum,
        blur * blur * quantum * quantum,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        math.inf,
        0.0,
        0.0,
    )


def first_step(quantum: float, blur: float, step: float, dt: float) -> Sensor:
    """Return the sensor as after the first `step` [rad], in a sample of `dt` [s]."""
    return (
        quantum,
        blur * blur * quantum * quantum,
        0.0,
        0.0,
        step,
        dt,
        abs(step),
        0.0,
        math.inf,
        0.0,
        0.0,
    )


def with_noise(sensor: Sensor, noise: float) -> Sensor:
    """Return the sensor with another noise [rad^2]."""
    quantum, _, scatter, residual, step, dt, change, since, bend, lasting, pace = sensor
    return (quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, pace)


def counted_as(sensor: Sensor, step: float) -> Sensor:
    """Return the sensor with its last step [rad] as read, where the reading was corrected."""
    quantum, noise, scatter, residual, corrected, dt, _, since, bend, lasting, pace = sensor
    return (quantum, noise, scatter, residual, corrected, dt, abs(step), since, bend, lasting, pace)


def aged(sensor: Sensor, v: float) -> Sensor:
    """Return a sensor whose readings are up to one sample old, at the speed `v` [rad/s].

    The age is uniform, so the noise is at least (v dt)^2/12. It repeats like a sawtooth, of which
    third differences see the teeth alone.
    """
    quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, pace = sensor
    age = v * v * pace * pace / 12.0
    noise = age if noise < age else noise
    scatter = age if scatter < age else scatter
    return (quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, pace)


def paced(sensor: Sensor, pace: float) -> Sensor:
    """Return the sensor with another mean sample time [s]."""
    quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, _ = sensor
    return (quantum, noise, scatter, residual, step, dt, change, since, bend, lasting, pace)


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
    grain = max(ROUNDING * size, RESIDUE * min(smallest, moved))
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
        smallest = found
    rest = moved % candidate
    if found < CLOSE * candidate or DIGITS * candidate < rest < (1.0 - DIGITS) * candidate:
        shown = (shown if shown < 0.0 else 0.0) - (1.0 if shows else 0.5)
        candidate, least, left = found, math.inf, left - 1.0
        if shown <= -UNLIKE and scatter < SMOOTH * smallest * smallest:
            smallest, shown, left = DIGITS * smallest, 0.0, 0.0
    elif shows and shown < SHOWN:
        shown, left = (1.0 if shown <= -1.0 else 0.0 if shown < 0.0 else shown) + 1.0, left - 1.0
        if shown > RETURNS and found < least:
            least = found
        if shown == SHOWN and CLOSE * least > candidate:  # a stray reading alone showed it
            candidate, shown, least, left = least, 1.0, math.inf, SEARCH
        elif shown == SHOWN:
            smallest, left = candidate, 0.0
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


def follow_sensor(
    sensor: Sensor, step: float, dt: float, quantum: float, memory: float, blur: float
) -> Sensor:
    """Return the sensor one sample further: the reading moved by `step` [rad] in `dt` [s].

    Parameters
    ----------
    quantum : to reckon with from now on [rad].
    memory : samples over which the scatter is averaged.
    blur : no edge is known better than this part of the quantum.

    Notes
    -----
    The mean of 3 T'^2 + 8 T T', T being a third difference and T' the one before, is 11 T^2 where
    T lasts, -60 sigma^2 for white noise, and not above 0 for the readings of any constant speed,
    however it beats with the sampling (a larger share than 3 would not have that). What the noise
    and the quantum may add by chance is taken off.
    """
    used, noise, scatter, residual, last, before, change, since, bend, lasting, pace = sensor
    square = quantum * quantum
    if before > 0.0:
        third = (step * before - last * dt) / (dt + before) - residual
        residual += third
        if bend == math.inf:
            bend, lasting, pace = 0.0, -square, pace if pace > 0.0 else dt
        else:
            power = 0.2 * third * third
            most = OUTLIER * (scatter + square)
            scatter += ((power if power < most else most) - scatter) / memory
            power = LASTING * bend * (3.0 * bend + 8.0 * third) - square / 12.0 - noise
            lasting += ((power if power < most else most) - lasting) / memory
            pace += (dt - pace) / memory
            bend = third
    if noise < scatter - square:  # more than any quantisation makes: it is noise
        noise = scatter - square
    elif quantum != used:
        noise = blur * blur * square
    if step == 0.0:
        return (
            quantum,
            noise,
            scatter,
            residual,
            step,
            dt,
            change,
            since + dt,
            bend,
            lasting,
            pace,
        )
    return quantum, noise, scatter, residual, step, dt, abs(step), 0.0, bend, lasting, pace


def vibration(sensor: Sensor) -> float:
    """Return the density of white jerk [(rad/s^3)^2 s] that makes the third differences that last.

    Within a sample it adds their square to the variance of the predicted angle: so far off is what
    is extrapolated with an acceleration. 0: there is nothing but noise.
    """
    _, _, _, _, _, _, _, _, _, lasting, pace = sensor
    if lasting <= 0.0:
        return 0.0
    square = pace * pace
    return 20.0 * lasting / (square * square * pace)


def follow_noise(
    noise: float, excess: float, scatter: float, quantum: float, memory: float, blur: float
) -> float:
    """Return the noise [rad^2] made likelier.

    Twofold in one sample at most; never above the scatter, which is no motion, and never below the
    `blur`.

    Parameters
    ----------
    excess : score of the innovation variance, times the noise [rad^2].
    """
    noise += noise * (excess / memory if excess < memory else 1.0)
    if noise > scatter:
        noise = scatter
    least = blur * blur * quantum * quantum
    return noise if noise > least else least
