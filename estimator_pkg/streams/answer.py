"""The messages that answer a sample: the same bytes live and in replay."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from estimator_pkg.driver.joint import Joint
from estimator_pkg.messages import trajectory
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.streams.contract import Answer, Output

ACCELERATION = Output('acceleration', trajectory.TYPE, on_demand=True)

Pairs = Iterable[Sequence[Any]]  # position and velocity first, of each joint


class Answering:
    """Encodes estimate, standard deviation and acceleration, each while it is wanted.

    Parameters
    ----------
    wanted : by number of the output; the stream's own list.
    acceleration : number of the output ~/acceleration; None: there is none.
    """

    def __init__(self, wanted: Sequence[bool], acceleration: int | None = None) -> None:
        self._wanted = wanted
        self._acceleration = acceleration
        self._encode, self._encode_stddev = Encoder().encode, Encoder().encode

    def __call__(
        self,
        stamp_ns: int,
        frame_id: str,
        names: Sequence[str],
        estimates: Sequence[Sequence[Any]],
        stddevs: Callable[[], Pairs],
    ) -> Answer:
        """The answer with the estimates of these joints.

        Parameters
        ----------
        estimates : position, velocity and maybe acceleration or nan, of each name [SI].
        stddevs : makes the standard deviations of position and velocity, of each name.
        """
        answer: Answer = {}
        if self._wanted[0]:
            answer[0] = self._encode(
                stamp_ns,
                frame_id,
                names,
                [each[0] for each in estimates],
                [each[1] for each in estimates],
            )
        if self._wanted[1]:
            pairs = list(stddevs())
            answer[1] = self._encode_stddev(
                stamp_ns, frame_id, names, [pair[0] for pair in pairs], [pair[1] for pair in pairs]
            )
        number = self._acceleration
        if number is not None and self._wanted[number]:
            giving = [
                (name, each) for name, each in zip(names, estimates) if math.isfinite(each[2])
            ]
            answer[number] = trajectory.encode(
                stamp_ns,
                frame_id,
                [name for name, _ in giving],
                [each[0] for _, each in giving],
                [each[1] for _, each in giving],
                [each[2] for _, each in giving],
            )
        return answer

    def joints(
        self, stamp_ns: int, frame_id: str, valid: Sequence[tuple[str, Joint, Sequence[Any]]]
    ) -> Answer:
        """As a call, with (name, joint, estimate) of each."""
        return self(
            stamp_ns,
            frame_id,
            [name for name, _, _ in valid],
            [estimate for _, _, estimate in valid],
            lambda: [joint.stddev() for _, joint, _ in valid],
        )
