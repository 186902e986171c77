"""The sensor as its readings show it: the quantum, and the noise above it.

The noise is seen in the change of the residual of linear interpolation between every second
reading, which is a third difference divided by the true sample times: position, speed and
acceleration are gone from it. Where one such difference has the sign of the one before, it is no
noise, which alternates, but a vibration of a few samples' period. The quantum is the smallest step
of the reading, or of the steps.
"""

from __future__ import annotations

import math

SURPRISE = 25.0   # a square counts at most so many times what is expected: 5 sigma
LASTING = 4.0 / 11.0  # third differences are twice the changes of the residual; 3 + 8, see below
ROUNDING = 1e-6   # of the reading: smaller steps are a float32's last digit
RESIDUE = 1e-3    # of the quantum: a change by less is rounding residue, and no motion
FINEST = 1e-10    # [rad or m] no sensor resolves less (36 bits a turn; an atom's diameter)
JUMP = 1e3        # times the range of all readings before: those before were residue
SEEN = 2.0        # a smaller step than the given quantum is believed when it came twice
MANY = 8.0        # steps that show the quantum, before it is thought to be larger than given
FINER = 0.75      # the quantum is too large if steps below this part of it are seen
COARSER = 1.5     # and too small if none below this many were

CLOSE = 0.9       # a step above this part of the quantum is one, but for its last digits,
DIGITS = 0.01     # which are below this part

AGREES, TOO_LARGE, TOO_SMALL = 0, 1, 2

# (quantum in use [rad]; noise: variance of the edges, beside the quantum's own [rad^2]; scatter:
# mean square of third differences over 20 [rad^2]; residual, step [rad] and dt [s] of the sample
# before, dt 0: none; size of the last change of the reading [rad], at least the quantum, and time
# since it [s]; change of the residual one sample before [rad], inf: none; square of the third
# differences that last [rad^2], negative where they alternate; mean dt [s])
Sensor = tuple[float, float, float, float, float, float, float, float, float, float, float]
# (smallest step seen [rad]; smallest step of the steps [rad]; how many showed the quantum; steps of
# either kind that were finer than the given quantum; the last step [rad], where it was more than
# `JUMP` times the range of all readings before, else 0)
Steps = tuple[float, float, float, float, float]

FIRST_STEPS: Steps = (math.inf, math.inf, 0.0, 0.0, 0.0)


def begin_sensor(quantum: float, blur: float, given: float) -> Sensor:
    """Before anything was seen; `given`: the quantum in use [rad], or 0 where that is not known.

    `blur`: see `follow_sensor`.
    """
    return (quantum, blur * blur * quantum * quantum, 0.0, 0.0, 0.0, 0.0, given, 0.0,
            math.inf, 0.0, 0.0)


def first_step(quantum: float, blur: float, step: float, dt: float) -> Sensor:
    """Return the sensor as after the first `step` [rad], in a sample of `dt` [s]."""
    return (quantum, blur * blur * quantum * quantum, 0.0, 0.0, step, dt, abs(step), 0.0,
            math.inf, 0.0, 0.0)


def follow_steps(steps: Steps, step: float, last: float, since: float, size: float,
                 quantum: float) -> Steps:
    """After a reading that moved by `step` [rad], where the last that moved did so by +-`last`.

    Parameters
    ----------
    since : time between that and the last reading before this one [s]. A step that comes after
        unchanged readings shows the quantum, for a shaft that skipped a count would not rest.
    size : of the two readings [rad]: of their last digits nothing is learnt.
    quantum : as given [rad]; 0: not known.
    """
    smallest, finest, several, finer, _ = steps
    found = abs(step)
    grain = max(ROUNDING * size, RESIDUE * min(smallest, finest, found))
    if grain < found < smallest:
        smallest = found
    if since > 0.0 and several < MANY:
        several += 1.0
    if last > 0.0:
        bend = abs(found - last)
        if bend > grain:
            if several < MANY:
                several += 1.0
            if bend < finest:
                finest = bend
            if bend < found:
                found = bend
    if grain < found < FINER * quantum and finer < SEEN:
        finer += 1.0
    return (smallest, finest, several, finer, 0.0)


def tells_quantum(steps: Steps, step: float, last: float, quantum: float) -> bool:
    """False if a reading that moved by `step` [rad] cannot change what is known of the quantum.

    Most cannot: enough steps were seen, and neither this one nor its difference from the `last` is
    smaller than the quantum in use.
    """
    if steps[2] < MANY:
        return True
    step = abs(step)
    least = CLOSE * quantum
    return step < least or DIGITS * quantum < abs(step - last) < least


def quantum_of(steps: Steps, given: float) -> float:
    """The quantum to reckon with [rad]; 0: none is known yet."""
    smallest, finest = steps[0], steps[1]
    seen = smallest if smallest < finest else finest
    if given > 0.0:
        finer = steps[3] >= SEEN and seen < given
        coarser = steps[2] >= MANY and steps[3] == 0.0 and seen > COARSER * given
        return seen if finer or coarser else given
    return seen if seen < math.inf else 0.0


def agreement(steps: Steps, given: float) -> int:
    """`AGREES`, `TOO_LARGE` or `TOO_SMALL`: the given quantum [rad] beside the steps seen."""
    if given <= 0.0:
        return AGREES
    if steps[3] >= SEEN:
        return TOO_LARGE
    if steps[2] >= MANY and steps[3] == 0.0 and min(steps[0], steps[1]) > COARSER * given:
        return TOO_SMALL
    return AGREES


def follow_sensor(sensor: Sensor, step: float, dt: float, quantum: float, memory: float,
                  blur: float) -> Sensor:
    """One sample further: it moved by `step` [rad] in `dt` [s].

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
            bend, lasting, pace = 0.0, -square, dt
        else:
            power = 0.2 * third * third
            most = SURPRISE * (scatter + square)
            scatter += ((power if power < most else most) - scatter) / memory
            power = LASTING * bend * (3.0 * bend + 8.0 * third) - square / 12.0 - noise
            lasting += ((power if power < most else most) - lasting) / memory
            pace += (dt - pace) / memory
            bend = third
    if noise < scatter - square:   # more than any quantisation makes: it is noise
        noise = scatter - square
    elif quantum != used:
        noise = blur * blur * square
    if step == 0.0:
        return (quantum, noise, scatter, residual, step, dt, change, since + dt, bend,
                lasting, pace)
    change = abs(step)
    return (quantum, noise, scatter, residual, step, dt,
            change if change > quantum else quantum, 0.0, bend, lasting,
            pace)


def vibration(sensor: Sensor) -> float:
    """The density of white jerk [(rad/s^3)^2 s] that makes the third differences that last.

    Within a sample it adds their square to the variance of the predicted angle: so far off is what
    is extrapolated with an acceleration. 0: there is nothing but noise.
    """
    lasting, pace = sensor[9], sensor[10]
    if lasting <= 0.0:
        return 0.0
    square = pace * pace
    return 20.0 * lasting / (square * square * pace)


def follow_noise(noise: float, excess: float, scatter: float, quantum: float, memory: float,
                 blur: float) -> float:
    """The noise made likelier: `excess` is the score of the innovation's variance, times noise.

    Twofold in one sample at most; never above the scatter, which is no motion, and never below the
    `blur`.
    """
    noise += noise * (excess / memory if excess < memory else 1.0)
    if noise > scatter:
        noise = scatter
    least = blur * blur * quantum * quantum
    return noise if noise > least else least
