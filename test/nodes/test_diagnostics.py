# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Entries of diagnostics and their groups, and the check of `ros2 doctor` that reads them.

PyPI has no ros2doctor: where it is installed, `ros2doctor.api.run_checks` runs the check.
"""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import dds
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile

from estimator_pkg import streams

ROOT = Path(__file__).resolve().parents[2]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture(scope='module')
def entries(probe):
    """The entries of a simulator and an observer, by topic."""
    found = {'/diagnostics': [], '/left/joint_observer/status': []}
    subscriptions = [
        probe.node.create_subscription(
            DiagnosticArray,
            topic,
            lambda message, topic=topic: found[topic].extend(message.status),
            qos,
        )
        for topic, qos in (('/diagnostics', 10), ('/left/joint_observer/status', LATCHED))
    ]
    inside = dds.ros_args(remap=['__ns:=/left'])
    with (
        dds.NodeProcess('sim_pkg.nodes.executables encoder_sim', *inside),
        dds.NodeProcess('estimator_pkg.nodes.executables joint_observer', *inside),
    ):
        probe.until(lambda: len({each.name for each in found['/diagnostics']}) == 3)
        probe.until(lambda: found['/left/joint_observer/status'])
    for subscription in subscriptions:
        probe.node.destroy_subscription(subscription)
    return found


def test_every_entry_has_a_hardware_id(entries):
    ids = {each.name: each.hardware_id for each in entries['/diagnostics']}
    assert ids == {
        '/left/joint_observer': '/left/joint_observer',
        '/left/joint_observer: wheel': 'wheel',
        '/left/encoder_sim: deadlines': '/left/encoder_sim',
    }
    assert {(each.name, each.hardware_id) for each in entries['/left/joint_observer/status']} == {
        ('wheel', 'wheel'),
        ('/left/joint_observer', '/left/joint_observer'),
    }


def analyzers():
    """(path, patterns) of each analyzer, as the aggregator reads them.

    From diagnostic_aggregator's sources (branch ros2-jazzy): the node is 'analyzers', an analyzer
    is a group of parameters with `type` and `path`, and GenericAnalyzer matches the whole name of
    an entry with `regex`.
    """
    read = yaml.safe_load((ROOT / 'config/diagnostics_aggregator.yaml').read_text())
    parameters = read['analyzers']['ros__parameters']
    groups = {key: value for key, value in parameters.items() if isinstance(value, dict)}
    assert set(parameters) == {'path', *groups}
    for group in groups.values():
        assert group['type'] == 'diagnostic_aggregator/GenericAnalyzer'
        assert set(group) == {'type', 'path', 'regex', 'timeout'}
        assert isinstance(group['timeout'], float)  # read with as_double
    return {group['path']: group['regex'] for group in groups.values()}


def group_of(name):
    return [
        path
        for path, patterns in analyzers().items()
        if any(re.fullmatch(pattern, name) for pattern in patterns)
    ]


def test_the_aggregator_groups_every_entry(entries):
    for name in {each.name for each in entries['/diagnostics']}:
        assert group_of(name) == (['Simulators'] if '_sim' in name else ['Observers']), name
    assert not group_of('/camera: frequency')


@pytest.mark.parametrize('node', [stream.NODE for stream in streams.every()])
def test_the_aggregator_groups_every_observer(node):
    assert group_of(f'/{node}') == group_of(f'/left/{node}: elbow') == ['Observers']


# ---- ros2 doctor

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
