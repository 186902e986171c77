# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`doctor` finds second sensors, their ratio and delay, and whether they pay."""

import json
from pathlib import Path

import numpy as np
import pytest

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main
from estimator_pkg.evaluation.doctor.second import candidates
from estimator_pkg.messages.joint_state import TYPE, Encoder
from sim_pkg.joints.second import imu

BAGS = Path(__file__).parents[3] / 'bags/simulated'
START, COUNT = 10**18, 2.0 * np.pi / 4096


def swing(t):
    return 0.5 * np.sin(4.0 * t) + 0.1 * t, 2.0 * np.cos(4.0 * t) + 0.1


def bag(path, names, positions, velocities, gyro=None, rate=250):
    """A bag of joint states, and of a gyro: (value of a sample) or None."""
    encode = Encoder().encode
    with BagWriter(path) as writer:
        writer.add_topic('/joint_states', TYPE)
        writer.add_topic('/imu', 'sensor_msgs/msg/Imu')
        for k in range(len(positions)):
            now = START + round(k / rate * 1e9)
            if gyro is not None:
                writer.write('/imu', now, imu(round(k / rate * 1e9), float(gyro[k]), START))
            writer.write('/joint_states', now, encode(now, '', names, positions[k], velocities[k]))
    return str(path)


def doctor(path, tmp_path, *words):
    out = tmp_path / 'params.yaml', tmp_path / 'result.json'
    assert main(['doctor', path, *words, '--out', str(out[0]), '--json', str(out[1])]) == 0
    joints = json.loads(out[1].read_text())['joints']
    return out[0], {
        joint: [each for each in one['findings'] if each['check'] == 'second sensor']
        for joint, one in joints.items()
    }


def test_a_gyro_that_pays_is_found_and_its_file_is_used(tmp_path, capsys):
    path = str(BAGS / 'gyro')
    params, found = doctor(path, tmp_path)
    (gyro,) = found['wheel']
    assert gyro['field'] == 'angular_velocity.z' and gyro['pays']
    assert abs(gyro['delay']['value'] - 0.004) < 4.0 * gyro['delay']['stddev'] < 2e-4
    assert abs(gyro['ratio']['value'] - 1.0) < 4.0 * gyro['ratio']['stddev'] < 2e-4
    assert gyro['error_with'] < 0.6 * gyro['error_without']
    capsys.readouterr()
    assert main(['evaluate', path, '--params', str(params)]) == 0
    assert 'source imu_wheel: used, informs in 100' in ' '.join(capsys.readouterr().out.split())


def test_the_encoder_of_a_motor_is_found(tmp_path):
    words = '--measurement', '/joint_states'
    _, found = doctor(str(BAGS / 'motor_encoder'), tmp_path, *words)
    (motor,) = found['wheel']
    assert motor['topic'] == '/motor/joint_states'
    assert abs(motor['ratio']['value'] - 0.01) < 1e-4
    assert 'withheld: it contradicts the angle' in motor['value']  # while it moves the backlash


@pytest.fixture
def arm():
    rng, time = np.random.default_rng(3), np.arange(3000) / 250.0
    angle, speed = swing(time)
    other = np.sin(5.3 * time)
    turned = np.array([np.floor(angle / COUNT) * COUNT, np.floor(other / COUNT) * COUNT]).T
    own = speed + 0.003 * rng.standard_normal(len(time))
    return turned, np.array([own, np.full(len(time), np.nan)]).T, speed, other


def test_a_velocity_in_the_messages_is_a_second_sensor_of_its_joint(arm, tmp_path, capsys):
    turned, velocities, *_ = arm
    path = bag(tmp_path / 'arm', ['elbow', 'wrist'], turned, velocities)
    params, found = doctor(path, tmp_path)
    (own,) = found['elbow']
    assert own['field'] == 'velocity[0]' and own['pays']
    assert not found['wrist']  # it has no velocity, and the elbow does not move with it
    capsys.readouterr()
    assert main(['evaluate', path, '--params', str(params)]) == 0  # two ports of one topic
    output = ' '.join(capsys.readouterr().out.split())
    assert 'elbow: source joint_states_elbow: used' in output
    assert 'wrist: source' not in output


@pytest.mark.long
def test_sensors_that_do_not_agree_are_named(arm, tmp_path, capsys):
    turned, _, speed, other = arm
    nothing = np.full(turned.shape, np.nan)
    foreign = bag(
        tmp_path / 'foreign', ['elbow', 'wrist'], turned, nothing, np.gradient(other)[::-1]
    )
    _, found = doctor(foreign, tmp_path)
    assert 'no axis follows the joint' in found['elbow'][0]['value']
    wrong = np.clip(speed, -1.2, 1.2)
    _, found = doctor(
        bag(tmp_path / 'bad', ['elbow'], turned[:, :1], nothing[:, :1], wrong), tmp_path
    )
    (gyro,) = found['elbow']
    assert 'pays' not in gyro and ('not used' in gyro['value'] or 'withheld' in gyro['value'])
    assert 'Use the second sensor' not in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize('gear', [True, False])
def test_another_joint_of_the_messages_is_a_sensor_only_if_geared_to_it(gear, arm, tmp_path):
    """Joints of an arm move together, too: their positions are correlated by more than 0.9."""
    turned, velocities, _, other = arm
    elbow = 3.0 * turned[:, 0] + (0.0 if gear else 0.1) * other
    both = np.array([turned[:, 0], np.floor(elbow / COUNT) * COUNT]).T
    path = bag(tmp_path / 'arm', ['shoulder', 'elbow'], both, np.full(both.shape, np.nan))
    _, found = doctor(path, tmp_path)
    assert [each['field'] for each in found['shoulder']] == ['position[1]'] * gear


def test_a_reversed_velocity_in_the_messages_is_no_second_sensor(arm, tmp_path):
    turned, velocities, *_ = arm
    path = bag(tmp_path / 'arm', ['elbow', 'wrist'], turned, -velocities)
    _, found = doctor(path, tmp_path)
    assert not found['elbow']


def test_the_positions_of_many_joints_are_not_compared_with_one_another(tmp_path):
    moving = np.cumsum(np.ones((120, 65)), axis=0)
    for count, kinds in ((64, {'angle', 'rate'}), (65, {'rate'})):
        names, values = [f'j{i}' for i in range(count)], moving[:, :count].tolist()
        with open_bag(bag(tmp_path / str(count), names, values, values)) as reader:
            assert {each.kind for each in candidates(reader)} == kinds
