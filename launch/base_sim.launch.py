# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts the simulator: `ros2 launch velocity_estimator base_sim.launch.py`."""

from estimator_pkg.nodes.launching import simulator


def generate_launch_description():
    """The node, with the parameters of config/base_sim.yaml or of `params_file`."""
    return simulator('base_sim')
