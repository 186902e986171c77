"""What the files of launch/ share: one node of this package, its parameter file, its arguments.

Imports launch and launch_ros, which an installation of ROS 2 has and PyPI does not; launch files
alone import this module.
"""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'velocity_estimator'
TAKES_TIME = 'take the time from /clock'
MAKES_TIME = 'has no effect here: the simulator makes its own time'


def one_node(name: str, use_sim_time: str = TAKES_TIME) -> LaunchDescription:
    """One node, with its parameters from a file, and the arguments that every launch file has.

    Parameters
    ----------
    name : of the executable; unless told otherwise the node's too, and its parameters are those of
        config/`name`.yaml.
    use_sim_time : what that argument does to this node.
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
            # The file goes to the node by itself, which ends where there is none; with `parameters`
            # launch would only warn of it, and the node would run with its defaults.
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
