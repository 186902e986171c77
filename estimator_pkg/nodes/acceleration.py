"""The message on ~/acceleration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Time
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


def trajectory(stamp_ns: int, frame_id: str, names: Sequence[str],
               estimates: Sequence[Sequence[Any]]) -> JointTrajectory:
    """One point with the joints whose acceleration is known.

    Parameters
    ----------
    estimates : (position, velocity, acceleration or nan, ...) of each name [SI].
    """
    giving = [(name, each) for name, each in zip(names, estimates) if math.isfinite(each[2])]
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return JointTrajectory(
        header=Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame_id),
        joint_names=[name for name, _ in giving],
        points=[JointTrajectoryPoint(
            positions=[each[0] for _, each in giving],
            velocities=[each[1] for _, each in giving],
            accelerations=[each[2] for _, each in giving])])
