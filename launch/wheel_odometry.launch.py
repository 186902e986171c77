# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts the observer: `ros2 launch velocity_estimator wheel_odometry.launch.py`."""

from estimator_pkg.nodes.launching import observer


def generate_launch_description():
    """The node, with the parameters of config/wheel_odometry.yaml or of `params_file`."""
    return observer(
        'wheel_odometry',
        inputs=['joint_states'],
        outputs=['estimate', 'odometry'],
        parameters={'imu': ('gyro_topic', 'topic of a gyro; empty: gyro_topic of params_file')},
    )
