# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The stamps of one joint: their order, their gaps, the mean sample time.

Stamps stay int64 nanoseconds until two are subtracted.
"""

from __future__ import annotations

from estimator_pkg.record import record
from estimator_pkg.sensor.guard import (
    AFTER_CLOCK_JUMP,
    AFTER_GAP,
    AFTER_OUTAGE,
    AFTER_STRAY_STAMP,
    DUPLICATE,
    FIRST_SAMPLE,
    LATE_IN_A_ROW,
    LATE_STAMP,
    LONGEST_FIRST,
    SLOW_STREAM,
    USED_SAMPLE,
    Limits,
)

RATE_WEIGHT = 0.02  # weight of the newest sample time in the mean


@record
class Clock:
    """The stamps of one joint."""

    running: bool  # True after the first sample
    last_ns: int  # the last stamp
    before_ns: int  # the stamp before it, after a gap or an implausible first sample time; else 0
    late_in_a_row: int  # late stamps in a row
    dt_ns: int  # between the last two stamps
    dt: float  # the time that the observer took for it [s], see `sensor.sample_time`
    mean_dt: float  # the mean sample time [s]; 0: not known yet


def judge_stamp(clock: Clock, limits: Limits, stamp_ns: int) -> int:
    """Return the verdict on a stamp."""
    if not clock.running:
        return FIRST_SAMPLE
    ahead = stamp_ns - clock.last_ns
    if 0 < ahead <= limits.gap_ns:
        return USED_SAMPLE
    mean_dt = clock.mean_dt
    slow_ns = int(1e9 * (SLOW_STREAM * mean_dt if mean_dt > 0.0 else LONGEST_FIRST))
    if ahead > 0:
        if ahead <= slow_ns:
            return USED_SAMPLE
        return AFTER_OUTAGE if ahead > limits.timeout_ns else AFTER_GAP
    if ahead == 0:
        return DUPLICATE
    since = stamp_ns - clock.before_ns
    if clock.before_ns != 0 and since > 0 and (since <= limits.gap_ns or since <= slow_ns):
        return AFTER_STRAY_STAMP
    if ahead < -limits.reorder_ns or clock.late_in_a_row + 1 >= LATE_IN_A_ROW:
        return AFTER_CLOCK_JUMP
    return LATE_STAMP


def follow_outage(clock: Clock, stamp_ns: int) -> None:
    """Follow the sample time over a gap or an outage before the sample at `stamp_ns`.

    One hole, or one stamp from the far future, does not show the rate; two in a row mean that it
    fell.
    """
    if clock.before_ns != 0:
        shorter = min(stamp_ns - clock.last_ns, clock.last_ns - clock.before_ns) * 1e-9
        if shorter > clock.mean_dt:
            clock.mean_dt = shorter
    clock.before_ns = clock.last_ns
