# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The check of `ros2 doctor`: it reports observers that estimate nothing.

PyPI has no ros2doctor: where it is installed, `ros2doctor.api.run_checks` runs the check.
"""

import importlib.util
import subprocess
import sys

import dds
import pytest

REAL = importlib.util.find_spec('ros2doctor') is not None


def observer(name):
    return dds.NodeProcess(
        'estimator_pkg.nodes.executables joint_observer',
        *dds.ros_args(remap=[f'__node:={name}', f'joint_states:=/{name}_states']),
    )


def simulator(topic):
    return dds.NodeProcess(
        'sim_pkg.nodes.executables encoder_sim', *dds.ros_args(remap=[f'joint_states:=/{topic}'])
    )


def test_nodes_that_estimate_nothing_are_reported(probe):
    import rclpy

    from estimator_pkg.ros.observers import why_nothing

    asking = rclpy.create_node('asking')
    try:
        assert why_nothing(asking) == {}
        with observer('fed') as fed, observer('hungry') as hungry, simulator('fed_states'):
            fed.prints(' estimates ')
            hungry.prints(' estimates ')
            with dds.Observer(probe, '/fed', '/unused') as watched:
                probe.until(lambda: watched.status('wheel') == 'tracking')
            found = why_nothing(asking)
        assert list(found) == ['/fed', '/hungry'] and found['/fed'] == ''
        assert '/hungry_states' in found['/hungry']
    finally:
        asking.destroy_node()


def test_a_node_costs_nothing_without_ros2cli():
    """Nothing of ours imports the module."""
    code = (
        'import sys, estimator_pkg.nodes.observer, estimator_pkg.cli\n'
        "assert not {name for name in sys.modules if 'doctor' in name or 'ros2cli' in name}"
    )
    subprocess.run([sys.executable, '-c', code], check=True, timeout=60)


@pytest.mark.skipif(not REAL, reason='ros2doctor is part of ROS 2, PyPI does not have it')
def test_the_real_doctor_runs_it():
    code = (
        'from ros2doctor.api import generate_reports, run_checks\n'
        'print(run_checks(exclude_packages=True))\n'
        "(report,) = generate_reports(categories=['velocity_estimator'])\n"
        'print(report.name, report.items)'
    )
    with observer('hungry') as hungry:
        hungry.prints(' estimates ')
        done = subprocess.run(
            [sys.executable, '-c', code], capture_output=True, text=True, timeout=120
        )
    assert "{'velocity_estimator'" in done.stdout or "'velocity_estimator'}" in done.stdout
    assert 'ERROR: /hungry estimates nothing: no joint has appeared' in done.stderr
    assert "VELOCITY ESTIMATOR NODES [('node', '/hungry')" in done.stdout
