# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""tune for observers that need more than an angle, and what is true of all kinds."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import dds
import pytest

from estimator_pkg import params_file
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.entries import angle_observers
from estimator_pkg.evaluation.tuning.search import search
from estimator_pkg.messages.joint_state import TYPE, Encoder

optuna = pytest.importorskip('optuna', reason='not run: Optuna is not installed')
RANGE = optuna.distributions.FloatDistribution(1.0, 100.0, log=True)

DRIVES = Path(__file__).resolve().parents[3] / 'bags' / 'simulated'
MODEL = '[inertia=0.05, damping=0.02, gravity=1.5, coulomb=0.05]'


def run(*words, code=0):
    assert main([str(word) for word in words]) == code


def tuned(tmp_path, *words):
    out = tmp_path / 'gains.yaml'
    run('tune', *words, '--out', out, '--json', tmp_path / 'result.json')
    return json.loads((tmp_path / 'result.json').read_text()), out


def fails(capsys, *words, code=1):
    capsys.readouterr()
    run('tune', *words, code=code)
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


def held(*pairs):
    return [word for pair in pairs for word in ('--set', pair)]


@pytest.fixture(scope='module')
def pendulum(tmp_path_factory):
    path = tmp_path_factory.mktemp('tune') / 'bag'
    run('simulate', 'pendulum', '--duration', 4, '--set', 'rate=200', '--out', path)
    return path


# ---------------------------------------------------------------- kind by kind


@pytest.mark.slow
def test_a_mechanical_observer_whatever_the_workers(pendulum, tmp_path):
    """Gains that beat the defaults on what was held out; the same from 1 and 3 processes."""
    params = tmp_path / 'model.yaml'
    params.write_text(f'/**:\n  ros__parameters:\n    model_parameters: {MODEL}\n')
    texts = []
    for jobs in (1, 3):
        found, out = tuned(
            tmp_path,
            pendulum,
            '--observer',
            'geso',
            '--params',
            params,
            '--trials',
            12,
            '--jobs',
            jobs,
        )
        texts.append(out.read_text())
    assert texts[0] == texts[1]
    (each,) = found['tuned']
    assert each['held_out'] and each['best']['cost'] < 0.6 * each['default']['cost']
    values = params_file.load(out, 'mechanical_observer')
    assert values['observer'] == 'geso' and values['bandwidth_hz'] < 10.0
    # the file is what replay and the node take
    run('replay', pendulum, '--params', out, '--json', tmp_path / 'replayed.json')
    replayed = json.loads((tmp_path / 'replayed.json').read_text())
    assert replayed['observer'] == 'geso' and replayed['messages']['estimates'] > 500


def test_gains_that_change_nothing_are_left_alone(pendulum, tmp_path, capsys):
    found, out = tuned(
        tmp_path,
        pendulum,
        '--observer',
        'hgo',
        '--trials',
        12,
        *held(f'model_parameters={MODEL}', 'L=[60.0]', 'K=[900.0]'),
    )
    (each,) = found['tuned']
    assert each['idle'] == ['bandwidth_hz', 'damping'] and 'disturbance_hz' in each['tried']
    values = params_file.load(out, 'mechanical_observer')
    assert 'bandwidth_hz' not in values
    assert values.get('disturbance_hz', 0.0) == pytest.approx(
        each['gains'].get('disturbance_hz', 0.0), rel=1e-5
    )
    assert "'damping' has no effect" in out.read_text()
    assert "'damping' has no effect" in capsys.readouterr().out


def test_the_adaptive_node_takes_the_file_unchanged(probe, tmp_path):
    run('simulate', 'dc_motor', '--duration', 9, '--set', 'rate=300', '--out', tmp_path / 'bag')
    found, out = tuned(
        tmp_path, tmp_path / 'bag', '--observer', 'adaptive', '--trials', 6, '--joint', 'joint'
    )
    gain = found['tuned'][0]['gains']['bandwidth_hz']
    assert set(params_file.load(out, 'adaptive_observer')) == {'bandwidth_hz'}
    with (
        dds.NodeProcess(
            'estimator_pkg.nodes.executables adaptive_observer',
            '--ros-args',
            '--params-file',
            str(out),
        ) as process,
        dds.Observer(probe, '/adaptive_observer', '/joint_states') as node,
    ):
        node.connect()
        assert node.get('bandwidth_hz') == pytest.approx(gain, rel=1e-5)
    assert 'Traceback' not in process.output


