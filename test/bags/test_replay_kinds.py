# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Every kind of observer through replay and `evaluate --observer`: the same estimates."""

import json
from pathlib import Path

import pytest

from estimator_pkg import cli, observers, registry, streams
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.joint_state import TYPE, Encoder

STATES = '/joint_states'
DRIVES = Path(__file__).resolve().parents[2] / 'bags' / 'simulated'
MOTOR = ['resistance=0.06', 'inductance=33.75e-6', 'flux=1.9e-3', 'pole_pairs=7']


def run(*words, code=0):
    assert cli.main([str(word) for word in words]) == code


def result_of(tmp_path, *words, code=0):
    run(*words, '--json', tmp_path / 'result.json', code=code)
    return json.loads((tmp_path / 'result.json').read_text())


def settings(*pairs):
    return [word for pair in pairs for word in ('--set', pair)]


# ---------------------------------------------------------------- evaluate equals replay


def evaluated(tmp_path, bag, *words):
    (found,) = result_of(tmp_path, 'evaluate', bag, *words)['bags'].values()
    return found['estimates']


def same_rows(tmp_path, bag, observer, *words):
    """`evaluate --observer` gives the rows that `evaluate` gives of the replayed bag."""
    run('replay', bag, '--observer', observer, *words, '--out', tmp_path / 'replayed')
    (reported,) = evaluated(tmp_path, tmp_path / 'replayed').values()
    direct = evaluated(tmp_path, bag, '--observer', observer, *words)[observer]
    assert direct['joints'].keys() == reported['joints'].keys()
    for joint, row in direct['joints'].items():
        assert row['velocity'] == reported['joints'][joint]['velocity']
        assert row['matched'] == reported['joints'][joint]['matched']
        assert row['coverage_95'] == reported['joints'][joint]['coverage_95']
        assert row['samples']['received'] > 0 and row['validity_s']['tracking'] > 0.0
    return direct


def test_a_system_that_does_not_switch_in_the_bag(tmp_path, capsys):
    """Its topic of events is there, and empty."""
    run('simulate', 'gripper', '--duration', 1, '--set', 'rate=400', '--out', tmp_path / 'still')
    assert result_of(tmp_path, 'replay', tmp_path / 'still', '--observer', 'switched')
    assert 'no message on /switch_event: the system never switches' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('bag', 'observer', 'words'),
    [
        ('dc_motor --duration 6 --set rate=500', 'adaptive', ()),
        ('gripper --duration 3 --set rate=400', 'switched', ('quantum=9.6e-5',)),
        (DRIVES / 'drive_profile', 'pmsm', MOTOR),
    ],
)
def test_evaluate_gives_the_rows_of_replay(bag, observer, words, tmp_path):
    if isinstance(bag, str):
        run('simulate', *bag.split(), '--out', tmp_path / 'bag')
        bag = tmp_path / 'bag'
    rows = same_rows(tmp_path, bag, observer, *settings(*words))
    assert observer != 'pmsm' or set(rows['joints']) == {'motor', 'motor_electrical'}


def test_evaluate_wheels(tmp_path, capsys):
    """A wheel slips once."""
    words = settings('radius=[0.1]', 'track=0.52', 'gyro_topic=imu')
    bag = DRIVES / 'base_with_slip'
    rows = same_rows(tmp_path, bag, 'wheel_odometry', *words)
    assert {row['velocity']['rms'] < 0.06 for row in rows['joints'].values()} == {True}
    said = capsys.readouterr().out
    assert '; contradictions 1; now: wheels and gyro contradict' in said


def test_mechanical_stands_beside_angle_observers(tmp_path):
    """The parameter file names one observer; its gains are not those of the other."""
    run('simulate', 'pendulum', '--duration', 2, '--set', 'rate=500', '--out', tmp_path / 'bag')
    params = tmp_path / 'params.yaml'
    model = '[inertia=0.05, damping=0.02, gravity=1.5, coulomb=0.05]'
    params.write_text(
        '/**:\n  ros__parameters:\n    observer: geso\n    bandwidth_hz: 5.0\n'
        f'    model_parameters: {model}\n'
    )
    words = ['--observer', 'geso', '--observer', 'pll', '--params', params]
    rows = evaluated(tmp_path, tmp_path / 'bag', *words)
    geso, pll = (rows[name]['joints']['joint']['velocity']['rms'] for name in ('geso', 'pll'))
    assert geso < 0.5 * pll
    assert rows['pll'] == evaluated(tmp_path, tmp_path / 'bag', '--observer', 'pll')['pll']


# ---------------------------------------------------------------- what a kind is


def test_a_damaged_input_is_not_taken_for_a_measurement(tmp_path):
    encode = Encoder().encode
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(STATES, TYPE)
        bag.add_topic('/effort_command', TYPE)
        for i in range(1, 101):
            raw = encode(i * 10**7, '', ['joint'], [0.01 * i], [], [0.1])
            bag.write(STATES, i * 10**7, raw if i > 1 else b'bad')
            bag.write('/effort_command', i * 10**7, raw if i % 4 else b'bad')
    found = result_of(
        tmp_path,
        'replay',
        tmp_path / 'bag',
        '--observer',
        'geso',
        *settings('input=effort_command', 'joints=[joint]'),
    )['messages']
    assert (found['received'], found['used'], found['inputs_malformed']) == (100, 99, 25)
    assert found['dropped'] == {'malformed': 1}


@pytest.mark.parametrize(
    'own, expected', [([], 1), (settings('model_parameters=[inertia=0.1]'), 0)]
)
def test_the_default_numbers_of_a_model_are_reported_once(own, expected, tmp_path, capsys):
    encode = Encoder().encode
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(STATES, TYPE)
        for now in range(10**9, 2 * 10**9, 10**7):
            bag.write(STATES, now, encode(now, '', ['joint'], [0.1], [], [0.0]))
    run('replay', tmp_path / 'bag', '--observer', 'smo', *own)
    said = capsys.readouterr().err
    assert said.count("'mechanism' has the default model_parameters of single_joint") == expected
    assert said.count('inertia=0.1') == said.count('velocity_estimator identify') == expected
    settings_of = streams.mechanical.MechanicalSettings()
    values = {'model_parameters': ('inertia=0.1',)} if own else {}
    kind = streams.mechanical.MechanicalStream
    live = kind(settings_of, kind.configure(settings_of.find_observer(), settings_of, values, {}))
    assert len(live.notices()) == expected and live.notices() == []


def test_every_observer_has_a_kind():
    for name in registry.names(registry.OBSERVERS):
        stream = streams.of_observer(name)
        assert set(observers.find(name).gains.__dataclass_fields__) <= set(stream.parameters(name))
