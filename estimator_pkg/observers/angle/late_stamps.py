# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Stamps that lie: a sample that came as evenly as the others, and was stamped late.

What a wrong stamp does to an innovation is derived in docs/stamps_and_quantisation.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable

UNEVEN = 0.1  # a sample time this part off the mean may be stamped wrongly
# An innovation is not noise if its square is BEYOND times the recent power, and BEYOND times the
# square that the right sample time leaves.
BEYOND = 16.0
PACES = 32.0  # samples over which the sample time is averaged
HOLE = 2.0  # mean sample times: a longer one is a hole, and is averaged as this
WHOLE = 0.2  # mean sample times: this close to a whole number, samples may have been lost ...
SURE = 144.0  # ... unless the square is SURE times what the right sample time leaves


def begin_clock(inner: tuple) -> tuple:
    """Return the clock at a start; `inner` is the core's state, of which it keeps a second one.

    Mean sample time [s]; the one [s] that the last sample was taken in with instead of that between
    the stamps (0: that was taken); by how much its stamp was late [s]; the core's state if it was
    not late, while that is open.
    """
    return (0.0, 0.0, 0.0, inner)


def follow_clock(clock: tuple, dt: float) -> tuple:
    """Return the clock after a sample whose stamp is believed, `dt` [s] after the last."""
    pace, _, _, other = clock
    if pace == 0.0:
        return (dt, 0.0, 0.0, other)
    return (pace + ((dt if dt < HOLE * pace else HOLE * pace) - pace) / PACES, 0.0, 0.0, other)


def make_retake(
    prepare: Callable[[tuple, float], tuple], correct: Callable[[tuple, tuple, float], tuple]
) -> Callable[..., tuple]:
    """Return the function that retakes a sample whose stamp, or the one before, is at an odd time.

    Parameters
    ----------
    prepare : (design, dt) -> (coefficients of the core, dt [s]).
    correct : of the core; see `AngleCore`.
    """

    def retake(
        clock: tuple,
        power: float,
        before: tuple,
        design: tuple,
        measurement: float,
        after: tuple,
        innovation: float,
        coefficients: tuple,
    ) -> tuple:
        """Return (core's state, innovation [rad], coefficients, clock) with the sample time that
        explains the reading.

        Parameters
        ----------
        power : recent one of the innovations [rad^2].
        before : the core's state before this sample.
        after, innovation, coefficients : as the stamps have it.
        """
        pace, _, late, other = clock
        of_core, dt = coefficients
        odd = dt - pace
        least = innovation * innovation
        if late == 0.0:
            if abs(odd) <= UNEVEN * pace or not BEYOND * power < least < math.inf:
                return after, innovation, coefficients, follow_clock(clock, dt)
            evenly = prepare(design, pace)
            of_core, _ = evenly
            state, left = correct(before, of_core, measurement)
            paces = dt / pace
            lost = paces > 1.5 and abs(paces - math.floor(paces + 0.5)) < WHOLE
            if left * left * (SURE if lost else BEYOND) < least:
                return state, left, evenly, (pace, pace, odd, after)
            return after, innovation, coefficients, follow_clock(clock, dt)
        taken = 0.0
        state, left = correct(other, of_core, measurement)
        if left * left < least:  # it was not late: the motion did change
            after, innovation, least = state, left, left * left
        # late still, but less; or the first again that is stamped rightly
        for trial in (pace if odd * late < 0.0 and abs(odd) > UNEVEN * pace else 0.0, dt + late):
            if trial > 0.0:
                tried = prepare(design, trial)
                of_core, _ = tried
                state, left = correct(before, of_core, measurement)
                if left * left < least:
                    after, innovation, least = state, left, left * left
                    coefficients, taken = tried, trial
        if taken == 0.0:
            return after, innovation, coefficients, follow_clock(clock, dt)
        late += dt - taken
        return (
            after,
            innovation,
            coefficients,
            (pace, taken, late if abs(late) > UNEVEN * pace else 0.0, after),
        )

    return retake
