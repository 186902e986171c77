# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""nav_msgs/Odometry as CDR bytes: the motion of a base in the plane."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estimator_pkg.messages.cdr import Writer

TYPE = 'nav_msgs/msg/Odometry'
UNMEASURED = 1e6  # variance of z, roll and pitch, which wheels do not measure [m^2, rad^2]
PLANE = (0, 1, 5)  # x, y and yaw among x, y, z, roll, pitch, yaw

Matrix = Sequence[Sequence[float]]


def encode(
    stamp_ns: int,
    frames: tuple[str, str],
    pose: Sequence[float],
    pose_covariance: Matrix,
    twist: Sequence[float],
    twist_covariance: Matrix,
) -> bytes:
    """Encode as CDR; a stamp outside the range of a header is clamped to it.

    Parameters
    ----------
    frames : of the pose, and of the twist. pose : x [m], y [m], yaw [rad]. twist : of x, y [m/s]
    and yaw [rad/s]. Covariances : shape (3, 3), in this order.
    """
    (x, y, yaw), (forward, left, rate) = pose, twist
    writer = Writer()
    writer.header(stamp_ns, frames[0])
    writer.text(frames[1])
    writer.numbers('d', (x, y, 0.0, 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))
    writer.numbers('d', _whole(pose_covariance))
    writer.numbers('d', (forward, left, 0.0, 0.0, 0.0, rate))
    writer.numbers('d', _whole(twist_covariance))
    return bytes(writer.raw)


def _whole(covariance: Matrix) -> list[float]:
    """Return the 36 numbers of a covariance."""
    whole = np.diag([0.0, 0.0, UNMEASURED, UNMEASURED, UNMEASURED, 0.0])
    whole[np.ix_(PLANE, PLANE)] = covariance
    numbers: list[float] = whole.ravel().tolist()
    return numbers
