# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A driver without velocities, and the observer in its place: `ros2 launch drop_in.launch.py`.

The driver is a simulated one: put yours in its place. Everything that reads /joint_states (RViz,
MoveIt, `ros2 topic echo` here) gets positions with velocities, and needs no change.
"""

from launch import LaunchDescription
from launch.actions import ExecuteProcess
from launch_ros.actions import Node


def generate_launch_description():
    """The driver under another name, the observer under the driver's, and a consumer."""
    return LaunchDescription(
        [
            Node(
                package='velocity_estimator',
                executable='encoder_sim',
                remappings=[('joint_states', 'joint_states_raw')],
            ),
            Node(
                package='velocity_estimator',
                executable='joint_observer',
                remappings=[('joint_states', 'joint_states_raw'), ('~/estimate', 'joint_states')],
            ),
            ExecuteProcess(
                cmd=['ros2', 'topic', 'echo', '/joint_states', '--field', 'velocity'],
                output='screen',
            ),
        ]
    )
