"""The node ``gripper_sim``: the simulator ``gripper``, live.

To run it in an executor of your own, make a ``SimulatorNode(SIMULATOR, 'gripper_sim')``.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from estimator_pkg.nodes.runtime import run

if TYPE_CHECKING:
    from rclpy.node import Node


def make_node() -> Node:
    """The node; its process ends when the simulation does."""
    import rclpy

    from sim_pkg.gripper import SIMULATOR
    from sim_pkg.nodes.simulator_node import SimulatorNode

    return SimulatorNode(SIMULATOR, 'gripper_sim', on_end=rclpy.try_shutdown)


def main(args: list[str] | None = None) -> int:
    """Run the node until it ends or is interrupted; returns the exit code."""
    return run(make_node, args)


if __name__ == '__main__':
    sys.exit(main())
