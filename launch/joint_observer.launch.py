"""Starts the observer: `ros2 launch velocity_estimator joint_observer.launch.py`."""

from estimator_pkg.nodes.launching import one_node


def generate_launch_description():
    """The node, with the parameters of config/joint_observer.yaml or of `params_file`."""
    return one_node('joint_observer')
