# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Shared by the files of launch/: one node of this package with its parameter file and arguments.

This module imports launch and launch_ros, which are part of a ROS 2 installation but not on PyPI.
Only launch files import it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'velocity_estimator'
RESPAWN_DELAY = 2.0  # [s]


def observer(
    name: str,
    inputs: Iterable[str],
    outputs: Iterable[str] = ('estimate',),
    parameters: Mapping[str, tuple[str, str]] | None = None,
) -> LaunchDescription:
    """Return an observer with an argument for each of its topics.

    Parameters
    ----------
    name : of the executable.
    inputs, outputs : its topics, which are the names of the arguments that remap them.
    parameters : argument -> parameter that it sets unless it is empty, and description.
    """
    topics = [(topic, topic, 'input topic') for topic in inputs]
    topics += [(topic, f'~/{topic}', 'output topic') for topic in outputs]
    return _node(name, topics, 'use the time of /clock', parameters or {})


def simulator(name: str) -> LaunchDescription:
    """Return a simulator; its topics are below `namespace`."""
    return _node(name, [], 'has no effect: the simulator uses the system time', {})


def _node(
    name: str,
    topics: list[tuple[str, str, str]],
    sim_time: str,
    parameters: Mapping[str, tuple[str, str]],
) -> LaunchDescription:
    """Return one node with the arguments of every launch file.

    Parameters
    ----------
    name : of the executable; by default also of the node, with the parameters in
        config/`name`.yaml.
    topics : argument, topic and description.
    sim_time : description of `use_sim_time` for this node.
    parameters : see `observer`.
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
        *((argument, '', description) for argument, (_, description) in parameters.items()),
    ]
    given = {argument: LaunchConfiguration(argument) for argument, *_ in arguments}

    def node(context: LaunchContext) -> list[Node]:
        own = {
            parameter: ParameterValue(given[argument], value_type=str)
            for argument, (parameter, _) in parameters.items()
            if given[argument].perform(context)
        }
        # The file is an argument of the node, which ends if it is missing; with `parameters`
        # launch would only warn, and the node would run with its defaults.
        return [
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
                    {'use_sim_time': ParameterValue(given['use_sim_time'], value_type=bool), **own}
                ],
                remappings=[(topic, given[argument]) for argument, topic, _ in topics],
                respawn=given['respawn'],
                respawn_delay=RESPAWN_DELAY,
                output='screen',
            )
        ]

    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(argument, default_value=default, description=description)
                for argument, default, description in arguments
            ),
            OpaqueFunction(function=node),
        ]
    )
