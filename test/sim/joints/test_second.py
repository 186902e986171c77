# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Second sensors of `encoder_sim`: a gyro, and a motor's encoder behind backlash."""

import numpy as np

from estimator_pkg.bags.definitions import jazzy
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.parameters import build
from sim_pkg.joints.encoder import SIMULATOR

COUNT = 2.0 * np.pi / 4096


def simulated(seconds=4.0, **values):
    """Messages by topic, decoded."""
    parameters = build(SIMULATOR.parameters, values)
    imu, found = jazzy(), {}
    for chunk in SIMULATOR.generate(parameters, seconds, 1):
        for message in chunk:
            raw = message.encode(0)
            decoded = (
                imu.deserialize_cdr(raw, 'sensor_msgs/msg/Imu')
                if message.topic == 'imu'
                else Decoder().decode(raw)
            )
            found.setdefault(message.topic, []).append(decoded)
    return found


def test_a_gyro_has_its_noise_bias_rate_and_delay():
    found = simulated(gyro_rate=250.0, gyro_noise=0.02, gyro_bias=0.1, gyro_delay=0.003)
    stamps = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in found['imu']])
    values = np.array([m.angular_velocity.z for m in found['imu']])
    np.testing.assert_allclose(np.diff(stamps), 0.004, atol=1e-8)
    swing = 2.0 * np.pi * 0.3
    error = values - 5.0 * swing * np.cos(swing * (stamps - 0.003))
    assert len(values) == 1000
    assert abs(error.mean() + 0.1) < 0.003 and abs(error.std() - 0.02) < 0.002
    assert found['imu'][0].orientation_covariance[0] == -1.0  # there is none


def test_a_joint_follows_its_motor_with_play():
    found = simulated(motor_ratio=50.0, backlash=0.02, amplitude=1.0)
    true = np.array([m.positions[0] for m in found['ground_truth/joint_states']])
    speed = np.array([m.velocities[0] for m in found['ground_truth/joint_states']])
    motor = np.unwrap([m.positions[0] for m in found['motor/joint_states']]) / 50.0
    motor += COUNT / 100.0  # half a count
    apart = motor - true
    assert np.all(np.abs(apart) < 0.01 + COUNT / 50.0) and np.ptp(apart) > 0.0195
    pushed = np.abs(np.abs(apart) - 0.01) < COUNT / 100.0
    assert np.all(speed[~pushed][10:] == 0.0) and 0.7 < pushed.mean() < 0.95
    np.testing.assert_allclose(np.cumsum(speed) * 1e-3, true, atol=2.5e-3)
    read = np.array([m.positions[0] for m in found['joint_states']])
    assert np.all((true - read >= 0.0) & (true - read < COUNT))


def test_by_default_there_is_none_and_further_sensors_change_no_draw():
    plain = simulated(noise=0.001)
    more = simulated(noise=0.001, gyro_rate=100.0, motor_ratio=10.0)
    assert set(plain) == {'joint_states', 'ground_truth/joint_states'}
    assert [m.positions for m in more['joint_states']] == [
        m.positions for m in plain['joint_states']
    ]
