# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The check of `ros2 doctor`: it reports observers that estimate nothing.

PyPI has no ros2doctor. Without it, small classes stand in for the interface as it was read in
ros2doctor 0.32 (Jazzy); where it is installed, the real `ros2doctor.api.run_checks` runs the check.
"""

import importlib
import importlib.metadata
import importlib.util
import subprocess
import sys
import types

import dds
import pytest

REAL = importlib.util.find_spec('ros2doctor') is not None
GROUPS = {'ros2doctor.checks': 'EstimateCheck', 'ros2doctor.report': 'EstimateReport'}


def stand_ins(monkeypatch):
    """ros2doctor.api, ros2doctor.api.format and ros2cli.node.direct, as far as they are used."""
    import rclpy

    class Direct:
        def __init__(self, args):
            assert args is None
            self.context = rclpy.Context()
            rclpy.init(args=[], context=self.context, domain_id=dds.DOMAIN)
            self.node = rclpy.create_node('stand_in', context=self.context)
            executor = self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
            executor.add_node(self.node)
            monkeypatch.setattr(
                rclpy, 'spin_once', lambda node, timeout_sec=None: executor.spin_once(timeout_sec)
            )
            for _ in range(20):
                executor.spin_once(0.05)

        def __enter__(self):
            return self

        def __getattr__(self, name):
            return getattr(self.node, name)

        def __exit__(self, *error):
            self.node.destroy_node()
            rclpy.shutdown(context=self.context)

    class Result:
        error = warning = 0

        def add_error(self):
            self.error += 1

    class Report:
        def __init__(self, name):
            self.name, self.items = name, []

        def add_to_report(self, item, info):
            self.items.append((item, info))

    said = []
    modules = {
        'ros2cli': {},
        'ros2cli.node': {},
        'ros2cli.node.direct': {'DirectNode': Direct},
        'ros2doctor': {},
        'ros2doctor.api': {
            'DoctorCheck': type('DoctorCheck', (), {}),
            'DoctorReport': type('DoctorReport', (), {}),
            'Report': Report,
            'Result': Result,
        },
        'ros2doctor.api.format': {'doctor_error': said.append},
    }
    for name, content in modules.items():
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return said


@pytest.fixture
def doctor(monkeypatch):
    """Run the check and the report: (result, texts, items of the report)."""
    said = stand_ins(monkeypatch)
    monkeypatch.delitem(sys.modules, 'estimator_pkg.ros.doctor', raising=False)

    def run():
        loaded = {
            group: entry.load()
            for group, name in GROUPS.items()
            for entry in importlib.metadata.entry_points(group=group)
            if entry.value.endswith(f'estimator_pkg.ros.doctor:{name}')
        }
        check, report = (loaded[group]() for group in GROUPS)
        assert check.category() == report.category() == 'velocity_estimator'
        said.clear()
        return check.check(), list(said), report.report().items

    yield run
    sys.modules.pop('estimator_pkg.ros.doctor', None)


def observer(name):
    return dds.NodeProcess(
        'estimator_pkg.nodes.executables joint_observer',
        *dds.ros_args(remap=[f'__node:={name}', f'joint_states:=/{name}_states']),
    )


def simulator(topic):
    return dds.NodeProcess(
        'sim_pkg.nodes.executables encoder_sim', *dds.ros_args(remap=[f'joint_states:=/{topic}'])
    )


def test_nodes_that_estimate_nothing_are_reported(doctor, probe):
    result, texts, items = doctor()
    assert (result.error, texts, items) == (0, [], [('node', 'none')])
    with observer('fed') as fed, observer('hungry') as hungry, simulator('fed_states'):
        fed.prints(' estimates ')
        hungry.prints(' estimates ')
        with dds.Observer(probe, '/fed', '/unused') as watched:
            probe.until(lambda: watched.status('wheel') == 'tracking')
        result, texts, items = doctor()
    assert result.error == 1
    (text,) = texts
    assert text.startswith('/hungry estimates nothing: ') and '/hungry_states' in text
    assert dict(zip(items[::2], items[1::2]))[('node', '/fed')] == ('estimates', 'yes')


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
