# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""nav_msgs/Odometry from and to CDR bytes: the motion of a base in the plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from estimator_pkg.messages.cdr import Reader, Writer
from estimator_pkg.messages.joint_state import EARLIEST, LATEST

TYPE = 'nav_msgs/msg/Odometry'
UNMEASURED = 1e6  # variance of z, roll and pitch, which wheels do not measure [m^2, rad^2]
PLANE = (0, 1, 5)  # x, y and yaw among x, y, z, roll, pitch, yaw

Matrix = Sequence[Sequence[float]]


class Odometry(NamedTuple):
    """A message of a base in the plane.

    pose : x [m], y [m], yaw [rad] in `frame_id`. twist : of x, y [m/s] and yaw [rad/s] in
    `child_frame_id`. Covariances : shape (3, 3), in this order.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    pose: Sequence[float]
    pose_covariance: Matrix
    twist: Sequence[float]
    twist_covariance: Matrix


def encode(message: Odometry) -> bytes:
    """Encode as CDR; a stamp outside the range of a header is clamped to it."""
    sec, nanosec = divmod(min(max(message.stamp_ns, EARLIEST), LATEST), 1_000_000_000)
    x, y, yaw = message.pose
    forward, left, rate = message.twist
    writer = Writer()
    writer.numbers('i', (sec,))
    writer.numbers('I', (nanosec,))
    writer.text(message.frame_id)
    writer.text(message.child_frame_id)
    writer.numbers('d', (x, y, 0.0, 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))
    writer.numbers('d', _whole(message.pose_covariance))
    writer.numbers('d', (forward, left, 0.0, 0.0, 0.0, rate))
    writer.numbers('d', _whole(message.twist_covariance))
    return bytes(writer.raw)


def decode(raw: bytes) -> Odometry:
    """Decode what `encode` made; raise MalformedMessageError if it is not an Odometry."""
    reader = Reader(raw)
    sec, nanosec = reader.number('i'), reader.number('I')
    frames = reader.text(), reader.text()
    x, y, _, _, _, sine, cosine = reader.numbers('d', 7)
    pose_covariance = _of_plane(reader.numbers('d', 36))
    twist = reader.numbers('d', 6)
    return Odometry(
        sec * 1_000_000_000 + nanosec,
        *frames,
        (x, y, 2.0 * math.atan2(sine, cosine)),
        pose_covariance,
        [twist[k] for k in PLANE],
        _of_plane(reader.numbers('d', 36)),
    )


def _whole(covariance: Matrix) -> list[float]:
    """Return the 36 numbers of a covariance."""
    found = [0.0] * 36
    for k in (2, 3, 4):
        found[7 * k] = UNMEASURED
    for i, row in zip(PLANE, covariance):
        for j, value in zip(PLANE, row):
            found[6 * i + j] = value
    return found


def _of_plane(numbers: Sequence[float]) -> list[list[float]]:
    return [[numbers[6 * i + j] for j in PLANE] for i in PLANE]
