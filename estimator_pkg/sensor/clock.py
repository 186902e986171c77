# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The clock of one joint: the sample time, and samples that waited in a queue.

Stamps stay int64 nanoseconds until two are subtracted.

A receiver that pauses stamps the samples of the pause when it goes on, some 0.1 ms apart. Each of
them moved as in a sample time, so that its stamp shows a speed a hundred times too large. Where
sampling is truly irregular, some samples come as soon after another, and moved as little. So the
stamps are believed where they explain the readings better than the mean sample time does, the more
readily the more often they did before (docs/stamps_and_quantisation.md).
"""

from __future__ import annotations

from typing import Any

from estimator_pkg.circle import wrap
from estimator_pkg.estimate import Estimate
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
QUEUED = 0.1  # mean sample times: a sample that comes sooner may have waited in a queue
QUEUE_ODDS = 16.0  # times that its stamp may explain its reading better if all before it had waited
VOTES = 16.0  # samples over which the evidence is averaged
QUEUE_EVIDENCE = 0.25  # at a start
IN_BURSTS = 0.5  # evidence that the status reports


@record
class Clock:
    """The stamps of one joint."""

    running: bool  # True after the first sample
    last_ns: int  # the last stamp
    before_ns: int  # the stamp before it, after a gap or an implausible first sample time; else 0
    late_in_a_row: int  # late stamps in a row
    dt_ns: int  # the last sample time
    mean_dt: float  # the mean sample time [s]; 0: not known yet
    queue: float  # evidence that samples which come at once waited in a queue, from 0 to 1


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


def was_queued(
    observer: Any, track: Any, design: Any, measurement: float, passed: float, period: float
) -> bool:
    """Return True if the reading moved as in a mean sample time, and note what it shows.

    Parameters
    ----------
    measurement : the newest reading [rad]. passed : time between its stamp and the last [s].
    period : wrap period [rad]; 0: none.
    """
    clock, reading = track.clock, track.reading
    if measurement == reading or observer.lateness(track.state) != 0.0:
        return False
    before = Estimate()
    observer.estimate(observer, before, track.state, track.coefficients, design, reading, 0.0)
    moved = wrap(measurement - reading, period)
    at_stamps = abs(moved - before.velocity * passed)
    evenly = abs(moved - before.velocity * clock.mean_dt)
    waited = evenly <= QUEUE_ODDS * clock.queue * clock.queue * at_stamps
    vote = 1.0 if evenly < at_stamps else 0.0
    clock.queue += (vote - clock.queue) / VOTES
    return waited


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


def note_on_queue(queue: float) -> str:
    """Return a note for the status on samples that wait in a queue; '' if they do not."""
    if queue <= IN_BURSTS:
        return ''
    return (
        'stamps come in bursts: samples that waited in a queue are taken at the mean '
        'sample time (stamp them where they are measured, or see stamp_repair)'
    )
