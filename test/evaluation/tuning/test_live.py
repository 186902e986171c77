# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""tune --live beside a running simulator and observer, over real DDS."""

import json
import shlex
import signal

import dds
import pytest

from estimator_pkg import params_file
from estimator_pkg.cli import main
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.tuning.live import apply, recorded

pytest.importorskip('optuna', reason='not run: Optuna is not installed')


def parameter(process_name, name):
    """A parameter of a running node, asked for over DDS."""
    from estimator_pkg.bags.live import RemoteParameters, live

    with live('asker') as here:
        return RemoteParameters(here, process_name).get([name])[name]


def test_a_request_whose_answer_is_lost_is_made_again(monkeypatch):
    """DDS drops the answer to a client that the node has not discovered: 1 of 60 first calls."""
    from rclpy.parameter_client import AsyncParameterClient
    from rclpy.task import Future

    from estimator_pkg.bags import live

    ask, lost = AsyncParameterClient.get_parameters, [Future()]

    def first_lost(self, names):
        future = ask(self, names)
        return lost.pop() if lost else future

    monkeypatch.setattr(AsyncParameterClient, 'get_parameters', first_lost)
    monkeypatch.setattr(live, 'ANSWER_WAIT', 2.0)
    with dds.NodeProcess('estimator_pkg.nodes.executables joint_observer') as process:
        process.prints(' estimates ')
        assert parameter('/joint_observer', 'timeout') == 0.5


def test_an_interrupt_before_the_first_message_is_no_missing_topic(monkeypatch):
    def nothing(parsed):
        raise UserError('nothing was recorded')

    monkeypatch.setattr('estimator_pkg.bags.record.run', nothing)
    with pytest.raises(UserError), recorded(['/a'], '/b', 1.0):
        pass
    monkeypatch.setattr('estimator_pkg.interrupts.came', lambda: signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), recorded(['/a'], '/b', 1.0):
        pass


def never(parsed):
    raise AssertionError('it was recorded before the node was asked')


def test_it_records_tunes_and_sets_only_when_asked(tmp_path, monkeypatch, capfd):
    out, result = tmp_path / 'gains.yaml', tmp_path / 'result.json'
    words = [
        *shlex.split('tune --live 4 --observer pll'),
        '--out',
        str(out),
        '--trials',
        '8',
        '--json',
        str(result),
        '--truth',
        '/ground_truth/joint_states',
    ]
    with (
        dds.NodeProcess(
            'sim_pkg.nodes.executables encoder_sim',
            *shlex.split('--ros-args -p profile:=sine -p rate:=500.0'),
        ),
        dds.NodeProcess(
            'estimator_pkg.nodes.executables joint_observer',
            *shlex.split('--ros-args -p observer:=pll -p bandwidth_hz:=7.0'),
        ),
    ):
        with dds.NodeProcess('estimator_pkg.cli', *words) as tuning:
            tuning.prints('gains: ')
            tuning.prints('gains: ')
        assert parameter('/joint_observer', 'bandwidth_hz') == pytest.approx(7.0)
        with dds.NodeProcess('estimator_pkg.cli', *words, '--apply', 'joint_observer') as tuning:
            tuning.prints('set on joint_observer: bandwidth_hz: 7 -> ')  # not from the default
        with pytest.raises(UserError, match=r"runs pll, and .* start it with 'observer: kalman'"):
            apply('joint_observer', {'bandwidth_hz': 5.0}, 'kalman')
        monkeypatch.setattr('estimator_pkg.bags.record.run', never)
        other = [*words[:3], '--observer', 'kalman', *words[5:], '--apply', 'joint_observer']
        capfd.readouterr()
        assert main(other) == 1
        line = capfd.readouterr().err
        assert 'runs pll' in line and line.count('\n') == 1
        assert main([*other[:-1], 'nobody']) == 1
        assert "no node '/nobody'" in capfd.readouterr().err
        (found,) = json.loads(result.read_text())['tuned']
        wanted = (found['gains'] or found['default_gains'])['bandwidth_hz']
        assert params_file.load(out).get('bandwidth_hz', 50.0) == pytest.approx(wanted, rel=1e-6)
        assert parameter('/joint_observer', 'bandwidth_hz') == pytest.approx(wanted, rel=1e-6)
        assert wanted != pytest.approx(7.0)
