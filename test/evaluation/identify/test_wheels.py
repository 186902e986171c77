# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Radii and track of simulated bases, by a gyro and by two loops."""

import json
from functools import cache

import pytest

from estimator_pkg import cli, params_file

BASE = {'track': 0.52, 'radius': 0.1, 'radius_difference': 0.01, 'travel_noise': 0.001}
TRUE = {'radius_left': 0.0995, 'radius_right': 0.1005, 'track': 0.52}


def run(*words):
    return cli.main([str(word) for word in words])


DRIVES = {
    'gyro': (),
    'loops': ('loop=12',),
    'late': ('gyro_delay=0.05', 'slip=0.5', 'turn_mean=0.1'),
    'skid': ('base=skid', 'slip_factor=1.5', 'counts_per_revolution=512'),
    'short': (),
    'open': ('travel_noise=0',),
}


@pytest.fixture(scope='module')
def drive_of(tmp_path_factory):
    """(name) -> the bag of a drive, made when it is first used."""

    @cache
    def made(name):
        bag = tmp_path_factory.mktemp('drives') / name
        sets = [f'--set={key}={value}' for key, value in BASE.items()]
        sets += [f'--set={word}' for word in DRIVES[name]]
        seconds = 12 if name == 'short' else 60
        assert run('simulate', 'base', '--out', bag, '--duration', seconds, *sets) == 0
        return bag

    return made


CASES = {
    'a known track': ('gyro', ('--set=track=0.52',)),
    'loops of known length': ('loops', ('--loops', '--distance=12')),
    'two circles with a gyro': ('loops', ('--set=track=0.52',)),
    'a late gyro, and slip': ('late', ('--set=track=0.52',)),
    'skid steering': (
        'skid',
        (
            '--set=track=0.78',
            '--set=wheels_left=[wheel_left_joint, rear_left_joint]',
            '--set=wheels_right=[wheel_right_joint, rear_right_joint]',
        ),
    ),
}


@pytest.mark.long
@pytest.mark.parametrize(
    'case', [pytest.param(case, marks=pytest.mark.slow if 'skid' in case else ()) for case in CASES]
)
def test_within_1_percent_and_its_deviations(case, drive_of, tmp_path):
    drive, words = CASES[case]
    out, result = tmp_path / 'base.yaml', tmp_path / 'result.json'
    words = (*words, '--out', out, '--json', result)
    assert run('identify', drive_of(drive), '--model', 'wheel_odometry', *words) == 0
    found = json.loads(result.read_text())
    for name, true in TRUE.items():
        true *= 1.5 if drive == 'skid' and name == 'track' else 1.0
        assert found['values'][name] == pytest.approx(true, rel=0.01)
        off = abs(found['values'][name] - true)
        assert off <= 4.0 * found['stddev'][name] + 1e-6 * true, (name, found)
    values = params_file.load(out, 'wheel_odometry')
    assert values['radius'] == pytest.approx([TRUE['radius_left'], TRUE['radius_right']], rel=0.01)
    if case == 'a known track':
        words = ('--params', out, '--set=gyro_topic=imu', '--out', tmp_path / 'replayed')
        assert run('replay', drive_of(drive), '--observer', 'wheel_odometry', *words) == 0


@pytest.mark.parametrize(
    ('drive', 'words', 'said'),
    [
        ('gyro', (), 'set one length'),
        ('gyro', ('--set=track=0.5', '--distance=3'), 'set one length'),
        ('gyro', ('--set=track=0.5', '--loops'), 'one to the left and one to the right'),
        ('gyro', ('--set=track=0.5', '--set=gyro_ratio=-1.0'), 'the sign of'),
        ('gyro', ('--set=track=0.5', '--set=gyro_topic=gyro'), '/gyro'),
        ('gyro', ('--set=track=0.5', '--set=wheels_left=[wheel_lef_joint]'), 'wheel_left_joint'),
        ('gyro', ('--set=track=0.5', '--joint=wheel_left_joint'), '--joint and --start'),
        ('short', ('--set=track=0.5',), 'record a drive of'),
        ('open', ('--loops', '--distance=12'), 'of its length from its start'),
    ],
)
def test_what_identifies_nothing_is_one_line(drive, words, said, drive_of, capsys):
    bag = drive_of(drive)
    capsys.readouterr()
    assert run('identify', bag, '--model', 'wheel_odometry', *words) != 0
    text = capsys.readouterr().err.strip()
    assert said in text and '\n' not in text, text


def test_loops_are_of_a_base_alone(drive_of, capsys):
    assert run('identify', drive_of('gyro'), '--loops') == 2
    assert '--loops and --distance are for --model wheel_odometry' in capsys.readouterr().err