def test_a_drive(tmp_path):
    found, out = tuned(
        tmp_path,
        DRIVES / 'drive_startup',
        '--judge',
        DRIVES / 'drive_profile',
        '--observer',
        'pmsm',
        '--trials',
        6,
        *held('resistance=0.06', 'inductance=33.75e-6', 'flux=1.9e-3', 'pole_pairs=7'),
    )
    (each,) = found['tuned']
    assert set(each['tried']) == {'relative_bandwidth', 'speed_filter_hz'}
    assert set(each['best']['by_joint']) == {'motor', 'motor_electrical'}
    assert each['judged_on'] == [str(DRIVES / 'drive_profile')]
    values = params_file.load(out, 'pmsm_observer')
    assert values['observer'] == 'pmsm' and values['flux'] == 1.9e-3
    run('replay', DRIVES / 'drive_profile', '--params', out)


@pytest.mark.slow
def test_a_switched_system(tmp_path):
    run('simulate', 'gripper', '--duration', 3, '--set', 'rate=200', '--out', tmp_path / 'bag')
    found, out = tuned(tmp_path, tmp_path / 'bag', '--observer', 'switched', '--trials', 8)
    (each,) = found['tuned']
    assert each['best']['cost'] <= each['default']['cost']
    assert set(params_file.load(out, 'switched_observer')) == {'bandwidth_hz'}


def test_a_choice_is_sought_too(tmp_path):
    bag = write_bag(tmp_path / 'bag', ['a'])
    found, out = tuned(tmp_path, bag, '--observer', 'edge_adaptive', '--trials', 4)
    assert found['tuned'][0]['tried']['prefer'] in ('smooth', 'balanced', 'fast')
    assert params_file.load(out)['observer'] == 'edge_adaptive'
    found, _ = tuned(
        tmp_path,
        bag,
        '--observer',
        'edge_adaptive',
        '--trials',
        4,
        '--search',
        'prefer=fast|balanced',
        '--prefer',
        'fast',
    )
    assert found['tuned'][0]['tried']['prefer'] in ('fast', 'balanced')


@pytest.mark.parametrize('observer', angle_observers())
def test_every_observer_of_an_angle(observer, tmp_path):
    """Each says itself what is worth seeking."""
    bag = write_bag(tmp_path / 'bag', ['a'], seconds=1.0)
    found, out = tuned(tmp_path, bag, '--observer', observer, '--trials', 2)
    assert found['tuned'][0]['tried']
    assert params_file.load(out)['observer'] == observer


# ---------------------------------------------------------------- recordings, studies


def write_bag(path, joints, seconds=2.0, rate=400.0):
    """Joints that swing at 1 Hz, with their truth."""
    import math

    states, true = Encoder(), Encoder()
    with BagWriter(path) as bag:
        for topic in ('/joint_states', '/ground_truth/joint_states'):
            bag.add_topic(topic, TYPE)
        for k in range(1, int(seconds * rate)):
            stamp, phase = 10**18 + round(k * 1e9 / rate), 2.0 * math.pi * k / rate
            angle = round(-math.cos(phase) * 4096 / math.tau) * math.tau / 4096
            bag.write(
                '/joint_states', stamp, states.encode(stamp, '', joints, [angle] * len(joints))
            )
            bag.write(
                '/ground_truth/joint_states',
                stamp,
                true.encode(
                    stamp,
                    '',
                    joints,
                    [-math.cos(phase)] * len(joints),
                    [math.tau * math.sin(phase)] * len(joints),
                ),
            )
    return str(path)


def test_bags_with_different_joints(tmp_path, capsys):
    (tmp_path / 'bags').mkdir()
    one = write_bag(tmp_path / 'bags' / 'one', ['hip', 'knee'])
    other = write_bag(tmp_path / 'bags' / 'other', ['knee', 'ankle'])
    words = ['--observer', 'pll', '--trials', 4]
    found, _ = tuned(tmp_path, tmp_path / 'bags', *words)
    assert found['tuned'][0]['joints'] == ['ankle', 'hip', 'knee']
    assert 'the bags have different joints (ankle, knee; hip, knee)' in capsys.readouterr().out
    found, out = tuned(tmp_path, tmp_path / 'bags', *words, '--per-joint')
    by_joint = {each['joint']: each['bags'] for each in found['tuned']}
    assert by_joint == {'hip': [one], 'knee': [one, other], 'ankle': [other]}
    _, overrides = params_file.split(params_file.load(out))
    assert set(overrides) == {'hip', 'knee', 'ankle'}
    line = fails(capsys, one, other, *words, '--joint', 'hip', '--out', tmp_path / 'g.yaml')
    assert "no joint 'hip'; it has ankle, knee" in line
    line = fails(capsys, one, '--judge', other, *words, '--per-joint', '--out', tmp_path / 'g.yaml')
    assert "no recording of --judge has a joint 'hip'" in line


