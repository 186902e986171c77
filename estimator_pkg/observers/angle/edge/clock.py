# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Late stamps, as the edge-aware observer finds them.

What a late stamp does to an innovation is derived in docs/stamps_and_quantisation.md. A sample time
is odd if it differs from the mean by far more than sample times usually do. If the mean sample time
explains the reading much better, the stamp is wrong: the sample is taken in with the mean sample
time, and the lateness is remembered until the stamps have caught up.

A sensor that has a clock of its own is read too early now and then: the reading repeats while the
shaft moves on, and such a reading is none. The next one shows whether the sensor only skipped one
(it moved by all of the way), or goes by another clock (it moved by a sample less).
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.constants import FORGOTTEN, MEMORY, SIGMAS
from estimator_pkg.observers.angle.edge.covariance import Covariance
from estimator_pkg.observers.angle.edge.sensor import Sensor
from estimator_pkg.observers.contract import TRACKING

UNEVEN = 0.1  # of the mean sample time: what differs by less is never odd
ODD = 4.0  # mean deviations: a sample time that differs by more is odd
LIE = 0.25  # of an innovation: a mean sample time that leaves less shows a wrong stamp
EVEN = 0.5  # mean deviation: with a larger one no sample time is known to be the usual one
STOPS = 4.0  # samples: a shaft that is about to stop within them may have stopped
SEEN = 0.25  # what one repeat adds to the evidence of another clock, from 0 to 1
BELIEVED = 0.3  # evidence above this is believed: two repeats

# (by how much the last stamp was late [s]; mean deviation of the sample times, over their mean;
# time since the reading repeats [s], 0: it does not; the longest such time after which the shaft
# had moved on [s]; evidence that the sensor has another clock, 0 to 1; 1 where the last stamp was
# even later than the one before, else 0)
Clock = tuple[float, float, float, float, float, float]

UNKNOWN: Clock = (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)  # a start has to show that its stream is even


def repeats(state: tuple, dt: float) -> bool:
    """Return True if an unchanged reading is an old one, at a speed of `REPEATS` in a sample.

    One is held so at first, and as many as twice the longest such pause after which the shaft had
    moved on.
    """
    (_, v, a, _), p, _, sensor, _, _, (status, _, _), _, _, clock, _ = state
    _, _, _, p11, _, _ = p
    _, _, _, _, _, _, _, _, _, _, pace = sensor
    _, _, held, longest, _, _ = clock
    way, held = abs(v) * dt, held + dt
    return (
        status == TRACKING
        and way * way > SIGMAS * SIGMAS * p11 * dt * dt
        and abs(v) > STOPS * abs(a) * dt
        and held <= 2.0 * longest + 1.5 * dt
        and held <= MEMORY * pace
    )


def waiting(clock: Clock, dt: float) -> Clock:
    """Return the clock after a reading that repeated."""
    late, uneven, held, longest, evidence, grew = clock
    return (late, uneven, held + dt, longest, evidence, grew)


def resumed(clock: Clock, change: float, passed: float, pace: float, v: float) -> Clock:
    """Return the clock after a reading that is believed, and moved by `change` [rad].

    Parameters
    ----------
    passed : time since the last one that was [s].
    """
    late, uneven, held, longest, evidence, grew = clock
    evidence -= 1.0 / FORGOTTEN
    if held > 0.0:
        short = (v * passed - change) / (v * pace)  # of the way [samples]
        if change != 0.0 and -1.5 < short < 1.5:  # the shaft had moved on
            longest = held if held > longest else longest
            evidence += SEEN if short > 0.5 else 0.0
    evidence = 0.0 if evidence < 0.0 else 1.0 if evidence > 1.0 else evidence
    return (late, uneven, 0.0, longest, evidence, grew)


def elapsed(
    clock: Clock, dt: float, pace: float, moved: float, motion: tuple, p: Covariance, sensor: Sensor
) -> tuple[float, Clock]:
    """Return the time that passed between two readings [s], and the clock.

    Parameters
    ----------
    dt, pace : sample time by the stamps, and the mean one [s].
    moved : distance of the reading from the last estimate [rad].
    motion, p : estimate before this reading, and its covariance.
    """
    late, uneven, held, longest, evidence, grew = clock
    if pace <= 0.0:
        return dt, clock
    odd, taken, grows = dt - pace, dt, 0.0
    limit = (ODD * uneven if ODD * uneven > UNEVEN else UNEVEN) * pace
    if odd > limit or -odd > limit or late != 0.0:
        # an innovation that is larger is no noise
        quantum, noise, _, _, _, _, _, _, _, _, _ = sensor
        _, v, a, _ = motion
        p00, p01, _, p11, _, _ = p
        doubtful = quantum + SIGMAS * math.sqrt(p00 + noise + dt * (2.0 * p01 + dt * p11))
        right = dt + late
        least = abs(moved - (v + 0.5 * a * dt) * dt)
        after = abs(moved - (v + 0.5 * a * right) * right)
        evenly = abs(moved - (v + 0.5 * a * pace) * pace)
        lies = evenly < LIE * least
        if late == 0.0:
            if lies and least > doubtful and uneven < EVEN:
                taken, late = pace, odd
        elif abs(late + odd) < limit and after < doubtful:  # the stamps have caught up
            taken, late = right, 0.0
        elif not (grew > 0.0 and late + odd > late > 0.0) and (
            lies or (evenly < doubtful and abs(odd) > 0.5 * limit and abs(late + odd) < abs(late))
        ):
            grows = 1.0 if late + odd > late > 0.0 else 0.0
            taken, late = pace, late + odd  # late still, mostly less
        else:  # they have caught up, and samples were lost; or the motion did change
            taken, late = right if after < least and right > 0.0 else dt, 0.0
        if late > MEMORY * pace or -late > MEMORY * pace:  # no stamp: the mean sample time is wrong
            return dt, UNKNOWN
        odd = taken - pace
    off = abs(odd) / pace
    uneven += ((off if off < 1.0 else 1.0) - uneven) / MEMORY
    if ODD * uneven < UNEVEN:  # even enough for `elapsed` to be left out, unless it is late
        uneven = 0.0 if late == 0.0 else UNEVEN / ODD
    return taken, (late, uneven, held, longest, evidence, grows)
