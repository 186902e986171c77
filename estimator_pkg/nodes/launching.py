"""Shared by the files of launch/: one node of this package with its parameter file and arguments.

This module imports launch and launch_ros, which are part of a ROS 2 installation but not on PyPI.
Only launch files import it.
"""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'velocity_estimator'
TAKES_TIME = 'use the time of /clock'
MAKES_TIME = 'has no effect: the simulator uses the system time'


def one_node(name: str, use_sim_time: str = TAKES_TIME) -> LaunchDescription:
    """Return one node, with its parameters from a file, and the arguments of every launch file.

    Parameters
    ----------
    name : of the executable; by default also of the node, with the parameters in
        config/`name`.yaml.
    use_sim_time : description of that argument for this node.
    """
    default_file = PathJoinSubstitution([FindPackageShare(PACKAGE), 'config', f'{name}.yaml'])
    arguments = (
        ('params_file', default_file, 'parameter file of the node'),
        ('namespace', '', 'namespace of the node and its topics'),
        ('use_sim_time', 'false', use_sim_time),
        ('name', name, 'name of the node'),
    )
    given = {argument: LaunchConfiguration(argument) for argument, *_ in arguments}
    sim_time = ParameterValue(given['use_sim_time'], value_type=bool)
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
                ros_arguments=['--params-file', given['params_file']],
                parameters=[{'use_sim_time': sim_time}],
                output='screen',
            ),
        ]
    )
