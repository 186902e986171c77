# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""trajectory_msgs/JointTrajectory with one point, as CDR bytes: the type of ~/acceleration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.messages.cdr import EARLIEST, LATEST, Writer
from estimator_pkg.messages.layouts import put, put_stamps

TYPE = 'trajectory_msgs/msg/JointTrajectory'


def encode(
    stamp_ns: int,
    frame_id: str,
    names: Sequence[str],
    positions: Sequence[float],
    velocities: Sequence[float],
    accelerations: Sequence[float],
) -> bytes:
    """Encode one point [SI]; a stamp outside the range of a header is clamped to it."""
    return _encode(stamp_ns, frame_id, names, positions, velocities, accelerations)[0]


def _encode(
    stamp_ns: int, frame_id: str, names: Sequence[str], *arrays: Sequence[float]
) -> tuple[bytes, list[int]]:
    """Return the bytes, and the position of each array's first number."""
    writer = Writer()
    writer.header(stamp_ns, frame_id)
    writer.texts(names)
    writer.numbers('I', (1,))
    starts = []
    for values in (*arrays, ()):  # the last one: effort
        writer.doubles(values)
        starts.append(len(writer.raw) - 8 * len(values))
    writer.numbers('i', (0,))  # time_from_start
    writer.numbers('I', (0,))
    return bytes(writer.raw), starts


def encode_block(
    stamps_ns: NDArray[np.int64], frame_id: str, names: Sequence[str], *arrays: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """Encode many messages with these names, shape (n, bytes of one message).

    Parameters
    ----------
    stamps_ns : shape (n,). arrays : positions, velocities, accelerations, each of shape (n, names).
    """
    template, starts = _encode(0, frame_id, names, *(([0.0] * len(names),) * len(arrays)))
    out = np.empty((len(stamps_ns), len(template)), np.uint8)
    out[:] = np.frombuffer(template, np.uint8)
    put_stamps(out, 4, np.clip(stamps_ns, EARLIEST, LATEST))
    for start, array in zip(starts, arrays):
        put(out, start, np.ascontiguousarray(array, '<f8'))
    return out
