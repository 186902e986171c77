# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Stamps that lie: a sample that came as evenly as the others, and was stamped late.

What a wrong stamp does to an innovation is derived in docs/stamps_and_quantisation.md.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.record import record

UNEVEN = 0.1  # a sample time this part off the mean may be stamped wrongly
# An innovation is not noise if its square is BEYOND times the recent power, and BEYOND times the
# square that the right sample time leaves.
BEYOND = 16.0
PACES = 32.0  # samples over which the sample time is averaged
HOLE = 2.0  # mean sample times: a longer one is a hole, and is averaged as this
WHOLE = 0.2  # mean sample times: this close to a whole number, samples may have been lost ...
SURE = 144.0  # ... unless the square is SURE times what the right sample time leaves


@record
class Timing:
    """How evenly the samples come."""

    mean_dt: float  # mean sample time [s]
    taken_dt: float  # the last sample was taken in with it [s]; 0: with that between the stamps
    late: float  # by how much the stamp of the last sample was late [s]
    # the core before this sample, where its time is uneven
    before: observer.Core  # type: ignore[name-defined]  # noqa: F821
    # the core if the last sample was not late, while that is open
    other: observer.Core  # type: ignore[name-defined]  # noqa: F821


def follow_pace(stamps: Timing, dt: float) -> None:
    """Follow the sample time, with a sample whose stamp is believed, `dt` [s] after the last."""
    stamps.taken_dt = stamps.late = 0.0
    if stamps.mean_dt == 0.0:
        stamps.mean_dt = dt
    else:
        longest = HOLE * stamps.mean_dt
        stamps.mean_dt += ((dt if dt < longest else longest) - stamps.mean_dt) / PACES


def is_uneven(stamps: Timing, dt: float) -> bool:
    """Return True if the stamp of this sample, or that of the one before, is at an odd time."""
    return stamps.taken_dt != 0.0 or abs(dt - stamps.mean_dt) > UNEVEN * stamps.mean_dt


def retake(
    observer: Any,
    core: Any,
    stamps: Any,
    power: float,
    coefficients: Any,
    design: Any,
    measurement: float,
    innovation: float,
) -> tuple[float, float]:
    """Take a sample again, with the sample time that explains its reading.

    Parameters
    ----------
    core : as the stamps have it, after this sample; `stamps.before` is the one before it.
    power : recent one of the innovations [rad^2].
    innovation : as the stamps have it [rad].

    Returns
    -------
    The innovation [rad], and the time that the sample took [s].
    """
    dt, pace = coefficients.dt, stamps.mean_dt
    odd = dt - pace
    least = innovation * innovation
    if stamps.late == 0.0:
        if abs(odd) <= UNEVEN * pace or not BEYOND * power < least < math.inf:
            follow_pace(stamps, dt)
            return innovation, dt
        return _take_evenly(observer, core, stamps, coefficients, design, measurement, innovation)
    tried = observer.Core()
    times = observer.Coefficients()
    tried.take(stamps.other)
    left = observer.correct(tried, coefficients, design, measurement)
    if left * left < least:  # it was not late: the motion did change
        core.take(tried)
        innovation, least = left, left * left
    taken = 0.0
    # late still, but less; or the first again that is stamped rightly
    for trial in (
        pace if odd * stamps.late < 0.0 and abs(odd) > UNEVEN * pace else 0.0,
        dt + stamps.late,
    ):
        if trial > 0.0:
            observer.prepare(times, design, trial)
            tried.take(stamps.before)
            left = observer.correct(tried, times, design, measurement)
            if left * left < least:
                core.take(tried)
                innovation, least, taken = left, left * left, trial
    if taken == 0.0:
        follow_pace(stamps, dt)
        return innovation, dt
    late = stamps.late + (dt - taken)
    stamps.late = late if abs(late) > UNEVEN * pace else 0.0
    stamps.taken_dt = taken
    stamps.other.take(core)
    return innovation, taken


def _take_evenly(
    observer: Any,
    core: Any,
    stamps: Any,
    coefficients: Any,
    design: Any,
    measurement: float,
    innovation: float,
) -> tuple[float, float]:
    """Take a sample at the mean time if that explains its reading far better; see `retake`."""
    dt, pace = coefficients.dt, stamps.mean_dt
    tried = observer.Core()
    evenly = observer.Coefficients()
    observer.prepare(evenly, design, pace)
    tried.take(stamps.before)
    left = observer.correct(tried, evenly, design, measurement)
    paces = dt / pace
    lost = paces > 1.5 and abs(paces - math.floor(paces + 0.5)) < WHOLE
    if left * left * (SURE if lost else BEYOND) < innovation * innovation:
        stamps.taken_dt, stamps.late = pace, dt - pace
        stamps.other.take(core)
        core.take(tried)
        return left, pace
    follow_pace(stamps, dt)
    return innovation, dt
