"""identify: the numbers of a single joint from recordings, and from what cannot tell them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from estimator_pkg import cli

RECORDINGS = Path(__file__).parent.parent / 'bags'
TRUE = {'inertia': 0.05, 'damping': 0.02, 'coulomb': 0.05, 'gravity': 1.5, 'hanging': 0.0,
        'bias': 0.0, 'input_delay': 0.0}


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp('identify') / 'bag'
    assert cli.main(['simulate', 'pendulum', '--duration', '12', '--seed', '4', '--out',
                     str(path)]) == 0
    return path


def test_numbers_of_a_simulated_joint_are_found_within_their_deviations(recording, tmp_path):
    out, told = tmp_path / 'joint.yaml', tmp_path / 'found.json'
    assert cli.main(['identify', str(recording), '--model', 'single_joint', '--out', str(out),
                     '--json', str(told)]) == 0
    found = json.loads(told.read_text())
    for name, true in TRUE.items():
        assert abs(found['values'][name] - true) < 4.0 * found['stddev'][name], name
        assert found['stddev'][name] < 0.02
    assert found['explained_elsewhere'] > 0.999
    assert cli.main(['replay', str(recording), '--observer', 'geso', '--params', str(out)]) == 0


def test_torque_constant_and_gear_are_taken_as_given(recording, tmp_path):
    told = tmp_path / 'found.json'
    assert cli.main(['identify', str(recording), '--json', str(told), '--set',
                     'torque_constant=0.5', '--set', 'gear_ratio=4']) == 0
    assert json.loads(told.read_text())['values']['inertia'] == pytest.approx(0.1, rel=0.01)


def test_recorded_joint_is_found_near_what_its_makers_say(tmp_path):
    """J about 0.16 kg m^2 and m g l about 3.2 N m; too short a record to be sure of either."""
    told = tmp_path / 'found.json'
    path = RECORDINGS / 'dfki_simple_pendulum/system_identification_300hz'
    assert cli.main(['identify', str(path), '--json', str(told)]) == 0
    found = json.loads(told.read_text())
    assert abs(found['values']['inertia'] - 0.16) < found['stddev']['inertia'] < 0.1
    assert abs(found['values']['gravity'] - 3.2) < found['stddev']['gravity'] < 2.0


@pytest.mark.parametrize('words, message', [
    (['--model', 'cart_pendulum'], "knows the model single_joint, not 'cart_pendulum'"),
    (['--joint', 'jiont'], "did you mean 'joint'?"),
    (['--set', 'inertia=1'], "'inertia' is not given but identified"),
    (['--set', 'torque_constant=x'], 'must be a number')])
def test_wrong_use_is_told_in_one_line(recording, words, message, capsys):
    capsys.readouterr()
    assert cli.main(['identify', str(recording), *words]) in (1, 2)
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


@pytest.mark.parametrize('bag, message', [
    ('simulated/sine_12bit', 'has no efforts'),
    ('dfki_double_pendulum/sys_id_500hz', 'name one with --joint (shoulder, elbow)'),
    ('dfki_simple_pendulum/gravity_compensation_1000hz', 'do not belong together')])
def test_recordings_that_cannot_tell_are_refused_in_one_line(bag, message, capsys):
    assert cli.main(['identify', str(RECORDINGS / bag)]) in (1, 2)
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_nothing_is_overwritten(recording, tmp_path, capsys):
    out = tmp_path / 'joint.yaml'
    out.write_text('mine')
    assert cli.main(['identify', str(recording), '--out', str(out)]) == 1
    assert out.read_text() == 'mine'
