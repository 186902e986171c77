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
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray

from estimator_pkg import streams
from estimator_pkg.ros.observers import why_nothing

ROOT = Path(__file__).resolve().parents[2]
OBSERVER = 'estimator_pkg.nodes.executables joint_observer'


@pytest.fixture(scope='module')
def found(probe):
    """The entries of a simulator, the observer that it feeds and another one, by topic; and what
    the check of `ros2 doctor` finds.
    """
    heard = {'/diagnostics': [], '/left/joint_observer/status': []}
    for topic, qos in (('/diagnostics', 10), ('/left/joint_observer/status', dds.latched())):
        extend = heard[topic].extend
        probe.node.create_subscription(
            DiagnosticArray, topic, lambda message, extend=extend: extend(message.status), qos
        )
    inside = dds.ros_args(remap=['__ns:=/left'])
    asking = rclpy.create_node('asking')
    assert why_nothing(asking) == {}
    with (
        dds.NodeProcess('sim_pkg.nodes.executables encoder_sim', *inside),
        dds.NodeProcess(OBSERVER, *inside),
        dds.NodeProcess(OBSERVER, *dds.ros_args(remap=['__node:=hungry'])),
    ):
        probe.until(lambda: len({each.name for each in heard['/diagnostics']}) == 4)
        statuses = heard['/left/joint_observer/status']
        probe.until(lambda: any(each.message == 'tracking' for each in statuses))
        heard['why nothing'] = why_nothing(asking)
    asking.destroy_node()
    return heard


def test_every_entry_has_a_hardware_id(found):
    ids = {each.name: each.hardware_id for each in found['/diagnostics']}
    assert ids == {
        '/hungry': '/hungry',
        '/left/joint_observer': '/left/joint_observer',
        '/left/joint_observer: wheel': 'wheel',
        '/left/encoder_sim: deadlines': '/left/encoder_sim',
    }
    assert {(each.name, each.hardware_id) for each in found['/left/joint_observer/status']} == {
        ('wheel', 'wheel'),
        ('/left/joint_observer', '/left/joint_observer'),
    }


def test_nodes_that_estimate_nothing_are_reported(found):
    why = found['why nothing']
    assert list(why) == ['/hungry', '/left/joint_observer']
    assert why['/left/joint_observer'] == '' and 'waits for a publisher of' in why['/hungry']


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


def test_the_aggregator_groups_every_entry():
    assert group_of('/left/encoder_sim: deadlines') == ['Simulators']
    assert not group_of('/camera: frequency')


@pytest.mark.parametrize('node', [stream.NODE for stream in streams.every()])
def test_the_aggregator_groups_every_observer(node):
    assert group_of(f'/{node}') == group_of(f'/left/{node}: elbow') == ['Observers']


@pytest.mark.skipif(
    importlib.util.find_spec('ros2doctor') is None,
    reason='ros2doctor is part of ROS 2, PyPI does not have it',
)
def test_the_real_doctor_runs_it():
    code = (
        'from ros2doctor.api import generate_reports, run_checks\n'
        'print(run_checks(exclude_packages=True))\n'
        "(report,) = generate_reports(categories=['velocity_estimator'])\n"
        'print(report.name, report.items)'
    )
    hungry = dds.NodeProcess(OBSERVER, *dds.ros_args(remap=['__node:=hungry']))
    with hungry:
        hungry.prints(' estimates ')
        done = subprocess.run(
            [sys.executable, '-c', code], capture_output=True, text=True, timeout=120
        )
    assert "{'velocity_estimator'" in done.stdout or "'velocity_estimator'}" in done.stdout
    assert 'ERROR: /hungry estimates nothing: no joint has appeared' in done.stderr
    assert "VELOCITY ESTIMATOR NODES [('node', '/hungry')" in done.stdout
