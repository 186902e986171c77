"""What the executables `*_sim` share: a process with one simulator node."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING

from estimator_pkg.nodes.runtime import run

if TYPE_CHECKING:
    from rclpy.node import Node


def executable(name: str, module: str) -> Callable[..., int]:
    """The main function of the node `name`, which plays the SIMULATOR of `module`.

    Both ROS and the simulator are imported when it is called: they take a while, and an interrupt
    before that ends the process quietly.
    """
    def make_node() -> Node:
        import rclpy

        from sim_pkg.nodes.simulator_node import SimulatorNode
        simulator = importlib.import_module(module).SIMULATOR
        return SimulatorNode(simulator, name, on_end=rclpy.try_shutdown)

    def main(args: list[str] | None = None) -> int:
        """Run the node until it ends or is interrupted; returns the exit code."""
        return run(make_node, args)

    return main
