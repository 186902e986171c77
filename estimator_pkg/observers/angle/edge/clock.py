# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Late stamps, as the edge-aware observer finds them.

What a late stamp does to an innovation is derived in docs/stamps_and_quantisation.md. A sample time
is odd if it differs from the mean by far more than sample times usually do. If the mean sample time
explains the reading much better, the stamp is wrong: the sample is taken in with the mean sample
time, and the lateness is remembered until the stamps have caught up.
"""

from __future__ import annotations

import math

UNEVEN = 0.1  # of the mean sample time: what differs by less is never odd
ODD = 4.0  # mean deviations: a sample time that differs by more is odd
LIE = 0.25  # of an innovation: a mean sample time that leaves less shows a wrong stamp
EVEN = 0.5  # mean deviation: with a larger one no sample time is known to be the usual one
SIGMAS = 3.0  # standard deviations, in addition to a quantum, that an innovation may have by chance
MEMORY = 32.0  # samples over which the deviations are averaged

# (by how much the last stamp was late [s]; mean deviation of the sample times, over their mean)
Clock = tuple[float, float]

UNKNOWN: Clock = (0.0, 1.0)  # a start has to show that its stream is even


def elapsed(
    clock: Clock,
    dt: float,
    pace: float,
    moved: float,
    v: float,
    a: float,
    p: tuple,
    quantum: float,
    noise: float,
) -> tuple[float, Clock]:
    """Return the time that passed between two readings [s], and the clock.

    Parameters
    ----------
    dt, pace : sample time by the stamps, and its mean [s].
    moved : distance of the reading from the last estimate [rad].
    v, a : estimated speed and acceleration [rad/s, rad/s^2].
    p : covariance of the estimate; see `covariance`.
    quantum, noise : of the reading; see `sensor`.
    """
    late, uneven = clock
    if pace <= 0.0:
        return dt, clock
    odd, taken = dt - pace, dt
    limit = (ODD * uneven if ODD * uneven > UNEVEN else UNEVEN) * pace
    if odd > limit or -odd > limit or late != 0.0:
        # an innovation that is larger is no noise
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
        elif lies or (evenly < doubtful and abs(odd) > 0.5 * limit and abs(late + odd) < abs(late)):
            taken, late = pace, late + odd  # late still, but less
        else:  # they have caught up, and samples were lost; or the motion did change
            taken, late = right if after < least and right > 0.0 else dt, 0.0
        odd = taken - pace
    if late > MEMORY * pace or -late > MEMORY * pace:  # no stamp: the mean sample time is wrong
        return dt, UNKNOWN
    off = abs(odd) / pace
    uneven += ((off if off < 1.0 else 1.0) - uneven) / MEMORY
    if ODD * uneven < UNEVEN:  # even enough for `elapsed` to be left out, unless it is late
        uneven = 0.0 if late == 0.0 else UNEVEN / ODD
    return taken, (late, uneven)
