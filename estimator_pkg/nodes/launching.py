# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Shared by the files of launch/: one node of this package with its parameter file and arguments.

This module imports launch and launch_ros, which are part of a ROS 2 installation but not on PyPI.
Only launch files import it.
"""

from __future__ import annotations

from collections.abc import Iterable

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'velocity_estimator'
ESTIMATE = '~/estimate'
RESPAWN_DELAY = 2.0  # [s]


def observer(name: str, inputs: Iterable[str]) -> LaunchDescription:
    """Return an observer with an argument for each of its topics.

    Parameters
    ----------
    name : of the executable.
    inputs : its input topics, which are the names of the arguments that remap them.
    """
    topics = [(topic, topic, 'input topic') for topic in inputs]
    return _node(name, [*topics, ('estimate', ESTIMATE, 'output topic')], 'use the time of /clock')


def simulator(name: str) -> LaunchDescription:
    """Return a simulator; its topics are below `namespace`."""
    return _node(name, [], 'has no effect: the simulator uses the system time')


def _node(name: str, topics: list[tuple[str, str, str]], sim_time: str) -> LaunchDescription:
    """Return one node with the arguments of every launch file.

    Parameters
    ----------
    name : of the executable; by default also of the node, with the parameters in
        config/`name`.yaml.
    topics : argument, topic and description.
    sim_time : description of `use_sim_time` for this node.
    """
    config = PathJoinSubstitution([FindPackageShare(PACKAGE), 'config', f'{name}.yaml'])
    arguments = [
        ('params_file', config, 'parameter file of the node'),
        ('namespace', '', 'namespace of the node and its topics'),
        ('use_sim_time', 'false', sim_time),
        ('name', name, 'name of the node'),
        ('respawn', 'false', f'true: start the node again {RESPAWN_DELAY:g} s after it has ended'),
        ('log_level', 'info', 'least severe messages in the log: debug, info, warn, error, fatal'),
        *topics,
    ]
    given = {argument: LaunchConfiguration(argument) for argument, *_ in arguments}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(argument, default_value=default, description=description)
                for argument, default, description in arguments
            ),
            # The file is an argument of the node, which ends if it is missing; with `parameters`
            # launch would only warn, and the node would run with its defaults.
            Node(
                package=PACKAGE,
                executable=name,
                name=given['name'],
                namespace=given['namespace'],
                ros_arguments=[
                    '--params-file',
                    given['params_file'],
                    '--log-level',
                    given['log_level'],
                ],
                parameters=[
                    {'use_sim_time': ParameterValue(given['use_sim_time'], value_type=bool)}
                ],
                remappings=[(topic, given[argument]) for argument, topic, _ in topics],
                respawn=given['respawn'],
                respawn_delay=RESPAWN_DELAY,
                output='screen',
            ),
        ]
    )
