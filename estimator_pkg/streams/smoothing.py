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

from estimator_pkg.driver.bank import Taken
from estimator_pkg.driver.joint import Joint
from estimator_pkg.messages import joint_state
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.observers.angle.smoother import NO_RESULT, Smoother
from estimator_pkg.sensor.guard import DUPLICATE, USED_SAMPLE
from estimator_pkg.streams.answer import is_answered
from estimator_pkg.streams.contract import Answer, Output, Stream

SMOOTHED = Output('smoothed', joint_state.TYPE, on_demand=True, extra=True)
SMOOTHED_STDDEV = Output('smoothed_stddev', joint_state.TYPE, on_demand=True, extra=True)


# A message that is not answered yet: when its readings were taken [ns]; its stamp [ns], frame,
# names and efforts; positions in the convention of the estimates; the smoother of each joint, None
# for an unused sample.
Waiting = tuple[int, int, str, Sequence[str], Sequence[float], list[float], list['Smoother | None']]


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
        self, at_ns: int, stamp_ns: int, frame_id: str, taken: Taken | None
    ) -> list[Answer]:
        """Take one message; return the answers to those that are old enough now.

        Parameters
        ----------
        at_ns : when the observer takes its readings to be from.
        """
        if taken is None:
            return []
        names, estimates, efforts, line, positions = taken
        smoothers: list[Smoother | None] = []
        shown: list[float] = []
        used = False
        for name, position, joint, estimate in zip(names, positions, line.joints, estimates):
            if joint is None:
                shown.append(position)
                smoothers.append(None)
                continue
            written = joint.in_estimate_convention(position) if joint.settings.unwrap else position
            shown.append(written)
            if estimate is None:
                smoothers.append(None)
                continue
            used = True
            found = self._of.get(name)
            smoother = found[1] if found and found[0] is joint else self._smoother(name, joint)
            fresh = USED_SAMPLE < joint.verdict < DUPLICATE
            smoother.add(at_ns, position, written, fresh)
            smoothers.append(smoother)
        if not used:
            return []
        waiting = self._waiting
        waiting.append((at_ns, stamp_ns, frame_id, names, efforts, shown, smoothers))
        answers = []
        while waiting:
            age = at_ns - waiting[0][0]
            if 0 <= age < self._lag_ns:
                break
            if age < 0 and not set(names) & set(waiting[0][3]):
                break  # of another device, whose clock is behind; of the same one, it jumped
            answer = self._answer(waiting.popleft())
            if answer:
                answers.append(answer)
        return answers

    def _smoother(self, name: str, joint: Joint) -> Smoother:
        settings = joint.settings
        quantum = getattr(joint.gains, 'quantum', 0.0)
        smoother = Smoother(self._lag, settings.wrap_period, quantum, settings.unwrap)
        self._of[name] = joint, smoother
        return smoother

    def _answer(self, message: Waiting) -> Answer:
        _, stamp_ns, frame_id, names, efforts, positions, smoothers = message
        stream, (first, second) = self._stream, self._numbers
        velocities, of_positions, of_velocities = [], [], []
        for k, smoother in enumerate(smoothers):
            position, velocity, of_position, of_velocity = (
                NO_RESULT if smoother is None else smoother.result()
            )
            if velocity == velocity:
                positions[k] = position
            velocities.append(velocity)
            of_positions.append(of_position)
            of_velocities.append(of_velocity)
        answer: Answer = {}
        if not is_answered(stream, True, not any(map(math.isnan, velocities))):
            return answer
        if stream.wanted[first]:
            answer[first] = self._smoothed.encode(
                stamp_ns, frame_id, names, positions, velocities, efforts
            )
        if stream.wanted[second]:
            answer[second] = self._stddev.encode(
                stamp_ns, frame_id, names, of_positions, of_velocities
            )
        return answer
