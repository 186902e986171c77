# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts the observer: `ros2 launch velocity_estimator switched_observer.launch.py`."""

from estimator_pkg.nodes.launching import observer


def generate_launch_description():
    """The node, with the parameters of config/switched_observer.yaml or of `params_file`."""
    return observer('switched_observer', inputs=['joint_states', 'effort_command', 'switch_event'])
