# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The examples of docs/examples, run as they stand. Those of drives: test/sim/test_drive_csv.py."""

import ast
import math
import os
import runpy
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import dds
import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / 'docs' / 'examples'
MODULES = {'encoder_sim': 'sim_pkg', 'joint_observer': 'estimator_pkg'}


def test_a_log_has_a_velocity_with_its_interval(monkeypatch, tmp_path):
    monkeypatch.setenv('MPLBACKEND', 'Agg')
    monkeypatch.setattr(sys, 'argv', ['log.py', str(tmp_path / 'log.png')])
    found = runpy.run_path(str(EXAMPLES / 'log.py'))
    assert (tmp_path / 'log.png').read_bytes()[:4] == b'\x89PNG'
    time = found['log']['time']
    true = 0.6 * math.pi * np.cos(math.pi * time)
    true += 0.21 * math.pi * np.cos(4.2 * math.pi * time)
    within = (found['low'] <= true) & (true <= found['high'])
    assert np.mean(within[100:]) > 0.85


def nodes_of(file):
    """(executable, remappings) of every node in a launch file, which PyPI's ROS cannot run."""
    for call in ast.walk(ast.parse((EXAMPLES / file).read_text())):
        if isinstance(call, ast.Call) and ast.unparse(call.func) == 'Node':
            words = {each.arg: ast.literal_eval(each.value) for each in call.keywords}
            yield words['executable'], words['remappings']


def test_the_observer_takes_the_drivers_place(probe):
    """The nodes of the launch file, and a subscriber of /joint_states."""
    from sensor_msgs.msg import JointState

    got = []
    heard = probe.node.create_subscription(JointState, '/joint_states', got.append, 50)
    with ExitStack() as stack:
        for name, pairs in nodes_of('drop_in.launch.py'):
            remap = [f'{one}:={other}' for one, other in pairs]
            module = f'{MODULES[name]}.nodes.executables {name}'
            stack.enter_context(dds.NodeProcess(module, *dds.ros_args(remap=remap)))
        probe.until(lambda: any(each.velocity and each.velocity[0] > 0.0 for each in got))
    assert all(len(each.velocity) == len(each.name) == 1 for each in got)
    probe.node.destroy_subscription(heard)


@pytest.mark.slow
def test_a_motor_without_an_encoder_gets_a_tuned_node(tmp_path):
    path = f'{Path(sys.executable).parent}:{os.environ["PATH"]}'
    process = subprocess.Popen(
        ['sh', str(EXAMPLES / 'motor.sh')],
        cwd=tmp_path,
        env={**os.environ, 'PATH': path},
        stdout=(tmp_path / 'said').open('w'),
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        said = tmp_path / 'said'
        end = time.monotonic() + 200.0
        while 'tracking 2 joints of /drive_samples' not in said.read_text():
            assert process.poll() is None and time.monotonic() < end, said.read_text()
            time.sleep(0.2)
    finally:
        os.killpg(process.pid, signal.SIGINT)
        process.wait(20.0)
    assert '0 FAIL' in said.read_text()
    assert 'relative_bandwidth' in (tmp_path / 'motor_tuned.yaml').read_text()