def test_a_study_of_something_else_is_not_gone_on(tmp_path, capsys):
    bag = write_bag(tmp_path / 'bag', ['a'])
    words = [
        '--storage',
        f'sqlite:///{tmp_path}/study.db',
        '--trials',
        4,
        '--out',
        tmp_path / 'gains.yaml',
    ]
    run('tune', bag, '--observer', 'pll', *words)
    run('tune', bag, '--observer', 'pll', *words)
    assert '--study needs --storage' in fails(
        capsys, bag, '--study', 'mine', '--out', tmp_path / 'gains.yaml', code=2
    )
    for changed in (['--observer', 'hybrid_angle'], ['--observer', 'pll', '--prefer', 'fast']):
        assert '--study' in fails(capsys, bag, *changed, *words)
    run('tune', bag, '--observer', 'pll', '--prefer', 'fast', '--study', 'other', *words)


def test_a_storage_that_breaks_on_the_way(tmp_path):
    database = tmp_path / 'study.db'

    def judge(batch):
        database.write_bytes(b'no database any more' * 1000)
        return [(1.0, None) for _ in batch]

    with pytest.raises(UserError, match='cannot be used'):
        search({'a': RANGE}, {'a': 1.5}, judge, 16, storage=f'sqlite:///{database}')


def test_dropped_gains_stay_dropped_in_a_study_that_goes_on(tmp_path):
    plane = {'a': RANGE, 'b': RANGE}
    storage = f'sqlite:///{tmp_path}/study.db'
    for trials in (16, 8):
        found = search(
            plane,
            {'a': 5.0, 'b': 5.0},
            lambda batch: [(each['a'], None) for each in batch],
            trials,
            storage=storage,
            same=lambda one, other: one.cost == other.cost,
        )
        assert found.idle == ['b']
        assert all('b' not in trial.values for trial in found.trials[8:])
    assert len(found.trials) == 24


# ---------------------------------------------------------------- Ctrl-C with workers


@pytest.mark.slow
def test_ctrl_c_with_workers_keeps_the_best(tmp_path):
    """Every process of the terminal gets the signal."""
    bag = write_bag(tmp_path / 'bag', ['a'], seconds=4.0)
    out = tmp_path / 'gains.yaml'
    storage = tmp_path / 'study.db'
    child = subprocess.Popen(
        [
            sys.executable,
            '-m',
            'estimator_pkg.cli',
            'tune',
            bag,
            *shlex.split('--observer pll --jobs 2 --trials 4000'),
            '--out',
            str(out),
            '--storage',
            f'sqlite:///{storage}',
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    end = time.monotonic() + 60.0
    while completed(storage) < 16 and time.monotonic() < end and child.poll() is None:
        time.sleep(0.1)
    os.killpg(child.pid, signal.SIGINT)
    said, errors = child.communicate(timeout=60)
    assert child.returncode == 0, errors
    assert 'interrupted' in said and 'Traceback' not in errors
    assert params_file.load(out)['observer'] == 'pll'
    assert 'interrupted' in out.read_text()


def completed(database):
    import sqlite3

    if not database.exists():
        return 0
    with sqlite3.connect(f'file:{database}?mode=ro', uri=True) as connection:
        try:
            return connection.execute(
                "select count(*) from trials where state = 'COMPLETE'"
            ).fetchone()[0]
        except sqlite3.OperationalError:
            return 0


# ---------------------------------------------------------------- errors, one line each


@pytest.mark.parametrize(
    ('words', 'said', 'code'),
    [
        (['--observer', 'geso', '--per-joint'], 'estimates its joints together', 2),
        (['--observer', 'geso', '--joint', 'joint'], '--joint', 2),
        (['--observer', 'geso', *held('modle=x')], "did you mean 'model'?", 2),
        (['--observer', 'geso', *held('model=nowhere:X')], "cannot import 'nowhere'", 2),
        (['--observer', 'pmsm'], 'pmsm needs the motor data', 2),
        (['--observer', 'all'], 'tuning needs one', 2),
        (['--observer', 'pll', '--search', 'low_speed_bound=0:1'], 'a number or a choice', 2),
        (['--observer', 'edge_adaptive', '--search', 'prefer=fast|slow'], 'is not one of', 2),
    ],
)
def test_wrong_use(words, said, code, pendulum, tmp_path, capsys):
    line = fails(capsys, pendulum, *words, '--out', tmp_path / 'g.yaml', code=code)
    assert said in line
    assert not (tmp_path / 'g.yaml').exists()


def test_a_recording_cannot_judge_itself(pendulum, tmp_path, capsys):
    assert 'the gains are tuned on this recording' in fails(
        capsys,
        pendulum,
        '--judge',
        pendulum,
        '--observer',
        'pll',
        '--out',
        tmp_path / 'g.yaml',
        code=2,
    )
