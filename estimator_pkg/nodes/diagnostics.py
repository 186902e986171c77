# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The status of a joint as an entry of diagnostics: level, message, values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import (
    COASTING,
    INITIALISING,
    LOST,
    MISCONFIGURED,
    NOT_OBSERVABLE,
    STATUS_NAMES,
    TRACKING,
)
from estimator_pkg.messages.diagnostics import ERROR, OK, WARN, Status, packed
from estimator_pkg.sensor.guard import (
    DROP_REASONS,
    DUPLICATE,
    LATE_STAMP,
    NON_FINITE,
    REPEATED_READING,
    VERDICTS,
    ZERO_STAMP,
)

_LEVELS = {
    INITIALISING: WARN,
    TRACKING: OK,
    COASTING: WARN,
    LOST: ERROR,
    NOT_OBSERVABLE: WARN,
    MISCONFIGURED: ERROR,
}
_REASONS = {
    INITIALISING: 'not settled yet after the start, a reset or a loss of lock',
    COASTING: 'predicted after a gap, an outlier or a loss of lock',
    NOT_OBSERVABLE: 'the signals do not determine the state',
}
EVENTS = VERDICTS[2:DUPLICATE]
_DROPPED_FOR = {
    DUPLICATE: 'their stamps repeat',
    LATE_STAMP: 'their stamps are late',
    NON_FINITE: 'their numbers are not finite, or too large for any joint',
    ZERO_STAMP: 'they have no time stamp',
    REPEATED_READING: 'they repeat the previous reading',
}


def dropped_for(verdict: int) -> str:
    """Return why samples are dropped, as text; '' for other verdicts."""
    why = _DROPPED_FOR.get(verdict, '')
    return why and f'received samples are dropped: {why}'


def group_delay(joint: Joint) -> float:
    """Return the velocity's delay at low frequency and the measured rate [s]; nan if unknown."""
    if joint.mean_dt <= 0.0 or joint.mean_dt > joint.longest_dt:
        return math.nan
    return joint.group_delay(joint.mean_dt)


def counters(joints: Mapping[str, Joint]) -> dict[str, int]:
    """Return the samples of these joints (received = used + all dropped kinds), and the events
    before used samples.
    """
    total = [sum(column) for column in zip(*(joint.counts for joint in joints.values()))]
    total = total or [0] * len(VERDICTS)
    values = {'received': sum(total), 'used': sum(total[:DUPLICATE])}
    values.update(
        {f'dropped.{kind}': count for kind, count in zip(DROP_REASONS, total[DUPLICATE:])}
    )
    values.update({f'events.{kind}': count for kind, count in zip(EVENTS, total[2:DUPLICATE])})
    return values


def joint_status(name: str, joint: Joint, status: int, why: str, more: Mapping[str, Any]) -> Status:
    """Return the entry of one joint: its message is the status and the reason.

    Parameters
    ----------
    more : values in addition to those of every joint.
    """
    why = why or _REASONS.get(status, '')
    said = STATUS_NAMES[status]
    values = {
        'status': said,
        'why': why,
        'group_delay_s': group_delay(joint),
        'rate_hz': 1.0 / joint.mean_dt if joint.mean_dt > 0.0 else math.nan,
        **counters({name: joint}),
        'resets': joint.reset_count,
        **more,
    }
    message = f'{said}: {why}' if why else said
    level = max(_LEVELS[status], WARN if joint.lasting_faults() else OK)
    return Status(level, name, name, message, packed(values))
