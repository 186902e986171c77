# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The statuses of joints by the steady clock, and their entries of diagnostics.

The steady clock runs while simulated time is paused.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
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
    VALID,
)
from estimator_pkg.messages.diagnostics import ERROR, OK, WARN, packed
from estimator_pkg.messages.diagnostics import Status as Entry
from estimator_pkg.sensor.guard import (
    DROP_REASONS,
    DUPLICATE,
    LATE_STAMP,
    NON_FINITE,
    REPEATED_READING,
    VERDICTS,
    ZERO_STAMP,
)
from estimator_pkg.streams.contract import Stream

Status = tuple[int, str]  # status, and why
NEW: Status = (INITIALISING, '')
TURNS = 10  # looks in which each joint has its turn once

_LEVELS_AND_REASONS = {
    INITIALISING: (WARN, 'not settled yet after the start, a reset or a loss of lock'),
    TRACKING: (OK, ''),
    COASTING: (WARN, 'predicted after a gap, an outlier or a loss of lock'),
    LOST: (ERROR, ''),
    NOT_OBSERVABLE: (WARN, 'the signals do not determine the state'),
    MISCONFIGURED: (ERROR, ''),
}
_DROPPED_FOR = {
    DUPLICATE: 'their stamps repeat',
    LATE_STAMP: 'their stamps are late',
    NON_FINITE: 'their numbers are not finite, or too large for any joint',
    ZERO_STAMP: 'they have no time stamp',
    REPEATED_READING: 'they repeat the previous reading',
}


class JointWatch:
    """Judges the joints of a bank: an observer's own status, or lost without usable samples.

    Parameters
    ----------
    stream : the node's.

    Attributes
    ----------
    statuses : of each joint at the last look.
    used : number of used samples of each joint, when it last grew by `monotonic` [s], and the
        number of received ones then.
    due : joints whose turn it was at the last look: what takes long is done once in `TURNS` looks.
    """

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self.statuses: dict[str, Status] = {}
        self.used: dict[str, tuple[int, float, int]] = {}
        self._turn = 0
        self.due: list[str] = []

    def look(self, now: float) -> dict[str, tuple[Status, Status]]:
        """Return the joints whose status changed, with the statuses before and now."""
        joints, statuses = self._stream.bank.joints, self.statuses
        self._turn = (self._turn + 1) % TURNS
        self.due = list(joints)[self._turn :: TURNS]
        due, changed = set(self.due), {}
        for name, joint in joints.items():
            before = statuses.get(name)
            status = self.judge(name, joint, now, None if name in due else before)
            if status != before:
                changed[name] = before or NEW, status
                statuses[name] = status
        return changed

    def judge(self, name: str, joint: Joint, now: float, before: Status | None) -> Status:
        """Return a joint's status; it is lost after too long without a usable sample.

        Parameters
        ----------
        before : status at the last look; while the joint tracks its text is kept. None: it is due.
        """
        status = joint.estimate()[3]
        if self._stream.always_awake(name):
            return status, joint.why()
        # a misconfigured joint uses no sample: it is lost when none arrives
        used, received = joint.received if status == MISCONFIGURED else joint.used, joint.received
        known, since, count = self.used.get(name, (-1, now, 0))
        if used != known:
            since, count = now, received
            self.used[name] = (used, now, received)
        if now - since > joint.silence:
            reason = self._stream.why_silent(name)
            dropped = _DROPPED_FOR.get(joint.verdict) if received > count else None
            if not reason and dropped:
                reason = f'received samples are dropped: {dropped}'
            return LOST, (
                f'no usable sample for {joint.silence:.3g} s' + (f'; {reason}' if reason else '')
            )
        if before and before[0] == status == TRACKING:
            return before
        return status, joint.why()

    @property
    def estimated(self) -> bool:
        """True if a joint had an estimate at the last look."""
        return any(status in VALID for status, _ in self.statuses.values())

    def silent(self, arrived: float) -> dict[str, float]:
        """Return the lost joints without any sample for their silence, and since when.

        Parameters
        ----------
        arrived : when the newest message came [s].
        """
        joints = self._stream.bank.joints
        return {
            name: since
            for name, (_, since, received) in self.used.items()
            if received == joints[name].received
            and self.statuses.get(name, NEW)[0] == LOST
            and arrived - since > joints[name].silence
        }

    def unused(self, name: str) -> int:
        """Return the number of a joint's samples since its last used one."""
        received: int = self._stream.bank.joints[name].received
        return received - self.used[name][2]

    def older(self, age: float, now: float) -> list[str]:
        """Return the joints whose last used sample is older than this [s]; named ones stay."""
        named = self._stream.bank.named
        return [
            name
            for name, (_, since, _) in self.used.items()
            if now - since > age and not named(name)
        ]

    def forget(self, names: Iterable[str]) -> None:
        """Forget joints that were removed."""
        for name in names:
            self.used.pop(name, None)
            self.statuses.pop(name, None)

    def names_of(self, kept: Iterable[str]) -> Iterator[str]:
        """Return the names of the messages that belong to joints of the bank."""
        return (joint for name in kept for joint in self._stream.names_of(name))


def counters(joints: Mapping[str, Joint]) -> dict[str, int]:
    """Return the samples of these joints (received = used + all dropped kinds), and the events
    before used samples.
    """
    total = [sum(column) for column in zip(*(joint.counts for joint in joints.values()))]
    total = total or [0] * len(VERDICTS)
    return {
        'received': sum(total),
        'used': sum(total[:DUPLICATE]),
        **{f'dropped.{kind}': count for kind, count in zip(DROP_REASONS, total[DUPLICATE:])},
        **{f'events.{kind}': count for kind, count in zip(VERDICTS[2:], total[2:DUPLICATE])},
        'resets': sum(joint.reset_count for joint in joints.values()),
    }


def entry(name: str, joint: Joint, status: int, why: str, more: Mapping[str, Any]) -> Entry:
    """Return the entry of one joint: its message is the status and the reason.

    Parameters
    ----------
    more : values in addition to those of every joint.
    """
    level, usual = _LEVELS_AND_REASONS[status]
    why, said, dt = why or usual, STATUS_NAMES[status], joint.mean_dt
    values = {
        'status': said,
        'why': why,
        'group_delay_s': joint.group_delay(dt) if 0.0 < dt <= joint.longest_dt else math.nan,
        'rate_hz': 1.0 / dt if dt > 0.0 else math.nan,
        **counters({name: joint}),
        **more,
    }
    level = max(level, WARN if joint.lasting_faults() else OK)
    return Entry(level, name, name, f'{said}: {why}' if why else said, packed(values))
