# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags in which the stamps jump back: a loop that was recorded, and two recordings joined."""

import json
import math

import numpy as np
import pytest

from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main
from estimator_pkg.messages import drive_samples, joint_state, vector3

TURN = 2.0 * math.pi
START = 1_700_000_000_000_000_000
RATE, SECONDS = 200.0, 6.0
ANGLE = '/imu/tilt:vector.x'
MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
DATA = [word for name, value in MOTOR.items() for word in ('--set', f'{name}={value}')]


def slow(t):
    return 1.5 * np.sin(TURN * 0.4 * t)


def fast(t):
    return np.sin(TURN * 1.1 * t)


def looped(motion=slow):
    """The second half of a recording, and then the first."""
    t = np.arange(int(RATE * SECONDS)) / RATE
    half = len(t) // 2
    t = np.r_[t[half:], t[:half]]
    return t, motion(t)


def joined():
    """Two recordings, the longer second; the clock starts again at the same time."""
    first, second = np.arange(400) / RATE, np.arange(800) / RATE
    return np.r_[first, second], np.r_[fast(first), slow(second)]


def written(path, t, angle, topic='/joint_states'):
    """A bag of two joints, or of a number in other messages."""
    encode = joint_state.Encoder().encode
    with BagWriter(path) as bag:
        of_joints = topic == '/joint_states'
        bag.add_topic(topic, joint_state.TYPE if of_joints else vector3.TYPE)
        stamps = START + np.rint(1e9 * t).astype(np.int64)
        for k, (stamp, y) in enumerate(zip(stamps.tolist(), np.round(angle, 4).tolist())):
            raw = (
                encode(stamp, '', ['elbow', 'wrist'], [y, round(0.5 * y, 4)])
                if of_joints
                else vector3.encode(stamp, '', y, 0.0)
            )
            bag.write(topic, START + round(1e9 * k / RATE), raw)
    return str(path)


def doctor(tmp_path, *words):
    """Exit code and result of the command."""
    code = main(['doctor', *words, '--json', str(tmp_path / 'r.json')])
    return code, json.loads((tmp_path / 'r.json').read_text())


def checks(result, joint):
    return {each['check']: each for each in result['joints'][joint]['findings']}


@pytest.mark.long
@pytest.mark.parametrize('record', [looped, joined])
@pytest.mark.parametrize('angle', ['', ANGLE])
def test_one_run_is_judged_and_the_order_fails(record, angle, tmp_path, capsys):
    topic = angle.partition(':')[0] or '/joint_states'
    path = written(tmp_path / 'bag', *record(), topic)
    code, result = doctor(tmp_path, path, *(['--angle', angle] if angle else []))
    assert code == 1
    for joint in ['joint'] if angle else ['elbow', 'wrist']:
        found = checks(result, joint)
        assert found['order of stamps']['level'] == 'FAIL'
        assert found['order of stamps']['clock_jumps'] == 1
        # one run's estimates against the same run: the others have the same stamps
        assert found['low-passed']['noise'] < 0.1 * found['low-passed']['rms_speed']
    assert 'the clock jumps back 1 time' in ' '.join(capsys.readouterr().out.split())


def test_stamps_of_which_none_can_be_used_are_said_to_jump_back(tmp_path):
    t = np.repeat(np.arange(9.0)[::-1], 2) + np.tile([0.0, 0.005], 9)
    code, result = doctor(tmp_path, written(tmp_path / 'bag', t, t))
    assert code == 1
    assert checks(result, 'elbow')['order of stamps']['level'] == 'FAIL'


@pytest.mark.long
@pytest.mark.parametrize('record', [looped, joined])
@pytest.mark.parametrize(
    'words',
    [
        ['evaluate', '--observer', 'all', '--html'],
        ['tune', '--trials', '2', '--out'],
        ['replay', '--observer', 'kalman', '--out'],
    ],
    ids=lambda words: words[0],
)
def test_other_commands_end_well(record, words, tmp_path):
    path = written(tmp_path / 'bag', *record())
    command, *options = words
    assert main([command, path, *options, str(tmp_path / f'out.{command}')]) == 0


@pytest.mark.long
def test_estimates_are_compared_with_the_run_that_they_are_of_and_not_ranked(tmp_path):
    path = written(tmp_path / 'bag', *joined())
    words = ['--observer', 'finite_difference', '--json', str(tmp_path / 'e.json')]
    assert main(['evaluate', path, *words]) == 0
    (found,) = json.loads((tmp_path / 'e.json').read_text())['bags'].values()
    own = found['estimates']['finite_difference']['joints']['elbow']['velocity']['rms']
    assert 0.05 < own < 0.1  # [rad/s]; against the other run it is above 1
    assert found['verdict']['elbow']['why'].startswith('the clock jumps back 1 time')
    assert found['verdict']['elbow']['rms'] == {}


def signals(seconds, speed, rate=5000.0):
    """Stamps and rows of a motor at this electrical speed [rad/s], with 10 A along q."""
    t = np.arange(int(seconds * rate)) / rate
    theta = speed * t + 20.0 * np.sin(TURN * 2.0 * t)
    current = 10j * np.exp(1j * theta)
    linkage = MOTOR['flux'] * np.exp(1j * theta) + MOTOR['inductance'] * current
    mean = 0.5 * (current[1:] + current[:-1])
    voltage = np.r_[0.0, np.diff(linkage) * rate + MOTOR['resistance'] * mean]
    noise = np.random.default_rng(0).normal(0.0, 0.02, (len(t), 2)) @ [1.0, 1j]
    stamps = START + np.rint(1e9 * t).astype(np.int64)
    return stamps, np.column_stack([current + noise, voltage]).view(float)


def drive(path, parts, batches=True):
    """A bag of drives one after another, as batches or as pairs of messages."""
    topics = ['/drive_samples'] if batches else ['/current', '/voltage']
    with BagWriter(path) as bag:
        for topic in topics:
            bag.add_topic(topic, drive_samples.TYPE if batches else vector3.TYPE)
        log = START
        for stamps, rows in parts:
            for first in range(0, len(stamps), 50):
                log += 10_000_000
                part = slice(first, first + 50)
                if batches:
                    raw = drive_samples.encode(stamps[part], rows[part])
                    bag.write(topics[0], log, raw)
                    continue
                for stamp, row in zip(stamps[part].tolist(), rows[part].tolist()):
                    bag.write(topics[0], log, vector3.encode(stamp, '', *row[:2]))
                    bag.write(topics[1], log, vector3.encode(stamp, '', *row[2:]))
    return str(path)


@pytest.mark.long
@pytest.mark.parametrize('batches', [True, pytest.param(False, marks=pytest.mark.slow)])
def test_runs_of_a_drive_are_not_mixed(batches, tmp_path):
    parts = [signals(0.4, -1500.0), signals(0.8, 2500.0)]
    code, whole = doctor(tmp_path, drive(tmp_path / 'bag', parts, batches), *DATA)
    found = checks(whole, 'motor_electrical')
    assert code == 1 and found['order of stamps']['clock_jumps'] == 1
    assert {name for name, each in found.items() if each['level'] != 'PASS'} == {'order of stamps'}
    assert found['flux linkage']['flux'] == pytest.approx(MOTOR['flux'], rel=0.02)
    assert ('input: ' in whole['parameters']) != batches  # the node's default is batches
