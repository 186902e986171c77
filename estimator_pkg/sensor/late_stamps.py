# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Stamps that lie: a sample that came as evenly as the others, and was stamped late.

What a wrong stamp does to an innovation is derived in docs/stamps_and_quantisation.md.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.record import record

STAMP_TOLERANCE = 0.1  # a sample time this part off the mean may be stamped wrongly
# An innovation is not noise if its square is this many times the recent power, and as many times
# the square that the right sample time leaves.
INNOVATION_RATIO = 16.0
SAMPLE_TIME_MEMORY = 32.0  # samples over which the sample time is averaged
LONGEST_AVERAGED = 2.0  # mean sample times: a longer one is a hole, and is averaged as this
WHOLE_TOLERANCE = 0.2  # mean sample times off a whole number: samples may have been lost ...
LOST_SAMPLES_RATIO = 144.0  # ... unless the square is this many times that of the right sample time


@record
class Timing:
    """How evenly the samples come."""

    mean_dt: float  # mean sample time [s]
    taken_dt: float  # the last sample was taken in with it [s]; 0: with that between the stamps
    lateness: float  # by how much the stamp of the last sample was late [s]
    # the core before this sample, where its time is uneven
    before: observer.Core  # type: ignore[name-defined]  # noqa: F821
    # the core if the last sample was not late, while that is open
    other: observer.Core  # type: ignore[name-defined]  # noqa: F821


def follow_sample_time(stamps: Timing, dt: float) -> None:
    """Follow the sample time, with a sample whose stamp is believed, `dt` [s] after the last."""
    stamps.taken_dt = stamps.lateness = 0.0
    if stamps.mean_dt == 0.0:
        stamps.mean_dt = dt
    else:
        longest = LONGEST_AVERAGED * stamps.mean_dt
        stamps.mean_dt += ((dt if dt < longest else longest) - stamps.mean_dt) / SAMPLE_TIME_MEMORY


def is_uneven(stamps: Timing, dt: float) -> bool:
    """Return True if the stamp of this sample, or that of the one before, is at an odd time."""
    return stamps.taken_dt != 0.0 or abs(dt - stamps.mean_dt) > STAMP_TOLERANCE * stamps.mean_dt


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
    if stamps.lateness == 0.0:
        if abs(odd) <= STAMP_TOLERANCE * pace or not INNOVATION_RATIO * power < least < math.inf:
            follow_sample_time(stamps, dt)
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
        pace if odd * stamps.lateness < 0.0 and abs(odd) > STAMP_TOLERANCE * pace else 0.0,
        dt + stamps.lateness,
    ):
        if trial > 0.0:
            observer.prepare(times, design, trial)
            tried.take(stamps.before)
            left = observer.correct(tried, times, design, measurement)
            if left * left < least:
                core.take(tried)
                innovation, least, taken = left, left * left, trial
    if taken == 0.0:
        follow_sample_time(stamps, dt)
        return innovation, dt
    late = stamps.lateness + (dt - taken)
    stamps.lateness = late if abs(late) > STAMP_TOLERANCE * pace else 0.0
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
    lost = paces > 1.5 and abs(paces - math.floor(paces + 0.5)) < WHOLE_TOLERANCE
    if left * left * (LOST_SAMPLES_RATIO if lost else INNOVATION_RATIO) < innovation * innovation:
        stamps.taken_dt, stamps.lateness = pace, dt - pace
        stamps.other.take(core)
        core.take(tried)
        return left, pace
    follow_sample_time(stamps, dt)
    return innovation, dt
