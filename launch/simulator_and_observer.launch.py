# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts a simulator and the observer that suits it.

`ros2 launch velocity_estimator simulator_and_observer.launch.py simulator:=pmsm_sim`
"""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import SetParameter
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

SHARE = FindPackageShare('velocity_estimator')
PENDULUM = '[inertia=0.05, damping=0.02, gravity=1.5, coulomb=0.05]'
CART = '[force_constant=9.27, friction_forward=3.98, friction_backward=2.87]'
# The observer of each simulator, and its parameters for the simulated machine, as after `-p`.
OBSERVED = {
    'encoder_sim': ('joint_observer', {'quantum': '0.001534'}),
    'dc_motor_sim': ('adaptive_observer', {'quantum': '0.001534'}),
    'gripper_sim': ('switched_observer', {'quantum': '9.587e-5'}),
    'pmsm_sim': ('pmsm_observer', {}),
    'base_sim': ('wheel_odometry', {'radius': '[0.1]', 'track': '0.5', 'gyro_topic': 'imu'}),
    'pendulum_sim': (
        'mechanical_observer',
        {'quantum': '[0.001534]', 'model_parameters': PENDULUM},
    ),
    'cart_pendulum_sim': (
        'mechanical_observer',
        {'model': 'cart_pendulum', 'model_parameters': CART},
    ),
    'robotic_leg_sim': ('mechanical_observer', {'model': 'robotic_leg'}),
}


def _both(context):
    simulator = LaunchConfiguration('simulator').perform(context)
    observer, parameters = OBSERVED[simulator]
    return [
        _included(simulator, {}, LaunchConfiguration('simulator_params_file').perform(context)),
        _included(
            observer, parameters, LaunchConfiguration('observer_params_file').perform(context)
        ),
    ]


def _included(name, parameters, file):
    """Return the launch file of a node; a file of parameters replaces `parameters`."""
    default = PathJoinSubstitution([SHARE, 'config', f'{name}.yaml'])
    return GroupAction(
        [
            *(
                SetParameter(key, ParameterValue(text, value_type=str))
                for key, text in ({} if file else parameters).items()
            ),
            IncludeLaunchDescription(
                PathJoinSubstitution([SHARE, 'launch', f'{name}.launch.py']),
                launch_arguments={'params_file': file or default, 'name': name}.items(),
            ),
        ]
    )


def generate_launch_description():
    """Both nodes, in one `namespace`."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'simulator',
                default_value='encoder_sim',
                choices=list(OBSERVED),
                description='simulator; the observer follows from it',
            ),
            *(
                DeclareLaunchArgument(
                    f'{node}_params_file',
                    default_value='',
                    description=f'parameter file of the {node}; empty: that of config/',
                )
                for node in ('simulator', 'observer')
            ),
            DeclareLaunchArgument(
                'namespace', default_value='', description='namespace of the nodes and topics'
            ),
            OpaqueFunction(function=_both),
        ]
    )
