# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints whose stamps jump back: a loop that was recorded, and two recordings joined."""

import json
import math

import numpy as np
import pytest

from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main
from estimator_pkg.messages import joint_state, vector3

TURN = 2.0 * math.pi
START = 1_700_000_000_000_000_000
RATE, SECONDS = 200.0, 6.0
ANGLE = '/imu/tilt:vector.x'


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
@pytest.mark.parametrize('record, angle', [(looped, ''), (joined, ANGLE)])
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
def test_estimates_are_compared_with_the_run_that_they_are_of_and_ranked_with_a_caution(tmp_path):
    path = written(tmp_path / 'bag', *joined())
    words = ['--observer', 'finite_difference', '--json', str(tmp_path / 'e.json')]
    assert main(['evaluate', path, *words]) == 0
    (found,) = json.loads((tmp_path / 'e.json').read_text())['bags'].values()
    own = found['estimates']['finite_difference']['joints']['elbow']['velocity']['rms']
    assert 0.05 < own < 0.1  # [rad/s]; against the other run it is above 1
    assert found['verdict']['elbow']['cautions'][0].startswith('the clock jumps back 1 time')
    assert 0.05 < found['verdict']['elbow']['rms']['finite_difference'] < 0.1
