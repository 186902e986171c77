# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What the messages of a topic carry, and whether several publishers send the same joint."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from time import monotonic

from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Layout

TURNS, WITHIN = 10, 5.0  # several publishers alternate so often in this time [s]
LAYOUTS = 8  # layouts of messages that are kept


class Senders:
    """Reads the names of joints and the sequence numbers of messages.

    Messages do not name their publisher, but the sequence numbers of one publisher only grow: those
    of a joint that two publishers send go back at every turn. They also go back, once, where a
    publisher is started again.

    Parameters
    ----------
    named : the messages are JointStates; others carry one joint, ''.

    Attributes
    ----------
    several : the topic has several publishers, so that numbers are compared.
    """

    def __init__(self, named: bool) -> None:
        self._named, self.several = named, False
        self._layouts: dict[Layout, float] = {}  # and when it last came
        self._numbers: dict[str, int] = {}  # the newest of each joint
        self._turns: dict[str, deque[float]] = {}  # when it went back

    def saw(self, raw: bytes, sequence: int | None) -> None:
        """Take a message."""
        now = monotonic()
        names: Sequence[str] = ('',)
        if self._named:
            names = self._names_of(raw, now)
        if self.several and sequence:
            for name in names:
                if sequence <= self._numbers.get(name, 0):
                    self._turns.setdefault(name, deque(maxlen=TURNS)).append(now)
                self._numbers[name] = sequence
        elif self._numbers:
            self._numbers, self._turns = {}, {}

    def recent(self, since: float) -> set[str]:
        """Return the joints of the newest messages that came after this time."""
        return {
            name for layout, when in self._layouts.items() if when > since for name in layout.names
        }

    def twice(self, now: float) -> list[str]:
        """Return the joints that several publishers send."""
        return sorted(
            name
            for name, turns in self._turns.items()
            if len(turns) == TURNS and now - turns[0] < WITHIN
        )

    def _names_of(self, raw: bytes, now: float) -> Sequence[str]:
        layout = next((each for each in self._layouts if each.fits(raw)), None)
        if layout is None:
            try:
                layout = Layout(raw)
            except MalformedMessageError:
                return ()
            if len(self._layouts) == LAYOUTS:
                del self._layouts[min(self._layouts, key=self._layouts.__getitem__)]
        self._layouts[layout] = now
        return layout.names
