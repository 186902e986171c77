# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The statuses of joints by the steady clock, which runs while simulated time is paused."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import INITIALISING, LOST, MISCONFIGURED, TRACKING, VALID
from estimator_pkg.nodes.diagnostics import dropped_for
from estimator_pkg.streams.contract import Stream

Status = tuple[int, str]  # status, and why
NEW: Status = (INITIALISING, '')
TURNS = 10  # looks in which each joint has its turn once


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
    began : when the first sample of each joint was used, by `monotonic` [s].
    silent : joints whose samples ended, and since when.
    returned : joints that are back, and the length of their outage [s]; emptied by its reader.
    due : joints whose turn it was at the last look: what takes long is done once in `TURNS` looks.
    """

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self.statuses: dict[str, Status] = {}
        self.used: dict[str, tuple[int, float, int]] = {}
        self.began: dict[str, float] = {}
        self.silent: dict[str, float] = {}
        self.returned: dict[str, float] = {}
        self._alive: set[str] = set()  # joints that are not lost
        self._turn = 0
        self.due: list[str] = []

    def look(self, now: float, every: bool) -> dict[str, tuple[Status, Status]]:
        """Return the joints whose status changed, with the statuses before and now.

        A lost joint stays lost until a sample arrives: only the others are looked at, unless
        `every` joint is.
        """
        bank, statuses = self._stream.bank, self.statuses
        joints, touched = bank.joints, bank.changed_joints()
        names = joints if every or len(joints) != len(statuses) else self._alive.union(touched)
        self._turn = (self._turn + 1) % TURNS
        self.due = list(joints)[self._turn :: TURNS]
        changed = {}
        for name in joints if len(names) == len(joints) else sorted(names):
            before = statuses.get(name)
            status = self.judge(name, joints[name], now, before if name not in self.due else None)
            if status != before:
                changed[name] = before or NEW, status
                (self._alive.discard if status[0] == LOST else self._alive.add)(name)
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
            if name in self.silent:
                self.returned[name] = now - self.silent.pop(name)
            since, count = now, received
            self.used[name] = (used, now, received)
            self.began.setdefault(name, now)
        if now - since > joint.silence:
            reason = self._stream.why_silent(name)
            if not reason and received > count:
                reason = dropped_for(joint.verdict)
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

    def lost(self, name: str) -> bool:
        """Return True if a joint was lost at the last look."""
        return self.statuses.get(name, NEW)[0] == LOST

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
        for kept in (self.used, self.statuses, self.began, self.silent):
            for name in names:
                kept.pop(name, None)
        self._alive.difference_update(names)

    def new(self) -> list[str]:
        """Return the joints that began when the silent ones had ended, perhaps renamed."""
        ended = max(self.silent.values())
        older = max(self.began[name] for name in self.silent)
        return [name for name, when in self.began.items() if when >= ended and when > older]

    def names_of(self, kept: Iterable[str]) -> Iterator[str]:
        """Return the names of the messages that belong to joints of the bank."""
        return (joint for name in kept for joint in self._stream.names_of(name))
