# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts a joint_observer for each of two arms, as /left/joint_observer and /right/joint_observer.

`ros2 launch velocity_estimator two_arms.launch.py right_joint_states:=/ur/joint_states`
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import PushRosNamespace
from launch_ros.substitutions import FindPackageShare

SHARE = FindPackageShare('velocity_estimator')
CONFIG = PathJoinSubstitution([SHARE, 'config', 'joint_observer.yaml'])
OBSERVER = PathJoinSubstitution([SHARE, 'launch', 'joint_observer.launch.py'])


def _arm(name):
    """Return the arguments of an arm and its group; a group keeps its arguments to itself."""
    own = {
        f'{name}_joint_states': ('joint_states', 'input topic, relative to the namespace'),
        f'{name}_params_file': (CONFIG, 'parameter file'),
    }
    return [
        *(
            DeclareLaunchArgument(
                argument, default_value=default, description=f'{text} of the {name} arm'
            )
            for argument, (default, text) in own.items()
        ),
        GroupAction(
            [
                PushRosNamespace(name),
                IncludeLaunchDescription(
                    OBSERVER,
                    launch_arguments={
                        argument.removeprefix(f'{name}_'): LaunchConfiguration(argument)
                        for argument in own
                    }.items(),
                ),
            ]
        ),
    ]


def generate_launch_description():
    """Both observers; further arguments are those of joint_observer.launch.py."""
    return LaunchDescription([*_arm('left'), *_arm('right')])
