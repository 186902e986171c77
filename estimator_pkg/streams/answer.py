# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What is published of a sample: the same bytes live and in replay."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.bank import Taken
from estimator_pkg.estimate import VALID
from estimator_pkg.messages import trajectory
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.messages.joint_state_block import encode_block
from estimator_pkg.streams.arrays import Estimated, patterns
from estimator_pkg.streams.contract import Answer, Answers, Output, Stream

ACCELERATION = Output('acceleration', trajectory.TYPE, on_demand=True)
NO_STDDEV = (math.nan, math.nan)  # standard deviations where there is no estimate


Bools = TypeVar('Bools', bool, NDArray[np.bool_])


def is_answered(stream: Stream, used: Bools, complete: Bools) -> Bools:
    """Return True for a message that is answered; the rule for one, a block, and ~/smoothed.

    Parameters
    ----------
    used : a sample of the message was used. complete : all of its joints have an estimate.
    """
    return used & complete if stream.skip else used


class Answering:
    """Makes the answer to a message that `is_answered`.

    The answer has the joints of the message, in its order. A joint has an estimate if its sample
    was used and its status is in `VALID`; without one its position is the measured one and its
    velocity is NaN. Efforts are copied.

    Parameters
    ----------
    stream : whose outputs these are; ~/acceleration only if it is among them.
    """

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._acceleration = (
            stream.outputs.index(ACCELERATION) if ACCELERATION in stream.outputs else None
        )
        self._estimate, self._stddev = Encoder(), Encoder()

    def __call__(self, stamp_ns: int, frame_id: str, taken: Taken | None) -> Answer:
        """Return the messages that answer one message, by number of the output.

        Parameters
        ----------
        taken : None: no sample of it was used.
        """
        stream = self._stream
        answer: Answer = {}
        if taken is None:
            return answer
        names, estimates, efforts, _, _ = taken
        numbers: Any = estimates
        shown = [k for k, each in enumerate(estimates) if each is not None and each[3] in VALID]
        complete = len(shown) == len(names)
        if not is_answered(stream, any(estimates), complete):
            return answer
        if not complete:
            numbers = list(estimates)
            for k in set(range(len(names))).difference(shown):
                numbers[k] = taken.measured_position(k), math.nan, math.nan
        stream.answered += bool(shown)
        if stream.wanted[0]:
            answer[0] = self._estimate.encode(
                stamp_ns,
                frame_id,
                names,
                [each[0] for each in numbers],
                [each[1] for each in numbers],
                efforts,
            )
        if stream.wanted[1]:
            pairs = [NO_STDDEV] * len(names)
            for k, pair in zip(shown, taken.stddevs(shown)):
                pairs[k] = pair
            answer[1] = self._stddev.encode(
                stamp_ns, frame_id, names, [pair[0] for pair in pairs], [pair[1] for pair in pairs]
            )
        number = self._acceleration
        if number is not None and stream.wanted[number]:
            giving = [(name, each) for name, each in zip(names, numbers) if math.isfinite(each[2])]
            if giving:
                answer[number] = trajectory.encode(
                    stamp_ns,
                    frame_id,
                    [name for name, _ in giving],
                    *([each[i] for _, each in giving] for i in range(3)),
                )
        return answer

    def block(self, estimated: Estimated) -> Iterator[Answers]:
        """As a call for each message of a group that names the same joints."""
        stream = self._stream
        answered: NDArray[np.bool_] = is_answered(
            stream, np.any(estimated.used, axis=1), np.all(estimated.valid, axis=1)
        )
        if not answered.any():
            return
        if not answered.all():
            estimated = estimated.of(answered)
        (rows, frame_id, names, stamps_ns, measured, efforts), _, valid, *arrays = estimated
        position, velocity, acceleration, *stddevs = arrays
        stream.answered += int(np.count_nonzero(valid.any(axis=1)))
        if not valid.all():
            position = np.where(valid, position, measured)
            velocity = np.where(valid, velocity, np.nan)
            stddevs = [np.where(valid, each, np.nan) for each in stddevs]
        for number, encoder, numbers in (
            (0, self._estimate, (position, velocity, efforts)),
            (1, self._stddev, stddevs),
        ):
            if stream.wanted[number]:
                raw = encode_block(encoder, stamps_ns, frame_id, names, *numbers)
                yield Answers(number, rows, number + 1, raw)
        if self._acceleration is not None and stream.wanted[self._acceleration]:
            for which, joints in patterns(valid & np.isfinite(acceleration)):
                raw = trajectory.encode_block(
                    stamps_ns[which],
                    frame_id,
                    [name for name, there in zip(names, joints) if there],
                    *(array[which][:, joints] for array in (position, velocity, acceleration)),
                )
                yield Answers(self._acceleration, rows[which], self._acceleration + 1, raw)
