# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts the observer: `ros2 launch velocity_estimator adaptive_observer.launch.py`."""

from estimator_pkg.nodes.launching import observer


def generate_launch_description():
    """The node, with the parameters of config/adaptive_observer.yaml or of `params_file`."""
    return observer('adaptive_observer', inputs=['joint_states', 'effort_command'])
