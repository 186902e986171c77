# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A joint of the observer `switched`: samples and events, each at its stamp.

An event takes effect at the sample nearest to its stamp, in any order of arrival: the interval
before a sample belongs to the mode that was active in it. The first sample after a reset or a new
start knows nothing of the events before it, which then follow it. Events that wait when the clock
jumps are refused.
"""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections import Counter
from collections.abc import Sequence
from operator import itemgetter
from typing import Any

from estimator_pkg.driver.bank import Received, Rows, Taken, taken
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.efforts import EFFORT_FIELD, STORED_EFFORTS, Acting
from estimator_pkg.driver.joint import Joint
from estimator_pkg.models.switched import SwitchedModel
from estimator_pkg.observers.contract import Observer
from estimator_pkg.sensor.guard import AFTER_CLOCK_JUMP, NEW_STARTS

# Results of an event
WAITING, APPLIED, LATE, PAST, OUT_OF_ORDER, EARLY, JUMPED, TOO_MANY = (
    'waiting',
    'applied',
    'late',
    'past',
    'out_of_order',
    'no_sample_yet',
    'clock_jumped',  # while it waited
    'too_many_wait',
)
REFUSED = (PAST, OUT_OF_ORDER, EARLY, JUMPED, TOO_MANY)


class SwitchedJoint(Joint):
    """A `Joint` that also takes events.

    Parameters
    ----------
    observer, gains, settings : as in `Joint`.

    Attributes
    ----------
    model : of the system. event_counts : number of events by result.
    refused : the newest event that is not used, and why, as text; '': none.
    """

    def __init__(self, observer: type[Observer], gains: Any, settings: JointSettings) -> None:
        super().__init__(observer, gains, settings)
        self.model: SwitchedModel = self.module.model
        self.size = len(self.model.indices)
        self.event_counts: Counter[str] = Counter()
        self.refused = ''
        self._waiting: list[tuple[int, tuple]] = []  # by stamp
        self._last_event_ns = -math.inf  # stamp of the newest that took effect

    def _reset_channel(self) -> None:
        stamp_ns = self.stamp_ns
        super()._reset_channel()
        channel, observer = self._channel, self.module
        channel.stamp_ns = stamp_ns  # events are compared with it
        channel.measurement, channel.known_input = self._at_rest()
        observer.start(observer, channel.track.state, channel.design, channel.measurement)

    def _at_rest(self) -> tuple[Any, Any]:
        model = self.module.model
        return [0.0] * len(model.indices), [0.0] * len(model.probe(0.0))

    def event(self, stamp_ns: int, mode: str, v: tuple[float, ...] = ()) -> str:
        """Take one event; return its result.

        Parameters
        ----------
        stamp_ns : the switching instant, int nanoseconds.
        mode, v : as the model defines them.
        """
        said = self._judged(stamp_ns)
        self.event_counts[said] += 1
        if said in REFUSED:
            self._refuse(mode, said)
        elif said == WAITING:
            insort(self._waiting, (stamp_ns, (mode, v)))
        else:
            self._last_event_ns = stamp_ns
            self._jump([(stamp_ns, (mode, v))])
        return said

    def _judged(self, stamp_ns: int) -> str:
        if not self.used:
            return EARLY
        if stamp_ns <= self._last_event_ns:
            return OUT_OF_ORDER
        behind = self.stamp_ns - stamp_ns
        if behind > self.settings.reorder_window * 1e9:
            return PAST
        if behind >= 0 and self.running:
            half = 0.5e9 * self.mean_dt
            return APPLIED if behind <= half else LATE
        if any(stamp_ns == waiting_ns for waiting_ns, _ in self._waiting):
            return OUT_OF_ORDER
        return WAITING if len(self._waiting) < STORED_EFFORTS else TOO_MANY

    def update(self, stamp_ns: int, measurement: Any, known_input: Any = ()) -> bool:
        """Take one sample, and first the events that are due by it; see `Joint`."""
        last_ns, ran = self.stamp_ns, self.running
        before = self._taken((last_ns + stamp_ns) // 2)
        if ran:
            self._jump(before)
        used, verdict = super().update(stamp_ns, measurement, known_input), self.verdict
        if not self.running:
            self._waiting[:0] = before
        elif not ran or (used and verdict in NEW_STARTS):
            self._jump(before)
        if used:
            back = (last_ns - stamp_ns) * 1e-9 > self.settings.reorder_window
            if verdict == AFTER_CLOCK_JUMP or (back and not ran):
                self._last_event_ns = -math.inf
                for _, (mode, _) in self._waiting:
                    self.event_counts[WAITING] -= 1
                    self.event_counts[JUMPED] += 1
                    self._refuse(mode, JUMPED)
                self._waiting = []
            self._jump(self._taken(stamp_ns))
        return used

    def _refuse(self, mode: str, why: str) -> None:
        self.refused = f"the event '{mode}' is not used: {why.replace('_', ' ')}"

    def reset(self) -> None:
        """Reset the observer; waiting events are removed."""
        super().reset()
        self._waiting.clear()
        self._last_event_ns = -math.inf

    def why(self) -> str:
        """Return the meaning of the status as text, or a note if Z has not converged."""
        if self.used and not self.discrete()[2]:
            return 'Z has not converged: it is predicted'
        return super().why()

    def _taken(self, until_ns: int) -> list[tuple[int, tuple]]:
        """Return the waiting events up to a stamp, which wait no more."""
        count = bisect_right(self._waiting, until_ns, key=itemgetter(0))
        taken, self._waiting = self._waiting[:count], self._waiting[count:]
        if taken:
            self._last_event_ns = taken[-1][0]
        return taken

    def _jump(self, events: Sequence[tuple[int, tuple]]) -> None:
        channel = self._channel
        for _, (mode, v) in events:
            self.module.jump(self.module, channel.track.state, channel.design, mode, v)

    def discrete(self) -> tuple[tuple[float, ...], tuple[float, ...], bool]:
        """Return (Z, its standard deviations, converged)."""
        found: tuple[tuple[float, ...], tuple[float, ...], bool]
        found = self.module.discrete(self._channel.track.state, self._channel.design)
        return found


class SwitchedBank(Received):
    """The joints of one hybrid system as one; messages contain all its outputs.

    A node or a replay calls `take` once for each message of joint states and `system.event` once
    for each switch_event, in order of arrival; an event that arrives before the samples around it
    waits for them. After `take`, `system.discrete()` returns the discrete state.

    Parameters
    ----------
    joint : the system.
    names : names of its joints in the messages, in the order of the model's outputs; the efforts
        of the first ones are the inputs.
    source : source of the efforts: EFFORT_FIELD (of joint states) or COMMAND (a separate topic).

    Raises
    ------
    UsageError : scales or delays for another number of inputs.

    Attributes
    ----------
    joints : the system, by the name of its first joint.
    """

    def __init__(
        self, joint: SwitchedJoint, names: tuple[str, ...], source: str = EFFORT_FIELD
    ) -> None:
        super().__init__()
        self.system = joint
        self.configuration: Any = None  # as in other banks; here the joint exists already
        self.names = names
        self.joints: dict[str, Joint] = {names[0]: joint}
        self.only: frozenset[str] = frozenset()
        self._inputs = len(joint.model.probe(0.0))
        settings: Any = joint.settings
        settings.check_inputs(self._inputs, 'switched')
        self._source = source
        self._acting = Acting(self._inputs, source, settings)
        self._unknown = False  # True if an input was not known at the newest sample

    @property
    def actuated(self) -> tuple[str, ...]:
        """The joints whose efforts are the inputs."""
        return self.names[: self._inputs]

    @property
    def orders(self) -> tuple[tuple[str, ...], ...]:
        """Possible names for the numbers of an effort_command without names."""
        return self.names, self.actuated

    def command(self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float]) -> None:
        """Take one effort_command."""
        for name, effort in zip(names, efforts):
            if name in self.actuated:
                self._acting.command(self.names.index(name), stamp_ns, effort)

    def why_silent(self, name: str) -> str:
        """Return why no sample can be used, if the input is the reason, else ''."""
        return self._acting.why_unknown() if self._unknown else ''

    def take(
        self,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float],
        efforts: Sequence[float],
    ) -> Taken | None:
        """Take one message; return None (and count it) if it cannot be used whole.

        Empty if they are not published. A message without one of the joints, or without the
        efforts that the model needs, is counted as mismatched.
        """
        if not self.fits(names, positions):
            return None
        needed = self._inputs > 0 and self._source == EFFORT_FIELD
        if not set(self.names).issubset(names) or (needed and len(efforts) != len(names)):
            self.mismatched += 1
            return None
        places = [names.index(name) for name in self.names]
        measurement = tuple(positions[place] for place in places)
        system: Any = self.system
        known_input = self._acting.known_input(
            system.stamp_ns,
            stamp_ns,
            [efforts[place] if needed else math.nan for place in places[: self._inputs]],
            system.settings,
        )
        self._unknown = not all(map(math.isfinite, known_input))
        if self._unknown:
            measurement = (math.nan,) * len(measurement)  # counted as such: half a sample is none
        used = system.update(stamp_ns, measurement, known_input)
        shown = [place for place, name in enumerate(names) if name in self.names]
        output = [self.names.index(names[place]) for place in shown]
        estimates = system.estimates() if used else [None] * system.size
        return taken(
            [names[place] for place in shown],
            [estimates[i] for i in output],
            [efforts[place] for place in shown] if len(efforts) == len(names) else (),
            Rows([(system, i) for i in output]),
            [positions[place] for place in shown],
        )
