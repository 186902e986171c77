"""The node ``cart_pendulum_sim``: the simulator ``cart_pendulum``, live.

With ``control: observer`` it balances the pendulum with the velocities on the topic ``estimate``
(sensor_msgs/JointState; remap it to ``mechanical_observer/estimate``), and holds the pendulum
upright, as by hand, until the first of them comes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim_pkg.nodes.simulator_node import SimulatorNode


def make_node(**options: Any) -> SimulatorNode:
    """The node; its process ends when the simulation does."""
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
