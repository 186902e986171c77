# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Main functions of the simulator executables; each runs until the simulation ends.

``python -m sim_pkg.nodes.executables encoder_sim --ros-args ...`` runs one without its script. To
run a simulator in your own executor, pass its SIMULATOR (as in `sim_pkg.joints.encoder`) to
`sim_pkg.nodes.simulator_node.SimulatorNode`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from estimator_pkg import registry
from estimator_pkg.ros.runtime import run

if TYPE_CHECKING:
    from sim_pkg.nodes.simulator_node import SimulatorNode


def make_node(**options: Any) -> SimulatorNode:
    """Return the cart_pendulum node with feedback; its process ends with the simulation."""
    from dataclasses import replace
    from functools import partial

    import rclpy
    from sensor_msgs.msg import JointState

    from sim_pkg.mechanisms.cart_pendulum import SIMULATOR, Feedback, generate
    from sim_pkg.nodes.simulator_node import SENSOR_DATA, SimulatorNode

    feedback = Feedback()
    simulator = replace(SIMULATOR, generate=partial(generate, feedback=feedback))
    node = SimulatorNode(simulator, 'cart_pendulum_sim', on_end=rclpy.try_shutdown, **options)

    def came(message: JointState) -> None:
        velocities = dict(zip(message.name, message.velocity))
        if {'pendulum', 'cart'} <= velocities.keys():
            feedback.put((velocities['pendulum'], velocities['cart']))

    node.create_subscription(JointState, 'estimate', came, SENSOR_DATA)
    return node


def of_simulator(name: str) -> Callable[..., int]:
    """Return the main function of the node that runs the simulator `name`.

    It imports ROS and the simulator when it is called: the imports are slow, and an interrupt
    during them ends the process quietly.
    """

    def make_node() -> SimulatorNode:
        import rclpy

        from sim_pkg.nodes.simulator_node import SimulatorNode

        simulator = registry.find(registry.SIMULATORS, name)
        return SimulatorNode(simulator, f'{name}_sim', on_end=rclpy.try_shutdown)

    return process(make_node)


def process(make_node: Callable[[], SimulatorNode]) -> Callable[..., int]:
    """Return the main function of a process that runs the node of `make_node`."""

    def main(args: list[str] | None = None) -> int:
        """Run the node until it ends or is interrupted; return the exit code."""
        made: list[SimulatorNode] = []

        def make() -> SimulatorNode:
            made.append(make_node())
            return made[0]

        code = run(make, args)
        if made and made[0].error is not None:
            return getattr(made[0].error, 'exit_code', 1)
        return code

    return main


encoder_sim = of_simulator('encoder')
dc_motor_sim = of_simulator('dc_motor')
gripper_sim = of_simulator('gripper')
pendulum_sim = of_simulator('pendulum')
robotic_leg_sim = of_simulator('robotic_leg')
pmsm_sim = of_simulator('pmsm')
base_sim = of_simulator('base')
cart_pendulum_sim = process(make_node)

if __name__ == '__main__':
    name = sys.argv.pop(1) if len(sys.argv) > 1 else ''
    if not name.endswith('_sim') or name not in globals():
        sys.exit(f"unknown simulator '{name}': pass the name of an executable, as encoder_sim")
    sys.argv[0] = name
    sys.exit(globals()[name]())
