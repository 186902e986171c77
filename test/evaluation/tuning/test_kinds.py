# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""tune for observers that need more than an angle, and what is true of all kinds."""

from pathlib import Path

import pytest
from tune_runs import fails, held, tuned, write_bag

from estimator_pkg import params_file
from estimator_pkg.cli import main
from estimator_pkg.evaluation.entries import angle_observers

pytest.importorskip('optuna', reason='not run: Optuna is not installed')

DRIVES = Path(__file__).resolve().parents[3] / 'bags' / 'simulated'
MODEL = '[inertia=0.05, damping=0.02, gravity=1.5, coulomb=0.05]'


def run(*words):
    assert main([str(word) for word in words]) == 0


@pytest.fixture(scope='module')
def pendulum(tmp_path_factory):
    path = tmp_path_factory.mktemp('tune') / 'bag'
    run('simulate', 'pendulum', '--duration', 2, '--set', 'rate=200', '--out', path)
    return path


def test_gains_that_change_nothing_are_left_alone(pendulum, tmp_path, capsys):
    fixed = held(f'model_parameters={MODEL}', 'L=[60.0]', 'K=[900.0]')
    found, out = tuned(tmp_path, pendulum, '--observer', 'hgo', '--trials', 12, *fixed)
    (each,) = found['tuned']
    assert each['idle'] == ['bandwidth_hz', 'damping'] and 'disturbance_hz' in each['tried']
    values = params_file.load(out, 'mechanical_observer')
    assert 'bandwidth_hz' not in values
    assert values.get('disturbance_hz', 0.0) == pytest.approx(
        each['gains'].get('disturbance_hz', 0.0), rel=1e-5
    )
    assert "'damping' has no effect" in out.read_text()
    assert "'damping' has no effect" in capsys.readouterr().out


def test_an_adaptive_observer(tmp_path):
    run('simulate', 'dc_motor', '--duration', 4, '--set', 'rate=200', '--out', tmp_path / 'bag')
    words = ['--observer', 'adaptive', '--trials', 3, '--joint', 'joint']
    found, out = tuned(tmp_path, tmp_path / 'bag', *words)
    assert set(found['tuned'][0]['tried']) == {'bandwidth_hz'}
    run('replay', tmp_path / 'bag', '--observer', 'adaptive', '--params', out)


def test_a_drive(tmp_path):
    motor = held('resistance=0.06', 'inductance=33.75e-6', 'flux=1.9e-3', 'pole_pairs=7')
    judge = DRIVES / 'drive_profile'
    words = ['--judge', judge, '--observer', 'pmsm', '--trials', 6]
    found, out = tuned(tmp_path, DRIVES / 'drive_startup', *words, *motor)
    (each,) = found['tuned']
    assert set(each['tried']) == {'relative_bandwidth', 'speed_filter_hz'}
    assert set(each['best']['by_joint']) == {'motor', 'motor_electrical'}
    assert each['judged_on'] == [str(judge)]
    values = params_file.load(out, 'pmsm_observer')
    assert values['observer'] == 'pmsm' and values['flux'] == 1.9e-3
    run('replay', judge, '--params', out)


def test_a_choice_is_searched_too(tmp_path):
    bag = write_bag(tmp_path / 'bag', {'a': 1.0}, seconds=2.0)
    words = ['--search', 'prefer=fast|balanced', '--prefer', 'fast', '--trials', 8]
    found, out = tuned(tmp_path, bag, '--observer', 'edge_adaptive', *words)
    assert found['tuned'][0]['tried']['prefer'] in ('fast', 'balanced')
    assert params_file.load(out)['observer'] == 'edge_adaptive'


@pytest.mark.parametrize('observer', angle_observers())
def test_every_observer_of_an_angle_has_a_search_range(observer, tmp_path):
    bag = write_bag(tmp_path / 'bag', {'a': 1.0}, seconds=1.0)
    found, out = tuned(tmp_path, bag, '--observer', observer, '--trials', 2)
    assert found['tuned'][0]['tried']
    assert params_file.load(out)['observer'] == observer


def test_bags_with_different_joints(tmp_path, capsys):
    (tmp_path / 'bags').mkdir()
    one = write_bag(tmp_path / 'bags' / 'one', {'hip': 1.0, 'knee': 1.0}, seconds=2.0)
    other = write_bag(tmp_path / 'bags' / 'other', {'knee': 1.0, 'ankle': 1.0}, seconds=2.0)
    words = ['--observer', 'pll', '--trials', 4]
    found, _ = tuned(tmp_path, tmp_path / 'bags', *words)
    assert found['tuned'][0]['joints'] == ['ankle', 'hip', 'knee']
    found, out = tuned(tmp_path, tmp_path / 'bags', *words, '--per-joint')
    by_joint = {each['joint']: each['bags'] for each in found['tuned']}
    assert by_joint == {'hip': [one], 'knee': [one, other], 'ankle': [other]}
    _, overrides = params_file.split(params_file.load(out))
    assert set(overrides) == {'hip', 'knee', 'ankle'}
    words += ['--out', tmp_path / 'g.yaml']
    line = fails(capsys, one, other, *words, '--joint', 'hip')
    assert "no joint 'hip'; it has ankle, knee" in line
    line = fails(capsys, one, '--judge', other, *words, '--per-joint')
    assert "no recording of --judge has a joint 'hip'" in line


@pytest.mark.parametrize('words', [['--per-joint'], ['--joint', 'joint']])
def test_a_mechanism_has_no_gains_by_joint(words, pendulum, tmp_path, capsys):
    words = ['--observer', 'geso', *words, '--out', tmp_path / 'g.yaml']
    assert 'estimates its joints together' in fails(capsys, pendulum, *words, code=2)
