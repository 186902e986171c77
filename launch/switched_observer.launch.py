"""Starts the observer: `ros2 launch velocity_estimator switched_observer.launch.py`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    """One node, with its parameters from a file."""
    default_file = PathJoinSubstitution(
        [FindPackageShare('velocity_estimator'), 'config', 'switched_observer.yaml'])
    return LaunchDescription([
        DeclareLaunchArgument('params_file', default_value=default_file,
                              description='parameter file of the node'),
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of the node and its topics'),
        DeclareLaunchArgument('use_sim_time', default_value='false',
                              description='take the time from /clock'),
        DeclareLaunchArgument('name', default_value='switched_observer',
                              description='name of the node'),
        Node(
            package='velocity_estimator',
            executable='switched_observer',
            name=LaunchConfiguration('name'),
            namespace=LaunchConfiguration('namespace'),
            parameters=[
                LaunchConfiguration('params_file'),
                {'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'),
                                                value_type=bool)},
            ],
            output='screen',
        ),
    ])
