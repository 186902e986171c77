# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part live``: the nodes over real DDS, next to a node that only republishes.

The measured nodes are processes of their own. The programs here need ROS and psutil.
"""

from __future__ import annotations

import importlib.util
from typing import Any

from estimator_pkg.errors import UserError


def live(quick: bool = False) -> list[dict[str, Any]]:
    """Return rows: CPU per message, losses, starts, latencies, and the drive; raise UserError."""
    for needed in ('rclpy', 'psutil'):
        if importlib.util.find_spec(needed) is None:
            raise UserError(f'{needed} is not installed')
    from benchmarks.live import cost, drive, loss, timing
    from benchmarks.live.processes import NODES

    return [
        *(made for name in NODES for made in cost.rows(name)),
        *(made for case in loss.CASES for made in loss.rows(*case)),
        *timing.rows(timing.start, timing.START, 1 if quick else 5, timing.OF_JOINTS),
        *timing.rows(timing.latency, timing.LATENCY, 1 if quick else 3, timing.ALL),
        *drive.rows(),
    ]
