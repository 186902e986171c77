# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""~/smoothed: position and velocity a moment ago, from later readings too.

A message of the measurement is answered a second time once a message comes that is `smoothing_lag`
newer, with its own stamp, names and order. See `observers.angle.smoother`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from estimator_pkg.driver.bank import TakenOfJoints
from estimator_pkg.driver.guard import DUPLICATE, USED
from estimator_pkg.driver.joint import Joint
from estimator_pkg.messages import joint_state
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.observers.angle.smoother import UNKNOWN, Smoother
from estimator_pkg.streams.contract import Answer, Output, Stream

SMOOTHED = Output('smoothed', joint_state.TYPE, on_demand=True, extra=True)
SMOOTHED_STDDEV = Output('smoothed_stddev', joint_state.TYPE, on_demand=True, extra=True)


class Waiting(NamedTuple):
    """A message that is not answered yet.

    at_ns : when its readings were taken. stamp_ns, frame_id, names, efforts : as in the message.
    positions : in the convention of the estimates. smoothers : of each joint; None: unused sample.
    """

    at_ns: int
    stamp_ns: int
    frame_id: str
    names: Sequence[str]
    efforts: Sequence[float]
    positions: Sequence[float]
    smoothers: Sequence[Smoother | None]


class Smoothing:
    """Makes ~/smoothed and ~/smoothed_stddev, while one of them is wanted.

    Parameters
    ----------
    stream : whose outputs these are. lag : [s].
    """

    def __init__(self, stream: Stream, lag: float) -> None:
        self._stream, self._lag, self._lag_ns = stream, lag, round(1e9 * lag)
        self._numbers = tuple(map(stream.outputs.index, (SMOOTHED, SMOOTHED_STDDEV)))
        self._smoothed, self._stddev = Encoder(), Encoder()
        self._waiting: deque[Waiting] = deque()
        self._of: dict[str, tuple[Joint, Smoother]] = {}

    @property
    def wanted(self) -> bool:
        """True if one of the outputs is to be made."""
        first, second = self._numbers
        return self._stream.wanted[first] or self._stream.wanted[second]

    def stop(self) -> None:
        """Forget everything: nobody wants it any more."""
        if self._of:
            self._of.clear()
            self._waiting.clear()

    def forget(self, names: Sequence[str]) -> None:
        """Forget these joints; a removed one, or one whose gains changed, starts again."""
        for name in names:
            self._of.pop(name, None)

    def __call__(
        self, at_ns: int, stamp_ns: int, frame_id: str, taken: TakenOfJoints | None
    ) -> list[Answer]:
        """Take one message; return the answers to those that are old enough now.

        Parameters
        ----------
        at_ns : when the observer takes its readings to be from.
        """
        if taken is None:
            return []
        names, estimates, efforts, joints, positions = taken
        if not any(each is not None for each in estimates):
            return []
        smoothers: list[Smoother | None] = []
        shown = []
        for k, (name, joint, estimate) in enumerate(zip(names, joints, estimates)):
            position = taken.written(k)
            shown.append(position)
            if joint is None or estimate is None:
                smoothers.append(None)
                continue
            smoother = self._smoother(name, joint)
            fresh = USED < joint.verdict < DUPLICATE
            smoother.add(at_ns, positions[k], position, fresh)
            smoothers.append(smoother)
        waiting = self._waiting
        waiting.append(Waiting(at_ns, stamp_ns, frame_id, names, efforts, shown, smoothers))
        answers = []
        while waiting and (
            at_ns - waiting[0].at_ns >= self._lag_ns or at_ns < waiting[0].at_ns  # the clock jumped
        ):
            answer = self._answer(waiting.popleft())
            if answer:
                answers.append(answer)
        return answers

    def _smoother(self, name: str, joint: Joint) -> Smoother:
        found = self._of.get(name)
        if found is None or found[0] is not joint:
            settings = joint.settings
            smoother = Smoother(
                self._lag,
                settings.wrap_period,
                getattr(joint.gains, 'quantum', 0.0),
                settings.unwrap,
            )
            found = self._of[name] = joint, smoother
        return found[1]

    def _answer(self, message: Waiting) -> Answer:
        stream = self._stream
        results = [UNKNOWN if each is None else each.result() for each in message.smoothers]
        known = [math.isfinite(velocity) for _, velocity, _, _ in results]
        if stream.skip and not all(known):
            return {}
        answer: Answer = {}
        of_message = message.stamp_ns, message.frame_id, message.names
        first, second = self._numbers
        if stream.wanted[first]:
            positions = [
                result[0] if there else position
                for result, there, position in zip(results, known, message.positions)
            ]
            velocities = [result[1] for result in results]
            answer[first] = self._smoothed.encode(
                *of_message, positions, velocities, message.efforts
            )
        if stream.wanted[second]:
            answer[second] = self._stddev.encode(
                *of_message, [result[2] for result in results], [result[3] for result in results]
            )
        return answer
