"""What the executables `*_sim` share: a process with one simulator node."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING

from estimator_pkg.nodes.runtime import run

if TYPE_CHECKING:
    from sim_pkg.nodes.simulator_node import SimulatorNode


def executable(name: str, module: str) -> Callable[..., int]:
    """The main function of the node `name`, which plays the SIMULATOR of `module`.

    Both ROS and the simulator are imported when it is called: they take a while, and an interrupt
    before that ends the process quietly.
    """
    def make_node() -> SimulatorNode:
        import rclpy

        from sim_pkg.nodes.simulator_node import SimulatorNode
        simulator = importlib.import_module(module).SIMULATOR
        return SimulatorNode(simulator, name, on_end=rclpy.try_shutdown)

    return process(make_node)


def process(make_node: Callable[[], SimulatorNode]) -> Callable[..., int]:
    """The main function of a process with the node that `make_node` makes."""
    def main(args: list[str] | None = None) -> int:
        """Run the node until it ends or is interrupted; returns the exit code."""
        made: list[SimulatorNode] = []

        def make() -> SimulatorNode:
            made.append(make_node())
            return made[0]

        code = run(make, args)
        if made and made[0].error is not None:
            return getattr(made[0].error, 'exit_code', 1)
        return code

    return main
